//! What a suspension is to the solver: two mechanisms, how the second's poses follow from the first's, and
//! which constraints and points the outputs are read from. Data only; the types of suspension live in
//! `assemble`, which composes these.

use spatial::{EulerParameters, Matrix3, Vector3};

use crate::body::{Body, Pose};
use crate::constraint::{Constraint, Frame, Kind};
use crate::mechanism::Mechanism;

/// Index of the car body in every mechanism.
pub(crate) const BODY: usize = 0;
/// Index of the rack.
pub(crate) const RACK: usize = 1;
/// Driver of the rack stroke; drivers 1 and 2 are the left and right wheel-centre heights.
pub(crate) const RACK_DRIVER: usize = 0;

/// Bodies, design poses and constraints under construction.
#[derive(Debug, Clone, Default)]
pub(crate) struct Builder {
    pub bodies: Vec<Body>,
    pub design: Vec<Pose>,
    pub constraints: Vec<Constraint>,
}

impl Builder {
    pub fn body(&mut self, name: &str, origin: Vector3<f64>) -> usize {
        self.bodies.push(Body::massless(name));
        self.design.push(Pose::at(origin));
        self.bodies.len() - 1
    }

    pub fn constrain(&mut self, name: String, i: usize, j: usize, kind: Kind) -> usize {
        self.constraints.push(Constraint { name, i, j, kind });
        self.constraints.len() - 1
    }

    /// A design point in a body's frame.
    pub fn local(&self, body: usize, point: Vector3<f64>) -> Vector3<f64> {
        self.design[body].local(&point)
    }

    /// A joint frame on a body at a design point; axes are given in the design (global) directions.
    pub fn frame(&self, body: usize, point: Vector3<f64>, axes: &Matrix3<f64>) -> Frame {
        Frame { origin: self.local(body, point), axes: self.design[body].p.matrix().tr_mul(axes) }
    }

    /// A massless link of the design length between two design points.
    pub fn link(&mut self, name: String, i: usize, p_i: Vector3<f64>, j: usize, p_j: Vector3<f64>) -> usize {
        let kind =
            Kind::Distance { s_i: self.local(i, p_i), s_j: self.local(j, p_j), length_m: (p_j - p_i).norm() };
        self.constrain(name, i, j, kind)
    }

    pub fn mechanism(&self) -> Mechanism {
        Mechanism::new(self.bodies.clone(), self.constraints.clone())
    }
}

/// How the pose of a body of the force stage follows from the kinematic stage.
#[derive(Debug, Clone)]
pub(crate) enum Follow {
    /// The same body.
    Same(usize),
    /// Turned about an axis fixed in the car body so that its tip points at a point of a kinematic body.
    Hinged {
        /// A point of the axis. [m]
        origin: Vector3<f64>,
        /// Unit axis.
        axis: Vector3<f64>,
        /// The body's design origin and tip, from the axis point. [m]
        design: Vector3<f64>,
        tip: Vector3<f64>,
        /// Kinematic body and its point that the tip follows.
        body: usize,
        point: Vector3<f64>,
    },
    /// A link on a cross joint with the car body: points from its inner point at a point of a kinematic
    /// body, with its cross axis staying normal to the body's.
    Link {
        /// Inner point. [m]
        origin: Vector3<f64>,
        /// Unit cross axis on the car body.
        cross: Vector3<f64>,
        /// Design triad: along the link, cross axis on the link, their product.
        triad: Matrix3<f64>,
        /// Kinematic body and its point that the link's outer end follows.
        body: usize,
        point: Vector3<f64>,
    },
}

impl Follow {
    /// The pose, from the poses of the kinematic bodies.
    #[inline]
    pub fn pose(&self, kinematic: &[Pose]) -> Pose {
        match self {
            Self::Same(body) => kinematic[*body],
            Self::Hinged { origin, axis, design, tip, body, point } => {
                let target = kinematic[*body].point(point) - origin;
                let flat = |v: &Vector3<f64>| v - axis * axis.dot(v);
                let (from, to) = (flat(tip), flat(&target));
                // Half the angle from its cosine and sine, without trigonometry.
                let (x, y) = (from.dot(&to), axis.dot(&from.cross(&to)));
                let r = x.hypot(y);
                let e0 = (0.5 * (r + x)).max(0.0).sqrt();
                let e = if x > 0.0 { 0.5 * y / e0 } else { (0.5 * (r - x)).sqrt().copysign(y) };
                let p = EulerParameters { e0, e: axis * e }.normalised();
                Pose { r: origin + p.matrix() * design, p }
            }
            Self::Link { origin, cross, triad, body, point } => {
                let along = (kinematic[*body].point(point) - origin).normalize();
                let across = cross.cross(&along).normalize();
                let now = Matrix3::from_columns(&[along, across, along.cross(&across)]);
                Pose { r: *origin, p: EulerParameters::from_matrix(&(now * triad.transpose())) }
            }
        }
    }
}

/// Where the steering axis of a side comes from.
#[derive(Debug, Clone)]
pub(crate) enum SteeringAxis {
    /// From a lower to an upper point: kinematic body and its point.
    Points { lower: (usize, Vector3<f64>), upper: (usize, Vector3<f64>) },
    /// The instantaneous screw axis of the knuckle when the rack moves at fixed wheel-centre height.
    Instantaneous,
}

/// One side's places of interest.
#[derive(Debug, Clone)]
pub(crate) struct Side {
    /// The knuckle: the same index in both mechanisms.
    pub knuckle: usize,
    /// On the knuckle, in its frame (its origin is the wheel centre). [m]
    pub tie_rod_outer: Vector3<f64>,
    pub contact_patch: Vector3<f64>,
    pub spin_axis: Vector3<f64>,
    /// Design height of the wheel centre. [m]
    pub wheel_centre_z: f64,
    pub steering_axis: SteeringAxis,
    /// Constraints of the force stage.
    pub tie_rod: usize,
    pub spring: usize,
    pub drop_link: Option<usize>,
    /// Their actions on the knuckle add up to the upper and lower joint forces.
    pub upper: Vec<usize>,
    pub lower: Vec<usize>,
    /// Ends of the spring or strut whose length is reported: force-stage bodies and points.
    pub spring_ends: [(usize, Vector3<f64>); 2],
}

/// The stabiliser: its halves in both mechanisms and its spring.
#[derive(Debug, Clone)]
pub(crate) struct Bar {
    pub axis: Vector3<f64>,
    pub stiffness: f64,
    pub kinematic: [usize; 2],
    pub reaction: [usize; 2],
}

/// The whole.
#[derive(Debug, Clone)]
pub(crate) struct Model {
    pub kinematic: Builder,
    pub reaction: Builder,
    /// One per body of the force stage.
    pub follow: Vec<Follow>,
    pub sides: [Side; 2],
    pub bar: Option<Bar>,
}

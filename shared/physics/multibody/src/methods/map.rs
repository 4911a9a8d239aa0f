//! Alignment maps: each quantity as a one-dimensional function of wheel travel plus one of the rack,
//! f(z, u) = f(z, 0) + f(0, u) − f(0, 0). What the two do to each other is lost: that is the method's error.
//!
//! Frame B (ISO 8855). The knuckle's attitude is R = Rz(ψ)Rx(ε)Ry(θ)Cᵀ, with ψ the wheel's heading, ε its
//! inclination, θ the knuckle's pitch about the wheel axis, and C = Rz(ψ₀)Rx(ε₀) the wheel's frame at
//! design. Between nodes: cubic through four nodes. Beyond the swept range the edge value holds.

use config::axle::Axle;
use spatial::{Matrix3, Vector3};

use super::sweep::{Over, reach};
use crate::failure::AssemblyError;
use crate::suspension::{SideOutput, SuspensionOutput};

/// Node distance over wheel travel. [m]
const TRAVEL_STEP_M: f64 = 2e-3;
/// Nodes to either side of design: ±120 mm where the mechanism reaches.
const TRAVEL_NODES: usize = 60;
/// Nodes from rack centre to full stroke, and a little beyond.
const RACK_NODES_PER_STROKE: usize = 32;
const RACK_NODES: usize = 36;
/// Fewest nodes of a map.
const NODES_MIN: usize = 4;

/// Quantities of a map: ψ, ε, θ, caster, kingpin inclination, wheel centre x, y, kingpin point x, y, z.
const CHANNELS: usize = 10;

/// Why there is no map.
#[derive(Debug, Clone, PartialEq)]
pub enum MapError {
    /// The axle cannot be assembled.
    Assembly(AssemblyError),
    /// The mechanism reaches too little.
    TooNarrow {
        /// Over what.
        over: Over,
        /// Poses that were solved.
        nodes: usize,
    },
}

impl From<AssemblyError> for MapError {
    fn from(error: AssemblyError) -> Self {
        Self::Assembly(error)
    }
}

impl std::fmt::Display for MapError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Assembly(error) => error.fmt(f),
            Self::TooNarrow { over, nodes } => {
                let over = match over {
                    Over::Travel => "wheel travel",
                    Over::Rack => "the rack",
                };
                write!(f, "no alignment map: only {nodes} poses over {over} can be reached")
            }
        }
    }
}

impl std::error::Error for MapError {}

/// Channels of both sides on a uniform grid.
#[derive(Debug, Clone, PartialEq)]
struct Line {
    first_m: f64,
    step_m: f64,
    nodes: Vec<[[f64; CHANNELS]; 2]>,
}

impl Line {
    fn sweep(axle: &Axle, over: Over, step_m: f64, count: usize) -> Result<Self, MapError> {
        let (poses, below) = reach(axle, over, step_m, count)?;
        if poses.len() < NODES_MIN {
            return Err(MapError::TooNarrow { over, nodes: poses.len() });
        }
        let nodes = poses.iter().map(|pose| channels(axle, pose)).collect();
        Ok(Self { first_m: -step_m * below as f64, step_m, nodes })
    }

    /// Lagrange's cubic through the four nodes around `x`.
    fn at(&self, side: usize, x: f64) -> [f64; CHANNELS] {
        let u = ((x - self.first_m) / self.step_m).clamp(0.0, (self.nodes.len() - 1) as f64);
        let cell = (u as usize).clamp(1, self.nodes.len() - 3);
        let t = u - cell as f64;
        let weights = [
            -t * (t - 1.0) * (t - 2.0) / 6.0,
            (t + 1.0) * (t - 1.0) * (t - 2.0) / 2.0,
            -(t + 1.0) * t * (t - 2.0) / 2.0,
            (t + 1.0) * t * (t - 1.0) / 6.0,
        ];
        let mut value = [0.0; CHANNELS];
        for (weight, node) in weights.iter().zip(&self.nodes[cell - 1..]) {
            for (v, n) in value.iter_mut().zip(&node[side]) {
                *v += weight * n;
            }
        }
        value
    }

    fn range_m(&self) -> [f64; 2] {
        [self.first_m, self.first_m + self.step_m * (self.nodes.len() - 1) as f64]
    }
}

/// One side as the maps have it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MappedSide {
    /// Toe, + in. [rad]
    pub toe_rad: f64,
    /// Camber, + top outward. [rad]
    pub camber_rad: f64,
    /// Caster, + top rearward. [rad]
    pub caster_rad: f64,
    /// Kingpin inclination, + top inboard. [rad]
    pub kingpin_inclination_rad: f64,
    /// Takes vectors of the knuckle frame K to B.
    pub attitude: Matrix3<f64>,
    /// Wheel centre. [m]
    pub wheel_centre_m: Vector3<f64>,
    /// A point of the kingpin axis: the lower ball joint. [m]
    pub kingpin_point_m: Vector3<f64>,
    /// Unit direction of the kingpin axis, upwards.
    pub kingpin_direction: Vector3<f64>,
    /// Tie rod's outer ball, fixed to the knuckle. [m]
    pub tie_rod_ball_m: Vector3<f64>,
    /// Tie rod's inner ball, on the rack. [m]
    pub tie_rod_inner_m: Vector3<f64>,
}

/// The maps of both sides of an axle.
#[derive(Debug, Clone, PartialEq)]
pub struct AlignmentMaps {
    travel: Line,
    rack: Line,
    design: [[f64; CHANNELS]; 2],
    frame: [Matrix3<f64>; 2],
    wheel_centre_m: [Vector3<f64>; 2],
    inner_m: [Vector3<f64>; 2],
    /// Outer ball from the wheel centre, in K. [m]
    ball_m: [Vector3<f64>; 2],
}

fn rz(a: f64) -> Matrix3<f64> {
    let (s, c) = a.sin_cos();
    Matrix3::new(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0)
}

fn rx(a: f64) -> Matrix3<f64> {
    let (s, c) = a.sin_cos();
    Matrix3::new(1.0, 0.0, 0.0, 0.0, c, -s, 0.0, s, c)
}

fn ry(a: f64) -> Matrix3<f64> {
    let (s, c) = a.sin_cos();
    Matrix3::new(c, 0.0, s, 0.0, 1.0, 0.0, -s, 0.0, c)
}

const OUTWARD: [f64; 2] = [1.0, -1.0];

/// The wheel's frame at design: y along the spin axis, x level.
fn wheel_frame(axle: &Axle, side: usize) -> Matrix3<f64> {
    let s = Vector3::from(axle.spin_axis(side)).normalize();
    rz((-s.x).atan2(s.y)) * rx(s.z.clamp(-1.0, 1.0).asin())
}

fn side_channels(axle: &Axle, side: usize, out: &SideOutput) -> [f64; CHANNELS] {
    let [e0, e1, e2, e3] = out.knuckle_quaternion;
    let attitude = spatial::EulerParameters { e0, e: Vector3::new(e1, e2, e3) }.matrix();
    let wheel = attitude * wheel_frame(axle, side);
    // Rz(ψ)Rx(ε)Ry(θ): the second column is the spin axis, the third row cos ε (−sin θ, ·, cos θ).
    let heading = (-wheel[(0, 1)]).atan2(wheel[(1, 1)]);
    let inclination = wheel[(2, 1)].clamp(-1.0, 1.0).asin();
    let pitch = (-wheel[(2, 0)]).atan2(wheel[(2, 2)]);
    let (wheel_centre, point) = (out.wheel_centre_m, out.lower_joint_m);
    [
        heading,
        inclination,
        pitch,
        out.caster_rad,
        out.kingpin_inclination_rad,
        wheel_centre.x,
        wheel_centre.y,
        point.x,
        point.y,
        point.z,
    ]
}

fn channels(axle: &Axle, output: &SuspensionOutput) -> [[f64; CHANNELS]; 2] {
    [0, 1].map(|side| side_channels(axle, side, &output.side[side]))
}

impl AlignmentMaps {
    /// Sweeps the axle's rigid kinematics with the multibody solver.
    ///
    /// # Errors
    /// When the axle cannot be assembled or moves by less than four nodes.
    pub fn new(axle: &Axle) -> Result<Self, MapError> {
        let travel = Line::sweep(axle, Over::Travel, TRAVEL_STEP_M, TRAVEL_NODES)?;
        let step = axle.rack_stroke_m / RACK_NODES_PER_STROKE as f64;
        let rack = Line::sweep(axle, Over::Rack, step, RACK_NODES)?;
        let point = |side, name| Vector3::from(axle.geometry.point(side, name).unwrap_or_default());
        let both = |name| [0, 1].map(|side| point(side, name));
        let wheel_centre_m = both("wheel_centre");
        let ball = both("tierod_outer");
        Ok(Self {
            design: [0, 1].map(|side| travel.at(side, 0.0)),
            frame: [0, 1].map(|side| wheel_frame(axle, side)),
            ball_m: [0, 1].map(|side| ball[side] - wheel_centre_m[side]),
            inner_m: both("tierod_inner"),
            wheel_centre_m,
            travel,
            rack,
        })
    }

    /// Wheel travels that were swept. [m]
    #[must_use]
    pub fn travel_range_m(&self) -> [f64; 2] {
        self.travel.range_m()
    }

    /// Rack displacements that were swept. [m]
    #[must_use]
    pub fn rack_range_m(&self) -> [f64; 2] {
        self.rack.range_m()
    }

    /// Side 0 (left) or 1 (right) at a wheel travel and a rack displacement. [m] Without allocation.
    #[must_use]
    pub fn at(&self, side: usize, travel_m: f64, rack_m: f64) -> MappedSide {
        debug_assert!(side < 2);
        let (of_travel, of_rack) = (self.travel.at(side, travel_m), self.rack.at(side, rack_m));
        let design = &self.design[side];
        let value: [f64; CHANNELS] = std::array::from_fn(|c| of_travel[c] + of_rack[c] - design[c]);
        let [heading, inclination, pitch, caster, kpi, x, y, kx, ky, kz] = value;
        let outward = OUTWARD[side];
        let attitude = rz(heading) * rx(inclination) * ry(pitch) * self.frame[side].transpose();
        let wheel_centre_m = Vector3::new(x, y, self.wheel_centre_m[side].z + travel_m);
        MappedSide {
            toe_rad: -outward * heading,
            camber_rad: -outward * inclination,
            caster_rad: caster,
            kingpin_inclination_rad: kpi,
            attitude,
            wheel_centre_m,
            kingpin_point_m: Vector3::new(kx, ky, kz),
            kingpin_direction: Vector3::new(-caster.tan(), -outward * kpi.tan(), 1.0).normalize(),
            tie_rod_ball_m: wheel_centre_m + attitude * self.ball_m[side],
            tie_rod_inner_m: self.inner_m[side] + Vector3::new(0.0, rack_m, 0.0),
        }
    }
}

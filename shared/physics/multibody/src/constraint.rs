//! The constraint library: value Φ, Jacobian Φ_q in [δr; δπ'], velocity right side ν, acceleration right
//! side γ, and joint-frame reactions, after Haug, *Computer Aided Kinematics and Dynamics of Mechanical
//! Systems* (1989), ch. 9 and 11.
//!
//! Between bodies i and j, with d = r_j + A_j s'_j − r_i − A_i s'_i. Every joint is composed of five basic
//! rows: coincidence eᵀd, dot-1 aᵢᵀbⱼ, dot-2 aᵢᵀd, distance dᵀd − C², and one global coordinate of a point;
//! the ground adds attitude rows 2G(p₀)p. Velocity: Φ_q v = ν; acceleration: Φ_q a = γ. The force of a
//! constraint on its bodies is −Φ_qᵀλ. A joint frame's axes are the columns f, g, h of C; h is the axis of
//! rotation or translation.

use spatial::{EulerParameters, Matrix3, Vector3};

use crate::body::{Placed, Pose, Twist};

/// Most rows that one constraint has.
pub const ROWS_MAX: usize = 6;

/// A joint frame on a body: origin and axes (columns f, g, h) in the body frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    /// Origin s'. [m]
    pub origin: Vector3<f64>,
    /// Axes f, g, h as columns; orthonormal, right-handed.
    pub axes: Matrix3<f64>,
}

impl Frame {
    /// f, the first axis.
    #[must_use]
    pub fn f(&self) -> Vector3<f64> {
        self.axes.column(0).into_owned()
    }
    /// g, the second axis.
    #[must_use]
    pub fn g(&self) -> Vector3<f64> {
        self.axes.column(1).into_owned()
    }
    /// h, the axis of rotation or translation.
    #[must_use]
    pub fn h(&self) -> Vector3<f64> {
        self.axes.column(2).into_owned()
    }
}

/// What a constraint forbids.
#[derive(Debug, Clone, PartialEq)]
pub enum Kind {
    /// The pose of body j is fixed. 6 rows.
    Ground {
        /// The pose.
        pose: Pose,
    },
    /// Point of j on point of i. 3 rows.
    Spherical {
        /// Point on i. [m]
        s_i: Vector3<f64>,
        /// Point on j. [m]
        s_j: Vector3<f64>,
    },
    /// Two points at a fixed distance. 1 row.
    Distance {
        /// Point on i. [m]
        s_i: Vector3<f64>,
        /// Point on j. [m]
        s_j: Vector3<f64>,
        /// The distance C. [m], > 0
        length_m: f64,
    },
    /// Rotation about the common h axis only. 5 rows.
    Revolute {
        /// Joint frame on i.
        on_i: Frame,
        /// Joint frame on j.
        on_j: Frame,
    },
    /// Translation along the common h axis only. 5 rows.
    Translational {
        /// Joint frame on i.
        on_i: Frame,
        /// Joint frame on j.
        on_j: Frame,
    },
    /// Translation along and rotation about the common h axis. 4 rows.
    Cylindrical {
        /// Joint frame on i.
        on_i: Frame,
        /// Joint frame on j.
        on_j: Frame,
    },
    /// Cross joint: common origin, h of i stays normal to h of j (the two axes of the cross). 4 rows.
    Universal {
        /// Joint frame on i.
        on_i: Frame,
        /// Joint frame on j.
        on_j: Frame,
    },
    /// Homokinetic joint: common origin, equal rotation of both shafts about their h axes: the relative
    /// rotation has no component along h, gᵢᵀfⱼ − fᵢᵀgⱼ = 0. 4 rows.
    ConstantVelocity {
        /// Joint frame on i.
        on_i: Frame,
        /// Joint frame on j.
        on_j: Frame,
    },
    /// Strut: a point of j stays on the line through the origin of i's frame along h. 2 rows.
    Strut {
        /// The line on i.
        on_i: Frame,
        /// Point on j. [m]
        s_j: Vector3<f64>,
    },
    /// A point of j stays in the plane through the origin of i's frame normal to h. 1 row.
    PointInPlane {
        /// The plane on i.
        on_i: Frame,
        /// Point on j. [m]
        s_j: Vector3<f64>,
    },
    /// hᵀd = s(t): stroke of j along h of i. 1 row.
    TranslationalDriver {
        /// Axis and zero on i.
        on_i: Frame,
        /// Point on j. [m]
        s_j: Vector3<f64>,
        /// Which driver gives s(t).
        driver: usize,
    },
    /// One global coordinate of a point of j follows z(t). 1 row.
    AxisDriver {
        /// Point on j. [m]
        s_j: Vector3<f64>,
        /// Which coordinate: 0 x, 1 y, 2 z.
        axis: usize,
        /// Which driver gives z(t).
        driver: usize,
    },
}

/// A driver's value and its first two time derivatives.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Drive {
    /// Value. [m]
    pub value: f64,
    /// Rate. [m/s]
    pub speed: f64,
    /// Second rate. [m/s²]
    pub acceleration: f64,
}

/// A constraint between body i and body j (for `Ground` and `AxisDriver`, body j and the global frame;
/// i is then ignored and should be the same as j).
#[derive(Debug, Clone, PartialEq)]
pub struct Constraint {
    /// Name, for messages and descriptions.
    pub name: String,
    /// First body.
    pub i: usize,
    /// Second body.
    pub j: usize,
    /// What is forbidden.
    pub kind: Kind,
}

impl Kind {
    /// Number of scalar equations.
    #[must_use]
    pub fn rows(&self) -> usize {
        match self {
            Self::Ground { .. } => 6,
            Self::Revolute { .. } | Self::Translational { .. } => 5,
            Self::Cylindrical { .. } | Self::Universal { .. } | Self::ConstantVelocity { .. } => 4,
            Self::Spherical { .. } => 3,
            Self::Strut { .. } => 2,
            Self::Distance { .. }
            | Self::PointInPlane { .. }
            | Self::TranslationalDriver { .. }
            | Self::AxisDriver { .. } => 1,
        }
    }

    /// The kind's name.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::Ground { .. } => "ground",
            Self::Spherical { .. } => "spherical",
            Self::Distance { .. } => "distance",
            Self::Revolute { .. } => "revolute",
            Self::Translational { .. } => "translational",
            Self::Cylindrical { .. } => "cylindrical",
            Self::Universal { .. } => "universal",
            Self::ConstantVelocity { .. } => "constant velocity",
            Self::Strut { .. } => "strut",
            Self::PointInPlane { .. } => "point in plane",
            Self::TranslationalDriver { .. } => "translational driver",
            Self::AxisDriver { .. } => "axis driver",
        }
    }

    /// Whether the constraint acts on body j alone.
    #[must_use]
    pub fn is_absolute(&self) -> bool {
        matches!(self, Self::Ground { .. } | Self::AxisDriver { .. })
    }
}

/// One scalar equation: its value and its Jacobian in [δr_i, δπ'_i] and [δr_j, δπ'_j].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Row {
    /// Φ.
    pub phi: f64,
    /// ∂Φ/∂[r_i, π'_i, r_j, π'_j].
    pub jac: [f64; 12],
}

impl Row {
    /// All zero.
    pub const ZERO: Self = Self { phi: 0.0, jac: [0.0; 12] };

    #[inline]
    fn new(phi: f64, r_i: Vector3<f64>, pi_i: Vector3<f64>, r_j: Vector3<f64>, pi_j: Vector3<f64>) -> Self {
        let jac = [r_i.x, r_i.y, r_i.z, pi_i.x, pi_i.y, pi_i.z, r_j.x, r_j.y, r_j.z, pi_j.x, pi_j.y, pi_j.z];
        Self { phi, jac }
    }
}

/// Two placed bodies between which rows are formed.
struct Pair<'a> {
    i: &'a Placed,
    j: &'a Placed,
}

impl Pair<'_> {
    #[inline]
    fn d(&self, s_i: &Vector3<f64>, s_j: &Vector3<f64>) -> Vector3<f64> {
        self.j.point(s_j) - self.i.point(s_i)
    }

    /// eᵀd for the three global axes: Φ_ri = −I, Φ_πi = A_i s̃'_i, Φ_rj = I, Φ_πj = −A_j s̃'_j.
    #[inline]
    fn coincide(&self, s_i: &Vector3<f64>, s_j: &Vector3<f64>, out: &mut [Row]) {
        let d = self.d(s_i, s_j);
        for k in 0..3 {
            let (a_i, a_j) = (self.i.a.row(k).transpose(), self.j.a.row(k).transpose());
            let mut e = Vector3::zeros();
            e[k] = 1.0;
            out[k] = Row::new(d[k], -e, a_i.cross(s_i), e, s_j.cross(&a_j));
        }
    }

    /// aᵢᵀbⱼ.
    #[inline]
    fn dot1(&self, a: &Vector3<f64>, b: &Vector3<f64>) -> Row {
        let (ga, gb) = (self.i.a * a, self.j.a * b);
        let zero = Vector3::zeros();
        let (pi_i, pi_j) = (a.cross(&self.i.a.tr_mul(&gb)), b.cross(&self.j.a.tr_mul(&ga)));
        Row::new(ga.dot(&gb), zero, pi_i, zero, pi_j)
    }

    /// aᵢᵀd.
    #[inline]
    fn dot2(&self, a: &Vector3<f64>, s_i: &Vector3<f64>, s_j: &Vector3<f64>, d: &Vector3<f64>) -> Row {
        let ga = self.i.a * a;
        let (pi_i, pi_j) = (a.cross(&(self.i.a.tr_mul(d) + s_i)), s_j.cross(&self.j.a.tr_mul(&ga)));
        Row::new(ga.dot(d), -ga, pi_i, ga, pi_j)
    }

    /// dᵀd − C².
    #[inline]
    fn distance(&self, s_i: &Vector3<f64>, s_j: &Vector3<f64>, length: f64) -> Row {
        let arm = self.j.a * s_j;
        let (d, pi_i) = if self.i.still {
            let d = self.j.r + arm - s_i;
            (d, 2.0 * d.cross(s_i))
        } else {
            let d = self.j.r + arm - self.i.point(s_i);
            (d, 2.0 * self.i.a.tr_mul(&d).cross(s_i))
        };
        let twice = 2.0 * d;
        let pi_j = s_j.cross(&self.j.a.tr_mul(&twice));
        Row::new(d.norm_squared() - length * length, -twice, pi_i, twice, pi_j)
    }
}

impl Constraint {
    /// Φ and Jacobian of every row, for the placed bodies.
    pub(crate) fn evaluate(&self, bodies: &[Placed], drives: &[Drive], out: &mut [Row]) {
        let pair = Pair { i: &bodies[self.i], j: &bodies[self.j] };
        match &self.kind {
            Kind::Ground { pose } => ground(pose, pair.j, out),
            Kind::Spherical { s_i, s_j } => pair.coincide(s_i, s_j, out),
            Kind::Distance { s_i, s_j, length_m } => out[0] = pair.distance(s_i, s_j, *length_m),
            Kind::Revolute { on_i, on_j } => {
                pair.coincide(&on_i.origin, &on_j.origin, out);
                out[3] = pair.dot1(&on_i.f(), &on_j.h());
                out[4] = pair.dot1(&on_i.g(), &on_j.h());
            }
            Kind::Translational { on_i, on_j } | Kind::Cylindrical { on_i, on_j } => {
                let d = pair.d(&on_i.origin, &on_j.origin);
                out[0] = pair.dot1(&on_i.f(), &on_j.h());
                out[1] = pair.dot1(&on_i.g(), &on_j.h());
                out[2] = pair.dot2(&on_i.f(), &on_i.origin, &on_j.origin, &d);
                out[3] = pair.dot2(&on_i.g(), &on_i.origin, &on_j.origin, &d);
                if let Some(last) = out.get_mut(4) {
                    *last = pair.dot1(&on_i.f(), &on_j.g());
                }
            }
            Kind::Universal { on_i, on_j } => {
                pair.coincide(&on_i.origin, &on_j.origin, out);
                out[3] = pair.dot1(&on_i.h(), &on_j.h());
            }
            Kind::ConstantVelocity { on_i, on_j } => {
                pair.coincide(&on_i.origin, &on_j.origin, out);
                let (plus, minus) = (pair.dot1(&on_i.g(), &on_j.f()), pair.dot1(&on_i.f(), &on_j.g()));
                out[3] = Row {
                    phi: plus.phi - minus.phi,
                    jac: std::array::from_fn(|k| plus.jac[k] - minus.jac[k]),
                };
            }
            Kind::Strut { on_i, s_j } => {
                let d = pair.d(&on_i.origin, s_j);
                out[0] = pair.dot2(&on_i.f(), &on_i.origin, s_j, &d);
                out[1] = pair.dot2(&on_i.g(), &on_i.origin, s_j, &d);
            }
            Kind::PointInPlane { on_i, s_j } => {
                let d = pair.d(&on_i.origin, s_j);
                out[0] = pair.dot2(&on_i.h(), &on_i.origin, s_j, &d);
            }
            Kind::TranslationalDriver { on_i, s_j, driver } => {
                let d = pair.d(&on_i.origin, s_j);
                out[0] = pair.dot2(&on_i.h(), &on_i.origin, s_j, &d);
                out[0].phi -= drives[*driver].value;
            }
            Kind::AxisDriver { s_j, axis, driver } => {
                let a_j = pair.j.a.row(*axis).transpose();
                let mut e = Vector3::zeros();
                e[*axis] = 1.0;
                let phi = pair.j.point(s_j)[*axis] - drives[*driver].value;
                out[0] = Row::new(phi, Vector3::zeros(), Vector3::zeros(), e, s_j.cross(&a_j));
            }
        }
    }

    /// ν of every row: the drivers' rates, zero elsewhere. [m/s]
    pub fn velocity_right_side(&self, drives: &[Drive], out: &mut [f64]) {
        out[..self.kind.rows()].fill(0.0);
        if let Kind::TranslationalDriver { driver, .. } | Kind::AxisDriver { driver, .. } = self.kind {
            out[0] = drives[driver].speed;
        }
    }

    /// γ of every row, from the quadratic velocity terms and the drivers' second rates.
    pub(crate) fn acceleration_right_side(
        &self,
        bodies: &[Placed],
        twists: &[Twist],
        drives: &[Drive],
        out: &mut [f64],
    ) {
        let quad = Quadratic {
            i: &bodies[self.i],
            j: &bodies[self.j],
            w_i: twists[self.i].omega,
            w_j: twists[self.j].omega,
            v: twists[self.j].v - twists[self.i].v,
        };
        match &self.kind {
            Kind::Ground { pose } => {
                out[..3].fill(0.0);
                // Φ̈ = G(p₀)Gᵀω̇' − ½ω'² G(p₀)p.
                let attitude = 0.5 * quad.w_j.norm_squared() * pose.p.relative_to(quad.j.p).e;
                out[3..6].copy_from_slice(attitude.as_slice());
            }
            Kind::Spherical { s_i, s_j } => quad.coincide(s_i, s_j, out),
            Kind::Distance { s_i, s_j, .. } => {
                let d = quad.j.point(s_j) - quad.i.point(s_i);
                let rate = quad.rate(s_i, s_j);
                out[0] = -2.0 * rate.norm_squared() - 2.0 * d.dot(&quad.second(s_i, s_j));
            }
            Kind::Revolute { on_i, on_j } => {
                quad.coincide(&on_i.origin, &on_j.origin, out);
                out[3] = quad.dot1(&on_i.f(), &on_j.h());
                out[4] = quad.dot1(&on_i.g(), &on_j.h());
            }
            Kind::Translational { on_i, on_j } | Kind::Cylindrical { on_i, on_j } => {
                out[0] = quad.dot1(&on_i.f(), &on_j.h());
                out[1] = quad.dot1(&on_i.g(), &on_j.h());
                out[2] = quad.dot2(&on_i.f(), &on_i.origin, &on_j.origin);
                out[3] = quad.dot2(&on_i.g(), &on_i.origin, &on_j.origin);
                if self.kind.rows() == 5 {
                    out[4] = quad.dot1(&on_i.f(), &on_j.g());
                }
            }
            Kind::Universal { on_i, on_j } => {
                quad.coincide(&on_i.origin, &on_j.origin, out);
                out[3] = quad.dot1(&on_i.h(), &on_j.h());
            }
            Kind::ConstantVelocity { on_i, on_j } => {
                quad.coincide(&on_i.origin, &on_j.origin, out);
                out[3] = quad.dot1(&on_i.g(), &on_j.f()) - quad.dot1(&on_i.f(), &on_j.g());
            }
            Kind::Strut { on_i, s_j } => {
                out[0] = quad.dot2(&on_i.f(), &on_i.origin, s_j);
                out[1] = quad.dot2(&on_i.g(), &on_i.origin, s_j);
            }
            Kind::PointInPlane { on_i, s_j } => out[0] = quad.dot2(&on_i.h(), &on_i.origin, s_j),
            Kind::TranslationalDriver { on_i, s_j, driver } => {
                out[0] = quad.dot2(&on_i.h(), &on_i.origin, s_j) + drives[*driver].acceleration;
            }
            Kind::AxisDriver { s_j, axis, driver } => {
                let second = quad.j.a * quad.w_j.cross(&quad.w_j.cross(s_j));
                out[0] = drives[*driver].acceleration - second[*axis];
            }
        }
    }

    /// The point of body i (first) or j at which the reaction is stated, in the body frame. [m]
    #[must_use]
    pub fn point_on(&self, body_i: bool) -> Vector3<f64> {
        match (&self.kind, body_i) {
            (Kind::Ground { .. }, _) | (Kind::AxisDriver { .. }, true) => Vector3::zeros(),
            (Kind::Spherical { s_i, .. } | Kind::Distance { s_i, .. }, true) => *s_i,
            (
                Kind::Spherical { s_j, .. }
                | Kind::Distance { s_j, .. }
                | Kind::Strut { s_j, .. }
                | Kind::PointInPlane { s_j, .. }
                | Kind::TranslationalDriver { s_j, .. }
                | Kind::AxisDriver { s_j, .. },
                false,
            ) => *s_j,
            (
                Kind::Revolute { on_i, .. }
                | Kind::Translational { on_i, .. }
                | Kind::Cylindrical { on_i, .. }
                | Kind::Universal { on_i, .. }
                | Kind::ConstantVelocity { on_i, .. }
                | Kind::Strut { on_i, .. }
                | Kind::PointInPlane { on_i, .. }
                | Kind::TranslationalDriver { on_i, .. },
                true,
            ) => on_i.origin,
            (
                Kind::Revolute { on_j, .. }
                | Kind::Translational { on_j, .. }
                | Kind::Cylindrical { on_j, .. }
                | Kind::Universal { on_j, .. }
                | Kind::ConstantVelocity { on_j, .. },
                false,
            ) => on_j.origin,
        }
    }

    /// The joint axes C (columns f, g, h) on body i or j, in the body frame; the body's own where the
    /// constraint has no frame there.
    #[must_use]
    pub fn axes_on(&self, body_i: bool) -> Matrix3<f64> {
        match (&self.kind, body_i) {
            (
                Kind::Revolute { on_i, .. }
                | Kind::Translational { on_i, .. }
                | Kind::Cylindrical { on_i, .. }
                | Kind::Universal { on_i, .. }
                | Kind::ConstantVelocity { on_i, .. }
                | Kind::Strut { on_i, .. }
                | Kind::PointInPlane { on_i, .. }
                | Kind::TranslationalDriver { on_i, .. },
                true,
            ) => on_i.axes,
            (
                Kind::Revolute { on_j, .. }
                | Kind::Translational { on_j, .. }
                | Kind::Cylindrical { on_j, .. }
                | Kind::Universal { on_j, .. }
                | Kind::ConstantVelocity { on_j, .. },
                false,
            ) => on_j.axes,
            _ => Matrix3::identity(),
        }
    }
}

/// Position rows r − r₀ and attitude rows 2G(p₀)p, whose Jacobian is G(p₀)G(p)ᵀ: the identity when met.
fn ground(pose: &Pose, body: &Placed, out: &mut [Row]) {
    let d = body.r - pose.r;
    let zero = Vector3::zeros();
    let relative: EulerParameters = pose.p.relative_to(body.p);
    for k in 0..3 {
        let mut e = Vector3::zeros();
        e[k] = 1.0;
        out[k] = Row::new(d[k], zero, zero, e, zero);
        // Row k of G(p₀)G(p)ᵀ = δe0·I + δẽ with δ the relative attitude: e_kᵀ(δe0 x + δe × x).
        let pi = relative.e0 * e + e.cross(&relative.e);
        out[3 + k] = Row::new(2.0 * relative.e[k], zero, zero, zero, pi);
    }
}

/// Right sides of the basic rows' second derivatives.
struct Quadratic<'a> {
    i: &'a Placed,
    j: &'a Placed,
    w_i: Vector3<f64>,
    w_j: Vector3<f64>,
    v: Vector3<f64>,
}

impl Quadratic<'_> {
    /// ḋ.
    fn rate(&self, s_i: &Vector3<f64>, s_j: &Vector3<f64>) -> Vector3<f64> {
        self.v + self.j.a * self.w_j.cross(s_j) - self.i.a * self.w_i.cross(s_i)
    }

    /// The part of d̈ that is quadratic in the velocities: A_j ω̃'_j ω̃'_j s'_j − A_i ω̃'_i ω̃'_i s'_i.
    fn second(&self, s_i: &Vector3<f64>, s_j: &Vector3<f64>) -> Vector3<f64> {
        self.j.a * self.w_j.cross(&self.w_j.cross(s_j)) - self.i.a * self.w_i.cross(&self.w_i.cross(s_i))
    }

    fn coincide(&self, s_i: &Vector3<f64>, s_j: &Vector3<f64>, out: &mut [f64]) {
        let second = self.second(s_i, s_j);
        for k in 0..3 {
            out[k] = -second[k];
        }
    }

    fn dot1(&self, a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
        let (ga, gb) = (self.i.a * a, self.j.a * b);
        let (da, db) = (self.i.a * self.w_i.cross(a), self.j.a * self.w_j.cross(b));
        let dda = self.i.a * self.w_i.cross(&self.w_i.cross(a));
        let ddb = self.j.a * self.w_j.cross(&self.w_j.cross(b));
        -(dda.dot(&gb) + 2.0 * da.dot(&db) + ga.dot(&ddb))
    }

    fn dot2(&self, a: &Vector3<f64>, s_i: &Vector3<f64>, s_j: &Vector3<f64>) -> f64 {
        let d = self.j.point(s_j) - self.i.point(s_i);
        let ga = self.i.a * a;
        let da = self.i.a * self.w_i.cross(a);
        let dda = self.i.a * self.w_i.cross(&self.w_i.cross(a));
        -(dda.dot(&d) + 2.0 * da.dot(&self.rate(s_i, s_j)) + ga.dot(&self.second(s_i, s_j)))
    }
}

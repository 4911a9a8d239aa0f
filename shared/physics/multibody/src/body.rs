//! Bodies, their poses and velocities.
//!
//! A pose is the origin r (the centre of mass) in the global frame and the attitude p as unit Euler
//! parameters; six velocity coordinates: v = ṙ in the global frame, ω' in the body frame.

use spatial::{EulerParameters, Matrix3, Vector3};

/// A rigid body: its name and inertia. Massless bodies are allowed where no dynamics are asked for.
#[derive(Debug, Clone, PartialEq)]
pub struct Body {
    /// Name, for messages and descriptions.
    pub name: String,
    /// Mass. [kg], ≥ 0
    pub mass_kg: f64,
    /// Inertia about the origin (the centre of mass), in the body frame. [kg m²]
    pub inertia_kg_m2: Matrix3<f64>,
}

impl Body {
    /// A body without inertia.
    #[must_use]
    pub fn massless(name: &str) -> Self {
        Self { name: name.to_owned(), mass_kg: 0.0, inertia_kg_m2: Matrix3::zeros() }
    }
}

/// Position and attitude of a body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Origin in the global frame. [m]
    pub r: Vector3<f64>,
    /// Attitude, body frame to global frame.
    pub p: EulerParameters,
}

impl Pose {
    /// At the origin, not turned.
    pub const IDENTITY: Self = Self { r: Vector3::new(0.0, 0.0, 0.0), p: EulerParameters::IDENTITY };

    /// At `r`, not turned. [m]
    #[must_use]
    pub fn at(r: Vector3<f64>) -> Self {
        Self { r, p: EulerParameters::IDENTITY }
    }

    /// A body-fixed point in the global frame: r + A s'. [m]
    #[must_use]
    pub fn point(&self, s: &Vector3<f64>) -> Vector3<f64> {
        self.r + self.p.matrix() * s
    }

    /// A global point in the body frame: Aᵀ (x − r). [m]
    #[must_use]
    pub fn local(&self, x: &Vector3<f64>) -> Vector3<f64> {
        self.p.matrix().tr_mul(&(x - self.r))
    }

    /// Moved by δr (global) and δπ' (body-frame virtual rotation); the attitude is normalised.
    #[must_use]
    #[inline]
    pub fn moved(&self, dr: &Vector3<f64>, dpi: &Vector3<f64>) -> Self {
        Self { r: self.r + dr, p: self.p.turned(dpi) }
    }

    /// Whether every coordinate is finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.r.iter().all(|x| x.is_finite()) && self.p.is_finite()
    }

    /// The seven coordinates [r; p].
    #[must_use]
    pub fn to_array(&self) -> [f64; 7] {
        let p = self.p.to_array();
        [self.r.x, self.r.y, self.r.z, p[0], p[1], p[2], p[3]]
    }

    /// From the seven coordinates [r; p], as they are.
    #[must_use]
    pub fn from_array(q: [f64; 7]) -> Self {
        Self { r: Vector3::new(q[0], q[1], q[2]), p: EulerParameters::from_array([q[3], q[4], q[5], q[6]]) }
    }
}

/// Velocity (or acceleration) of a body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Twist {
    /// Of the origin, in the global frame. [m/s] or [m/s²]
    pub v: Vector3<f64>,
    /// Angular, in the body frame. [rad/s] or [rad/s²]
    pub omega: Vector3<f64>,
}

impl Twist {
    /// At rest.
    pub const ZERO: Self = Self { v: Vector3::new(0.0, 0.0, 0.0), omega: Vector3::new(0.0, 0.0, 0.0) };

    /// From the six coordinates [ṙ; ω'].
    #[must_use]
    pub fn from_slice(x: &[f64]) -> Self {
        Self { v: Vector3::new(x[0], x[1], x[2]), omega: Vector3::new(x[3], x[4], x[5]) }
    }
}

/// A pose with its rotation matrix at hand.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Placed {
    pub r: Vector3<f64>,
    pub a: Matrix3<f64>,
    pub p: EulerParameters,
    /// At the origin and not turned, as the car body is: points are what they are.
    pub still: bool,
}

impl Placed {
    #[inline]
    pub fn new(pose: &Pose) -> Self {
        Self { r: pose.r, a: pose.p.matrix(), p: pose.p, still: *pose == Pose::IDENTITY }
    }

    #[inline]
    pub fn point(&self, s: &Vector3<f64>) -> Vector3<f64> {
        self.r + self.a * s
    }
}

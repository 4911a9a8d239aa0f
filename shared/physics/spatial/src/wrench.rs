//! Force and moment together, about a stated point, expressed in one stated frame.

use nalgebra::{Matrix3, Vector3};

/// A force and a moment about the point and in the frame its holder states.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wrench {
    /// Force. [N]
    pub force_n: Vector3<f64>,
    /// Moment. [N m]
    pub moment_n_m: Vector3<f64>,
}

impl Wrench {
    /// No force, no moment.
    pub const ZERO: Self =
        Self { force_n: Vector3::new(0.0, 0.0, 0.0), moment_n_m: Vector3::new(0.0, 0.0, 0.0) };

    /// The same wrench about a point displaced by `offset` (from the old point to the new one). [m]
    #[must_use]
    pub fn about(self, offset: &Vector3<f64>) -> Self {
        Self { force_n: self.force_n, moment_n_m: self.moment_n_m - offset.cross(&self.force_n) }
    }

    /// The same wrench expressed in another frame, `rotation` taking this frame's vectors to it.
    #[must_use]
    pub fn expressed(self, rotation: &Matrix3<f64>) -> Self {
        Self { force_n: rotation * self.force_n, moment_n_m: rotation * self.moment_n_m }
    }
}

impl std::ops::Add for Wrench {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self { force_n: self.force_n + other.force_n, moment_n_m: self.moment_n_m + other.moment_n_m }
    }
}

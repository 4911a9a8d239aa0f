//! Unit Euler parameters p = [e0; e], e0 = cos(θ/2), e = sin(θ/2) u: attitude without a singular direction.
//!
//! A(p) = (2e0² − 1)I + 2(e eᵀ + e0 ẽ) takes body-frame vectors to the global frame [Haug 1989, eq. 9.3.9];
//! E = [−e, ẽ + e0 I], G = [−e, −ẽ + e0 I], A = E Gᵀ; ω' = 2 G ṗ, ṗ = ½ Gᵀ ω' with ω' in the body frame.
//! Valid for every attitude as long as pᵀp = 1 (the caller normalises after each update).

use nalgebra::{Matrix3, Matrix3x4, Vector3, Vector4};

/// Attitude of a body as unit Euler parameters, scalar first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EulerParameters {
    /// Scalar part cos(θ/2). [-], [-1, 1]
    pub e0: f64,
    /// Vector part sin(θ/2) u. [-], each in [-1, 1]
    pub e: Vector3<f64>,
}

impl EulerParameters {
    /// No rotation.
    pub const IDENTITY: Self = Self { e0: 1.0, e: Vector3::new(0.0, 0.0, 0.0) };

    /// From the four parameters, as they are (not normalised).
    #[must_use]
    pub fn from_array(p: [f64; 4]) -> Self {
        Self { e0: p[0], e: Vector3::new(p[1], p[2], p[3]) }
    }

    /// The four parameters, scalar first.
    #[must_use]
    pub fn to_array(self) -> [f64; 4] {
        [self.e0, self.e.x, self.e.y, self.e.z]
    }

    /// The four parameters with e0 ≥ 0: p and −p are the same attitude, this picks one of them.
    #[must_use]
    pub fn to_array_positive(self) -> [f64; 4] {
        if self.e0 < 0.0 { (-self).to_array() } else { self.to_array() }
    }

    /// As a column [e0; e].
    #[must_use]
    pub fn to_vector(self) -> Vector4<f64> {
        Vector4::new(self.e0, self.e.x, self.e.y, self.e.z)
    }

    /// Rotation by `angle_rad` about the unit vector `axis`.
    #[must_use]
    pub fn from_axis_angle(axis: &Vector3<f64>, angle_rad: f64) -> Self {
        let (s, c) = (0.5 * angle_rad).sin_cos();
        Self { e0: c, e: axis * s }
    }

    /// Rotation by the vector `phi` = θ u. [rad]
    #[must_use]
    pub fn from_rotation_vector(phi: &Vector3<f64>) -> Self {
        let angle = phi.norm();
        // sin(θ/2)/θ, by its series where the quotient would lose digits.
        let factor = if angle < 1e-4 { 0.5 - angle * angle / 48.0 } else { (0.5 * angle).sin() / angle };
        Self { e0: (0.5 * angle).cos(), e: phi * factor }.normalised()
    }

    /// The rotation vector θ u with θ in [0, π]. [rad]
    #[must_use]
    pub fn rotation_vector(self) -> Vector3<f64> {
        let p = if self.e0 < 0.0 { -self } else { self };
        let s = p.e.norm();
        let factor = if s < 1e-6 { 2.0 / p.e0 } else { 2.0 * s.atan2(p.e0) / s };
        p.e * factor
    }

    /// From a rotation matrix, by the largest of the four parameters [Shepperd 1978]. e0 ≥ 0.
    #[must_use]
    pub fn from_matrix(a: &Matrix3<f64>) -> Self {
        let trace = a.trace();
        let squares = [trace, a[(0, 0)], a[(1, 1)], a[(2, 2)]];
        let mut largest = 0;
        for k in 1..4 {
            if squares[k] > squares[largest] {
                largest = k;
            }
        }
        let (x, y, z) = (a[(2, 1)] - a[(1, 2)], a[(0, 2)] - a[(2, 0)], a[(1, 0)] - a[(0, 1)]);
        let (xy, xz, yz) = (a[(1, 0)] + a[(0, 1)], a[(0, 2)] + a[(2, 0)], a[(2, 1)] + a[(1, 2)]);
        let p = match largest {
            0 => Vector4::new(1.0 + trace, x, y, z),
            1 => Vector4::new(x, 1.0 + 2.0 * a[(0, 0)] - trace, xy, xz),
            2 => Vector4::new(y, xy, 1.0 + 2.0 * a[(1, 1)] - trace, yz),
            _ => Vector4::new(z, xz, yz, 1.0 + 2.0 * a[(2, 2)] - trace),
        };
        let p = p.normalize();
        let p = if p[0] < 0.0 { -p } else { p };
        Self { e0: p[0], e: Vector3::new(p[1], p[2], p[3]) }
    }

    /// pᵀp: 1 for a rotation.
    #[must_use]
    pub fn norm_squared(self) -> f64 {
        self.e0 * self.e0 + self.e.norm_squared()
    }

    /// Scaled to pᵀp = 1.
    #[must_use]
    pub fn normalised(self) -> Self {
        let scale = 1.0 / self.norm_squared().sqrt();
        Self { e0: self.e0 * scale, e: self.e * scale }
    }

    /// Rotation matrix A(p), body frame to global frame.
    #[must_use]
    #[inline]
    pub fn matrix(self) -> Matrix3<f64> {
        let (e0, e1, e2, e3) = (self.e0, self.e.x, self.e.y, self.e.z);
        let d = 2.0 * e0 * e0 - 1.0;
        Matrix3::new(
            d + 2.0 * e1 * e1,
            2.0 * (e1 * e2 - e0 * e3),
            2.0 * (e1 * e3 + e0 * e2),
            2.0 * (e1 * e2 + e0 * e3),
            d + 2.0 * e2 * e2,
            2.0 * (e2 * e3 - e0 * e1),
            2.0 * (e1 * e3 - e0 * e2),
            2.0 * (e2 * e3 + e0 * e1),
            d + 2.0 * e3 * e3,
        )
    }

    /// E = [−e, ẽ + e0 I].
    #[must_use]
    pub fn e_matrix(self) -> Matrix3x4<f64> {
        let (e0, e) = (self.e0, self.e);
        Matrix3x4::new(-e.x, e0, -e.z, e.y, -e.y, e.z, e0, -e.x, -e.z, -e.y, e.x, e0)
    }

    /// G = [−e, −ẽ + e0 I].
    #[must_use]
    pub fn g_matrix(self) -> Matrix3x4<f64> {
        let (e0, e) = (self.e0, self.e);
        Matrix3x4::new(-e.x, e0, e.z, -e.y, -e.y, -e.z, e0, e.x, -e.z, e.y, -e.x, e0)
    }

    /// ṗ = ½ Gᵀ ω' for the body-frame angular velocity ω'. [1/s] for [rad/s]
    #[must_use]
    #[inline]
    pub fn rate(self, omega: &Vector3<f64>) -> Self {
        Self { e0: -0.5 * self.e.dot(omega), e: 0.5 * (self.e0 * omega + self.e.cross(omega)) }
    }

    /// ω' = 2 G ṗ for the parameter rates `rate`. [rad/s]
    #[must_use]
    pub fn angular_velocity(self, rate: Self) -> Vector3<f64> {
        2.0 * (self.e0 * rate.e - rate.e0 * self.e - self.e.cross(&rate.e))
    }

    /// Updated by the body-frame virtual rotation δπ': p + ½Gᵀδπ', normalised. [rad]
    #[must_use]
    #[inline]
    pub fn turned(self, delta: &Vector3<f64>) -> Self {
        let rate = self.rate(delta);
        Self { e0: self.e0 + rate.e0, e: self.e + rate.e }.normalised()
    }

    /// The rotation of `other` as seen from this frame: A(result) = Aᵀ(self) A(other).
    #[must_use]
    pub fn relative_to(self, other: Self) -> Self {
        Self {
            e0: self.e0 * other.e0 + self.e.dot(&other.e),
            e: self.e0 * other.e - other.e0 * self.e - self.e.cross(&other.e),
        }
    }

    /// This rotation followed in its own frame by `next`: A(result) = A(self) A(next).
    #[must_use]
    pub fn then(self, next: Self) -> Self {
        Self {
            e0: self.e0 * next.e0 - self.e.dot(&next.e),
            e: self.e0 * next.e + next.e0 * self.e + self.e.cross(&next.e),
        }
    }

    /// Whether all four parameters are finite.
    #[must_use]
    pub fn is_finite(self) -> bool {
        self.to_array().iter().all(|e| e.is_finite())
    }
}

impl std::ops::Neg for EulerParameters {
    type Output = Self;
    fn neg(self) -> Self {
        Self { e0: -self.e0, e: -self.e }
    }
}

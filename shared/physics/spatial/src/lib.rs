//! Vectors, rotations, Euler parameters and frames.
//!
//! Frames are right-handed; vectors written with a prime (`s'`) are in a body's own frame, without one in
//! the global frame. `r^P = r + A s'^P` takes a point P of a body from the body's frame to the global one.
//! Rotations are unit Euler parameters p = [e0; e], scalar first [Haug 1989, ch. 9; Nikravesh 1988, ch. 6].
//! No small-angle assumption anywhere and no singular attitude.

// Units stand in brackets in every description; they are no links.
#![allow(rustdoc::broken_intra_doc_links)]

pub mod euler_parameters;
pub mod wrench;

pub use euler_parameters::EulerParameters;
pub use nalgebra::{Matrix3, Vector3};
pub use wrench::Wrench;

/// Skew matrix s̃ of `s`: s̃ x = s × x.
#[must_use]
pub fn skew(s: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::new(0.0, -s.z, s.y, s.z, 0.0, -s.x, -s.y, s.x, 0.0)
}

/// A right-handed orthonormal triad (columns f, g, h) whose third axis h is along `h`.
///
/// Returns `None` when `h` is too short (below 1e-12) or not finite: then there is no direction.
#[must_use]
pub fn triad_along(h: &Vector3<f64>) -> Option<Matrix3<f64>> {
    let length = h.norm();
    if !(length.is_finite() && length > 1e-12) {
        return None;
    }
    let h = h / length;
    // The global axis least aligned with h gives the best-conditioned cross product.
    let helper = if h.x.abs() <= h.y.abs() && h.x.abs() <= h.z.abs() {
        Vector3::x()
    } else if h.y.abs() <= h.z.abs() {
        Vector3::y()
    } else {
        Vector3::z()
    };
    let f = helper.cross(&h).normalize();
    Some(Matrix3::from_columns(&[f, h.cross(&f), h]))
}

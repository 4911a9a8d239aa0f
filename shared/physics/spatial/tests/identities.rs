//! The identities of the Euler parameters, and the rotations, over random attitudes.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use nalgebra::{Matrix3, Matrix4, Vector3};
use proptest::prelude::*;
use spatial::{EulerParameters, Wrench, skew, triad_along};

fn vector(limit: f64) -> impl Strategy<Value = Vector3<f64>> {
    [-limit..limit, -limit..limit, -limit..limit].prop_map(Vector3::from)
}

fn attitude() -> impl Strategy<Value = EulerParameters> {
    [-1.0..1.0f64, -1.0..1.0, -1.0..1.0, -1.0..1.0]
        .prop_filter("a direction", |p| p.iter().map(|x| x * x).sum::<f64>() > 1e-3)
        .prop_map(|p| EulerParameters::from_array(p).normalised())
}

proptest! {
    #[test]
    fn identities_of_e_and_g(p in attitude()) {
        let (e, g, v, a) = (p.e_matrix(), p.g_matrix(), p.to_vector(), p.matrix());
        let projector = Matrix4::identity() - v * v.transpose();
        prop_assert!((e * v).norm() < 1e-14 && (g * v).norm() < 1e-14);
        prop_assert!((e * e.transpose() - Matrix3::identity()).norm() < 1e-14);
        prop_assert!((g * g.transpose() - Matrix3::identity()).norm() < 1e-14);
        prop_assert!((e.transpose() * e - projector).norm() < 1e-14);
        prop_assert!((g.transpose() * g - projector).norm() < 1e-14);
        prop_assert!((e * g.transpose() - a).norm() < 1e-14);
        prop_assert!((a.transpose() * a - Matrix3::identity()).norm() < 1e-14);
        prop_assert!((a.determinant() - 1.0).abs() < 1e-14);
    }

    #[test]
    fn rates_and_body_angular_velocity(p in attitude(), omega in vector(5.0)) {
        let rate = p.rate(&omega);
        prop_assert!((p.angular_velocity(rate) - omega).norm() < 1e-13);
        prop_assert!((2.0 * p.g_matrix() * rate.to_vector() - omega).norm() < 1e-13);
        // E Ġᵀ = Ė Gᵀ: the two halves of Ȧ; and Ȧ = A ω̃'.
        let left = p.e_matrix() * rate.g_matrix().transpose();
        let right = rate.e_matrix() * p.g_matrix().transpose();
        prop_assert!((left - right).norm() < 1e-13);
        prop_assert!((left + right - p.matrix() * skew(&omega)).norm() < 1e-13);
    }

    #[test]
    fn turning_is_first_order_in_the_virtual_rotation(p in attitude(), delta in vector(1.0)) {
        let h = 1e-6;
        let turned = p.turned(&(delta * h)).matrix();
        let expected = p.matrix() * (Matrix3::identity() + skew(&(delta * h)));
        prop_assert!((turned - expected).norm() < 1e-11);
    }

    #[test]
    fn matrix_and_vector_round_trips(p in attitude(), phi in vector(1.8)) {
        prop_assert!((EulerParameters::from_matrix(&p.matrix()).matrix() - p.matrix()).norm() < 1e-13);
        let q = EulerParameters::from_rotation_vector(&phi);
        prop_assert!((q.rotation_vector() - phi).norm() < 1e-12);
        let tiny = phi * 1e-9;
        prop_assert!((EulerParameters::from_rotation_vector(&tiny).rotation_vector() - tiny).norm() < 1e-22);
    }

    #[test]
    fn relative_and_composed(p in attitude(), q in attitude()) {
        prop_assert!((p.relative_to(q).matrix() - p.matrix().transpose() * q.matrix()).norm() < 1e-13);
        prop_assert!((p.then(q).matrix() - p.matrix() * q.matrix()).norm() < 1e-13);
        prop_assert!((p.then(p.relative_to(q)).matrix() - q.matrix()).norm() < 1e-13);
    }

    #[test]
    fn triads_are_right_handed(h in vector(3.0)) {
        prop_assume!(h.norm() > 1e-6);
        let c = triad_along(&h).unwrap();
        prop_assert!((c.transpose() * c - Matrix3::identity()).norm() < 1e-13);
        prop_assert!((c.determinant() - 1.0).abs() < 1e-13);
        prop_assert!((c.column(2) - h.normalize()).norm() < 1e-13);
    }

    #[test]
    fn a_moved_wrench_does_the_same_virtual_work(
        f in vector(9.0), m in vector(9.0), offset in vector(2.0), v in vector(1.0), w in vector(1.0)
    ) {
        let wrench = Wrench { force_n: f, moment_n_m: m };
        let moved = wrench.about(&offset);
        let power = f.dot(&v) + m.dot(&w);
        let power_moved = f.dot(&(v + w.cross(&offset))) + moved.moment_n_m.dot(&w);
        prop_assert!((power - power_moved).abs() < 1e-11);
    }
}

#[test]
fn no_direction_no_triad() {
    assert!(triad_along(&Vector3::zeros()).is_none());
    assert!(triad_along(&Vector3::new(f64::NAN, 0.0, 1.0)).is_none());
}

//! One constraint of every kind with arbitrary geometry, and arbitrary poses: for the tests of the library.

use spatial::{EulerParameters, Matrix3, Vector3, triad_along};

use crate::body::Pose;
use crate::constraint::{Constraint, Frame, Kind};

/// An arbitrary number in [-1, 1], the same for the same arguments.
pub(crate) fn arbitrary(seed: u32, k: u32) -> f64 {
    (f64::from(seed) * 12.9898 + f64::from(k) * 78.233 + 0.7).sin()
}

pub(crate) fn arbitrary_vector(seed: u32, k: u32) -> Vector3<f64> {
    Vector3::new(arbitrary(seed, 3 * k), arbitrary(seed, 3 * k + 1), arbitrary(seed, 3 * k + 2))
}

pub(crate) fn wild_pose(seed: u32) -> Pose {
    let turn = 1.5 * arbitrary_vector(seed, 50);
    Pose { r: arbitrary_vector(seed, 51), p: EulerParameters::from_rotation_vector(&turn) }
}

fn frame(seed: u32, k: u32) -> Frame {
    let axes = triad_along(&(arbitrary_vector(seed, k) + Vector3::new(0.0, 0.0, 1.2)));
    Frame { origin: arbitrary_vector(seed, k + 1), axes: axes.unwrap_or_else(Matrix3::identity) }
}

/// Every kind once, between bodies 0 and 1; drivers 0 to 2.
pub(crate) fn samples(seed: u32) -> Vec<Constraint> {
    let (on_i, on_j) = (frame(seed, 0), frame(seed, 10));
    let (s_i, s_j) = (arbitrary_vector(seed, 20), arbitrary_vector(seed, 21));
    [
        Kind::Ground { pose: wild_pose(seed + 1000) },
        Kind::Spherical { s_i, s_j },
        Kind::Distance { s_i, s_j, length_m: 0.7 },
        Kind::Revolute { on_i, on_j },
        Kind::Translational { on_i, on_j },
        Kind::Cylindrical { on_i, on_j },
        Kind::Universal { on_i, on_j },
        Kind::ConstantVelocity { on_i, on_j },
        Kind::Strut { on_i, s_j },
        Kind::PointInPlane { on_i, s_j },
        Kind::TranslationalDriver { on_i, s_j, driver: 0 },
        Kind::AxisDriver { s_j, axis: (seed % 3) as usize, driver: 1 },
    ]
    .into_iter()
    .map(|kind| Constraint { name: kind.name().to_owned(), i: 0, j: 1, kind })
    .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::{Placed, Twist};
    use crate::constraint::{Drive, ROWS_MAX, Row};

    const H: f64 = 1e-4;

    /// Bodies on smooth paths with given velocity and acceleration at t = 0.
    struct Motion {
        pose: [Pose; 2],
        twist: [Twist; 2],
        acceleration: [Twist; 2],
    }

    impl Motion {
        fn new(seed: u32) -> Self {
            let twist =
                |k| Twist { v: arbitrary_vector(seed, k), omega: 1.5 * arbitrary_vector(seed, k + 1) };
            Self {
                pose: [wild_pose(seed), wild_pose(seed + 100)],
                twist: [twist(60), twist(62)],
                acceleration: [twist(64), twist(66)],
            }
        }

        fn at(&self, t: f64) -> [Placed; 2] {
            [0, 1].map(|b| {
                let (v, a) = (self.twist[b], self.acceleration[b]);
                let turn = v.omega * t + a.omega * (0.5 * t * t);
                let p = self.pose[b].p.then(EulerParameters::from_rotation_vector(&turn));
                Placed::new(&Pose { r: self.pose[b].r + v.v * t + a.v * (0.5 * t * t), p })
            })
        }
    }

    fn drives_at(t: f64) -> [Drive; 3] {
        [(0.3, 0.7, -1.1), (0.1, -0.4, 0.9), (0.0, 0.2, 0.5)].map(|(x, v, a)| Drive {
            value: x + v * t + 0.5 * a * t * t,
            speed: v + a * t,
            acceleration: a,
        })
    }

    fn phi(constraint: &Constraint, motion: &Motion, t: f64) -> Vec<f64> {
        let mut rows = [Row::ZERO; ROWS_MAX];
        let n = constraint.kind.rows();
        constraint.evaluate(&motion.at(t), &drives_at(t), &mut rows[..n]);
        rows[..n].iter().map(|row| row.phi).collect()
    }

    #[test]
    fn jacobian_nu_and_gamma_equal_finite_differences() {
        for seed in 0..60 {
            let motion = Motion::new(seed);
            for constraint in samples(seed) {
                let n = constraint.kind.rows();
                let mut rows = [Row::ZERO; ROWS_MAX];
                let (mut nu, mut gamma) = ([0.0; ROWS_MAX], [0.0; ROWS_MAX]);
                let (placed, drives) = (motion.at(0.0), drives_at(0.0));
                constraint.evaluate(&placed, &drives, &mut rows[..n]);
                constraint.velocity_right_side(&drives, &mut nu);
                constraint.acceleration_right_side(&placed, &motion.twist, &drives, &mut gamma);
                let [minus, zero, plus] = [-H, 0.0, H].map(|t| phi(&constraint, &motion, t));
                for r in 0..n {
                    let along = |x: &[Twist; 2]| -> f64 {
                        (0..2)
                            .map(|b| {
                                let jac = &rows[r].jac[6 * b..6 * b + 6];
                                (0..3).map(|k| jac[k] * x[b].v[k] + jac[3 + k] * x[b].omega[k]).sum::<f64>()
                            })
                            .sum()
                    };
                    // Φ̇ = Φ_q v − ν and Φ̈ = Φ_q a − γ.
                    let first = (plus[r] - minus[r]) / (2.0 * H);
                    let second = (plus[r] - 2.0 * zero[r] + minus[r]) / (H * H);
                    let name = constraint.kind.name();
                    let off = along(&motion.twist) - nu[r] - first;
                    assert!(off.abs() < 1e-6, "{name} row {r}: velocity off by {off:e}");
                    let off = along(&motion.acceleration) - gamma[r] - second;
                    assert!(off.abs() < 2e-5, "{name} row {r}: acceleration off by {off:e}");
                }
            }
        }
    }

    #[test]
    fn each_coordinate_of_each_jacobian_equals_its_difference() {
        let h = 1e-6;
        for seed in 0..40 {
            let poses = [wild_pose(seed), wild_pose(seed + 100)];
            for constraint in samples(seed) {
                let n = constraint.kind.rows();
                let evaluate = |poses: &[Pose; 2]| {
                    let mut rows = [Row::ZERO; ROWS_MAX];
                    constraint.evaluate(&poses.map(|p| Placed::new(&p)), &drives_at(0.0), &mut rows[..n]);
                    rows
                };
                let rows = evaluate(&poses);
                for column in 0..12 {
                    let moved = |sign: f64| {
                        let mut x = [0.0; 6];
                        x[column % 6] = sign * h;
                        let mut poses = poses;
                        poses[column / 6] = poses[column / 6]
                            .moved(&Vector3::new(x[0], x[1], x[2]), &Vector3::new(x[3], x[4], x[5]));
                        evaluate(&poses)
                    };
                    let (plus, minus) = (moved(1.0), moved(-1.0));
                    for r in 0..n {
                        let expected = (plus[r].phi - minus[r].phi) / (2.0 * h);
                        let off = rows[r].jac[column] - expected;
                        assert!(off.abs() < 2e-8, "{} [{r}][{column}]: {off:e}", constraint.kind.name());
                    }
                }
            }
        }
    }
}

//! Geometric stiffness ∂(Φ_qᵀλ)/∂q of a constraint: how its forces turn and shift as the bodies move.
//!
//! Rows and columns are [r_i, π'_i, r_j, π'_j]; rotations are body-frame virtual ones, so the matrix is not
//! symmetric. Composed from the same basic rows as the constraints; needed where forces and poses are
//! solved together (bushings), so that Newton stays quadratic.

use spatial::{Matrix3, Vector3, skew};

use crate::body::Placed;
use crate::constraint::{Constraint, Kind};

/// Stiffness in [r_i, π'_i, r_j, π'_j], row-major.
pub(crate) type Stiffness = [[f64; 12]; 12];

const R_I: usize = 0;
const PI_I: usize = 3;
const R_J: usize = 6;
const PI_J: usize = 9;

struct Sum<'a> {
    i: &'a Placed,
    j: &'a Placed,
    out: &'a mut Stiffness,
}

impl Sum<'_> {
    #[inline]
    fn add(&mut self, row: usize, column: usize, block: &Matrix3<f64>) {
        for r in 0..3 {
            for c in 0..3 {
                self.out[row + r][column + c] += block[(r, c)];
            }
        }
    }

    /// λᵀd: the force is constant, its moments turn.
    fn coincide(&mut self, s_i: &Vector3<f64>, s_j: &Vector3<f64>, lambda: &Vector3<f64>) {
        self.add(PI_I, PI_I, &(-skew(s_i) * skew(&self.i.a.tr_mul(lambda))));
        self.add(PI_J, PI_J, &(skew(s_j) * skew(&self.j.a.tr_mul(lambda))));
    }

    /// λ aᵢᵀbⱼ.
    fn dot1(&mut self, a: &Vector3<f64>, b: &Vector3<f64>, lambda: f64) {
        let (ga, gb) = (self.i.a * a, self.j.a * b);
        let (sa, sb) = (lambda * skew(a), lambda * skew(b));
        let cross = self.i.a.transpose() * self.j.a;
        self.add(PI_I, PI_I, &(sa * skew(&self.i.a.tr_mul(&gb))));
        self.add(PI_I, PI_J, &(-sa * cross * skew(b)));
        self.add(PI_J, PI_J, &(sb * skew(&self.j.a.tr_mul(&ga))));
        self.add(PI_J, PI_I, &(-sb * cross.transpose() * skew(a)));
    }

    /// λ aᵢᵀd.
    fn dot2(&mut self, a: &Vector3<f64>, s_i: &Vector3<f64>, s_j: &Vector3<f64>, lambda: f64) {
        let d = self.j.point(s_j) - self.i.point(s_i);
        let ga = self.i.a * a;
        let turn = lambda * (self.i.a * skew(a));
        self.add(R_I, PI_I, &turn);
        self.add(R_J, PI_I, &-turn);
        let sa = lambda * skew(a);
        let back = sa * self.i.a.transpose();
        self.add(PI_I, PI_I, &(sa * skew(&self.i.a.tr_mul(&d)) + sa * skew(s_i)));
        self.add(PI_I, R_I, &-back);
        self.add(PI_I, R_J, &back);
        self.add(PI_I, PI_J, &(-back * self.j.a * skew(s_j)));
        let sj = lambda * skew(s_j);
        self.add(PI_J, PI_J, &(sj * skew(&self.j.a.tr_mul(&ga))));
        self.add(PI_J, PI_I, &(-sj * self.j.a.transpose() * self.i.a * skew(a)));
    }

    /// λ dᵀd.
    fn distance(&mut self, s_i: &Vector3<f64>, s_j: &Vector3<f64>, lambda: f64) {
        let twice = 2.0 * lambda;
        let d = self.j.point(s_j) - self.i.point(s_i);
        // δd by column block.
        let turn_i = self.i.a * skew(s_i);
        let turn_j = self.j.a * skew(s_j);
        let columns =
            [(R_I, -Matrix3::identity()), (PI_I, turn_i), (R_J, Matrix3::identity()), (PI_J, -turn_j)];
        let (moment_i, moment_j) =
            (-twice * (skew(s_i) * self.i.a.transpose()), twice * (skew(s_j) * self.j.a.transpose()));
        for (column, delta) in columns {
            self.add(R_I, column, &(-twice * delta));
            self.add(R_J, column, &(twice * delta));
            self.add(PI_I, column, &(moment_i * delta));
            self.add(PI_J, column, &(moment_j * delta));
        }
        self.add(PI_I, PI_I, &(-twice * (skew(s_i) * skew(&self.i.a.tr_mul(&d)))));
        self.add(PI_J, PI_J, &(twice * (skew(s_j) * skew(&self.j.a.tr_mul(&d)))));
    }
}

/// ∂(Φ_qᵀλ)/∂q for the placed bodies and this constraint's multipliers.
pub(crate) fn geometric_stiffness(
    constraint: &Constraint,
    bodies: &[Placed],
    lambda: &[f64],
    out: &mut Stiffness,
) {
    *out = [[0.0; 12]; 12];
    let mut sum = Sum { i: &bodies[constraint.i], j: &bodies[constraint.j], out };
    let three = |at: usize| Vector3::new(lambda[at], lambda[at + 1], lambda[at + 2]);
    match &constraint.kind {
        Kind::Ground { pose } => {
            // Rows δe0 x + δe × x of the relative attitude δ, which itself turns with the body.
            let relative = pose.p.relative_to(bodies[constraint.j].p);
            let mu = three(3);
            let block = -0.5 * (mu * relative.e.transpose())
                + 0.5 * (skew(&mu) * (relative.e0 * Matrix3::identity() + skew(&relative.e)));
            sum.add(PI_J, PI_J, &block);
        }
        Kind::Spherical { s_i, s_j } => sum.coincide(s_i, s_j, &three(0)),
        Kind::Distance { s_i, s_j, .. } => sum.distance(s_i, s_j, lambda[0]),
        Kind::Revolute { on_i, on_j } => {
            sum.coincide(&on_i.origin, &on_j.origin, &three(0));
            sum.dot1(&on_i.f(), &on_j.h(), lambda[3]);
            sum.dot1(&on_i.g(), &on_j.h(), lambda[4]);
        }
        Kind::Translational { on_i, on_j } | Kind::Cylindrical { on_i, on_j } => {
            sum.dot1(&on_i.f(), &on_j.h(), lambda[0]);
            sum.dot1(&on_i.g(), &on_j.h(), lambda[1]);
            sum.dot2(&on_i.f(), &on_i.origin, &on_j.origin, lambda[2]);
            sum.dot2(&on_i.g(), &on_i.origin, &on_j.origin, lambda[3]);
            if constraint.kind.rows() == 5 {
                sum.dot1(&on_i.f(), &on_j.g(), lambda[4]);
            }
        }
        Kind::Universal { on_i, on_j } => {
            sum.coincide(&on_i.origin, &on_j.origin, &three(0));
            sum.dot1(&on_i.h(), &on_j.h(), lambda[3]);
        }
        Kind::ConstantVelocity { on_i, on_j } => {
            sum.coincide(&on_i.origin, &on_j.origin, &three(0));
            sum.dot1(&on_i.g(), &on_j.f(), lambda[3]);
            sum.dot1(&on_i.f(), &on_j.g(), -lambda[3]);
        }
        Kind::Strut { on_i, s_j } => {
            sum.dot2(&on_i.f(), &on_i.origin, s_j, lambda[0]);
            sum.dot2(&on_i.g(), &on_i.origin, s_j, lambda[1]);
        }
        Kind::PointInPlane { on_i, s_j } | Kind::TranslationalDriver { on_i, s_j, .. } => {
            sum.dot2(&on_i.h(), &on_i.origin, s_j, lambda[0]);
        }
        Kind::AxisDriver { s_j, axis, .. } => {
            let mut force = Vector3::zeros();
            force[*axis] = lambda[0];
            let block = skew(s_j) * skew(&sum.j.a.tr_mul(&force));
            sum.add(PI_J, PI_J, &block);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::Pose;
    use crate::constraint::{Drive, ROWS_MAX, Row};
    use crate::library_samples::{samples, wild_pose};

    #[test]
    fn equals_the_difference_of_the_constraint_forces() {
        for seed in 0..20 {
            for constraint in samples(seed) {
                let n = constraint.kind.rows();
                let lambda: Vec<f64> =
                    (0..n).map(|k| 1.3 * (k as f64 + 1.0 + f64::from(seed)).sin()).collect();
                let poses = [wild_pose(seed), wild_pose(seed + 100)];
                let forces = |poses: &[Pose; 2]| {
                    let placed = poses.map(|p| Placed::new(&p));
                    let mut rows = [Row::ZERO; ROWS_MAX];
                    constraint.evaluate(&placed, &[Drive::default(); 3], &mut rows[..n]);
                    let force = |k: usize| (0..n).map(|r| rows[r].jac[k] * lambda[r]).sum::<f64>();
                    std::array::from_fn::<f64, 12, _>(force)
                };
                let mut stiffness = [[0.0; 12]; 12];
                geometric_stiffness(&constraint, &poses.map(|p| Placed::new(&p)), &lambda, &mut stiffness);
                let h = 1e-6;
                for column in 0..12 {
                    let moved = |sign: f64| {
                        let mut poses = poses;
                        let mut x = [0.0; 6];
                        x[column % 6] = sign * h;
                        let body = column / 6;
                        poses[body] = poses[body]
                            .moved(&Vector3::new(x[0], x[1], x[2]), &Vector3::new(x[3], x[4], x[5]));
                        forces(&poses)
                    };
                    let (plus, minus) = (moved(1.0), moved(-1.0));
                    for row in 0..12 {
                        let expected = (plus[row] - minus[row]) / (2.0 * h);
                        let got = stiffness[row][column];
                        assert!(
                            (got - expected).abs() < 2e-8,
                            "{}: [{row}][{column}] {got} for {expected}",
                            constraint.kind.name()
                        );
                    }
                }
            }
        }
    }
}

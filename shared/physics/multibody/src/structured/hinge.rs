//! A body on a hinge with a fixed body, and one distance to an already placed one: a single unknown, the angle.
//!
//! Pose: turned by θ about the hinge from design, so the five rows of the hinge are met by construction.
//! Newton on the one row left, Φ'(θ) = j·t with j the row's Jacobian and t = [n × (r − o); Aᵀn] the body's
//! velocity per unit of θ̇ (n, o: the hinge's axis and a point of it). Reactions: the hinge does no work on t,
//! so the distance's multiplier is (Q·t)/(j·t); the rest falls on the hinge's rows, whose force part is the
//! identity and whose two moment rows are orthogonal.

use spatial::{EulerParameters, Vector3};

use super::block::along;
use crate::body::{Placed, Pose, Twist};
use crate::constraint::{Drive, Frame, Row};
use crate::failure::{Failure, Reason, Solved};
use crate::kinematics::Limits;
use crate::mechanism::Mechanism;

/// Smallest lever of the distance about the hinge, as a share of design's. [-]
const LEVER_MIN: f64 = 1e-9;

/// The hinged body, with what is constant.
#[derive(Debug, Clone)]
pub(super) struct Hinge {
    pub body: usize,
    pub revolute: usize,
    pub revolute_row: usize,
    pub tie: usize,
    pub tie_row: usize,
    /// Whether the body is j of the distance.
    is_j: bool,
    /// Unit axis and a point of it, global.
    axis: Vector3<f64>,
    point: Vector3<f64>,
    /// Design attitude, and origin from the point at design.
    attitude: EulerParameters,
    reach: Vector3<f64>,
    /// Axis in the body's frame.
    axis_in_body: Vector3<f64>,
    /// Φ' at design.
    slope: f64,
    /// Centre of the hinge in the body's frame; the base's other two joint axes, global.
    centre: Vector3<f64>,
    across: [Vector3<f64>; 2],
}

impl Hinge {
    pub fn new(
        body: usize,
        (revolute, revolute_row): (usize, usize),
        (tie, tie_row): (usize, usize),
        is_j: bool,
        base: &Pose,
        design: &Pose,
        [on_base, on_body]: [&Frame; 2],
    ) -> Self {
        let axis = base.p.matrix() * on_base.h();
        let point = base.point(&on_base.origin);
        Self {
            body,
            revolute,
            revolute_row,
            tie,
            tie_row,
            is_j,
            axis,
            point,
            attitude: design.p,
            reach: design.r - point,
            axis_in_body: design.p.matrix().tr_mul(&axis),
            slope: 1.0,
            centre: on_body.origin,
            across: [base.p.matrix() * on_base.f(), base.p.matrix() * on_base.g()],
        }
    }

    /// The hinge's rows at the pose at hand. All but their part in the body's rotation is as at design, and Φ is 0
    /// by construction.
    #[inline]
    pub fn turn_rows(&self, placed: &[Placed], rows: &mut [Row]) {
        let a = &placed[self.body].a;
        let mut set = |r: usize, pi: Vector3<f64>| {
            rows[self.revolute_row + r].jac[9..].copy_from_slice(pi.as_slice());
        };
        for k in 0..3 {
            set(k, self.centre.cross(&a.row(k).transpose()));
        }
        for (k, across) in self.across.iter().enumerate() {
            set(3 + k, self.axis_in_body.cross(&a.tr_mul(across)));
        }
    }

    /// Notes the design's slope; `None` where the distance has no lever about the hinge.
    pub fn set_design(&mut self, mechanism: &Mechanism, placed: &[Placed], drives: &[Drive]) -> Option<()> {
        let mut row = [Row::ZERO];
        mechanism.constraints()[self.tie].evaluate(placed, drives, &mut row);
        self.slope = along(self.half(&row[0]), &self.unit_twist(&placed[self.body]));
        (self.slope.abs() > 1e-6).then_some(())
    }

    /// The row's Jacobian in the body's coordinates.
    #[inline]
    fn half<'a>(&self, row: &'a Row) -> &'a [f64] {
        if self.is_j { &row.jac[6..] } else { &row.jac[..6] }
    }

    /// Velocity of the body per unit of angular velocity about the hinge.
    #[inline]
    fn unit_twist(&self, placed: &Placed) -> Twist {
        Twist { v: self.axis.cross(&(placed.r - self.point)), omega: self.axis_in_body }
    }

    /// Half-angle cosine and sine of the turn from design nearest to a pose.
    #[inline]
    fn half_angle(&self, pose: &Pose) -> (f64, f64) {
        // The turn in the global frame is p p₀*.
        let (p, q) = (pose.p, self.attitude);
        let e0 = p.e0 * q.e0 + p.e.dot(&q.e);
        let e = q.e0 * p.e - p.e0 * q.e - p.e.cross(&q.e);
        (e0, e.dot(&self.axis))
    }

    #[inline]
    fn pose(&self, c: f64, s: f64) -> Pose {
        let turn = EulerParameters { e0: c, e: self.axis * s };
        Pose { r: self.point + turn.matrix() * self.reach, p: turn.then(self.attitude) }
    }

    fn singular(&self, reason: Reason, iterations: u32, residual: f64) -> Failure {
        Failure { reason, constraint: Some(self.tie), iterations, residual }
    }

    pub fn position(
        &mut self,
        mechanism: &Mechanism,
        poses: &mut [Pose],
        placed: &mut [Placed],
        rows: &mut [Row],
        drives: &[Drive],
        limits: &Limits,
    ) -> Result<Solved, Failure> {
        let (mut c, mut s) = self.half_angle(&poses[self.body]);
        let (mut step, mut iterations) = (f64::INFINITY, 0);
        loop {
            let scale = 1.0 / (c * c + s * s).sqrt();
            (c, s) = (c * scale, s * scale);
            poses[self.body] = self.pose(c, s);
            placed[self.body] = Placed::new(&poses[self.body]);
            let row = &mut rows[self.tie_row..=self.tie_row];
            mechanism.constraints()[self.tie].evaluate(placed, drives, row);
            let residual = row[0].phi.abs();
            if !residual.is_finite() {
                return Err(self.singular(Reason::OutOfReach, iterations, f64::MAX));
            }
            let slope = along(self.half(&row[0]), &self.unit_twist(&placed[self.body]));
            if residual <= limits.phi && (step <= limits.step || residual <= Limits::PHI_NOTHING) {
                if (slope > 0.0) != (self.slope > 0.0) {
                    return Err(self.singular(Reason::WrongBranch, iterations, residual));
                }
                return Ok(Solved { iterations, residual });
            }
            if iterations == limits.iterations {
                return Err(self.singular(Reason::OutOfReach, iterations, residual));
            }
            if !(slope.abs() > LEVER_MIN * self.slope.abs()) {
                return Err(self.singular(Reason::Singular, iterations, residual));
            }
            let turn = -row[0].phi / slope;
            iterations += 1;
            step = turn.abs();
            if !(step <= limits.step_max) {
                return Err(self.singular(Reason::OutOfReach, iterations, residual));
            }
            (c, s) = (c - 0.5 * turn * s, s + 0.5 * turn * c);
        }
    }

    /// θ̇ from the row at the pose at hand.
    pub fn velocity(
        &self,
        mechanism: &Mechanism,
        rows: &[Row],
        placed: &[Placed],
        twists: &mut [Twist],
    ) -> Result<(), Failure> {
        let row = &rows[self.tie_row];
        let constraint = &mechanism.constraints()[self.tie];
        let other = if self.is_j { &twists[constraint.i] } else { &twists[constraint.j] };
        let theirs = along(if self.is_j { &row.jac[..6] } else { &row.jac[6..] }, other);
        let unit = self.unit_twist(&placed[self.body]);
        let slope = along(self.half(row), &unit);
        if !(slope.abs() > LEVER_MIN * self.slope.abs()) {
            return Err(self.singular(Reason::Singular, 0, 0.0));
        }
        let rate = -theirs / slope;
        twists[self.body] = Twist { v: unit.v * rate, omega: unit.omega * rate };
        Ok(())
    }

    /// Multipliers of distance and hinge, and what they leave to the other bodies.
    pub fn reactions(
        &self,
        mechanism: &Mechanism,
        placed: &[Placed],
        rows: &[Row],
        load: &mut [f64],
        lambda: &mut [f64],
    ) -> Result<(), Failure> {
        let tie = &rows[self.tie_row];
        let own = self.half(tie);
        let unit = self.unit_twist(&placed[self.body]);
        let slope = along(own, &unit);
        if !(slope.abs() > LEVER_MIN * self.slope.abs()) {
            return Err(self.singular(Reason::Singular, 0, 0.0));
        }
        let mut left = [0.0; 6];
        left.copy_from_slice(&load[6 * self.body..6 * self.body + 6]);
        let pull = along(&left, &unit) / slope;
        lambda[self.tie_row] = pull;
        for k in 0..6 {
            left[k] -= own[k] * pull;
        }
        // The hinge: its body is j.
        let hinge = &rows[self.revolute_row..self.revolute_row + 5];
        let mut multipliers = [left[0], left[1], left[2], 0.0, 0.0];
        for (row, force) in hinge.iter().zip(&multipliers[..3]) {
            for k in 3..6 {
                left[k] -= row.jac[6 + k] * force;
            }
        }
        for r in 3..5 {
            let turn = &hinge[r].jac[9..];
            let size = turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2];
            multipliers[r] = (left[3] * turn[0] + left[4] * turn[1] + left[5] * turn[2]) / size;
        }
        lambda[self.revolute_row..self.revolute_row + 5].copy_from_slice(&multipliers);
        let constraint = &mechanism.constraints()[self.tie];
        let (other, offset) = if self.is_j { (constraint.i, 0) } else { (constraint.j, 6) };
        let base = mechanism.constraints()[self.revolute].i;
        for k in 0..6 {
            load[6 * other + k] -= tie.jac[offset + k] * pull;
            for (row, x) in hinge.iter().zip(&multipliers) {
                load[6 * base + k] -= row.jac[k] * x;
            }
        }
        Ok(())
    }
}

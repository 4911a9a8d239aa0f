//! A set of bodies that their constraints place together: a small dense system.
//!
//! Newton with the exact Jacobian at the first step; where that step was short, its factors serve for the next
//! one too (chord step), whose result is then accepted only if what is left of Φ is rounding.

use spatial::Vector3;

use crate::body::{Placed, Pose, Twist};
use crate::constraint::{Drive, ROWS_MAX, Row};
use crate::failure::{Failure, Reason, Solved};
use crate::kinematics::Limits;
use crate::linear::DenseLu;
use crate::mechanism::Mechanism;

/// After a step no longer than this its factors serve for the next one. [m or rad]
const CHORD_STEP: f64 = 1e-3;
/// Largest |Φ| that is accepted after a chord step: the error left is no longer the square of the step.
const CHORD_PHI: f64 = 1e-14;
/// Factors of a pose further away are not corrected but made again for the velocities. [m or rad]
const AWAY_MAX: f64 = 1e-4;

/// A block's constraint, its first row, its rows, and the block-local first column of bodies i and j.
pub(super) type Member = (usize, usize, usize, Option<usize>, Option<usize>);

/// Bodies placed together, and the constraints that place them.
#[derive(Debug, Clone)]
pub(super) struct Block {
    pub bodies: Vec<usize>,
    pub constraints: Vec<Member>,
    pub lu: DenseLu,
    pub rhs: Vec<f64>,
    /// Right side of the velocities: drivers and placed bodies.
    pub given: Vec<f64>,
    pub design_positive: bool,
    /// Whether the factors at hand are those of a Newton step of the pose at hand.
    pub factored: bool,
    /// Distance of the pose of those factors from the one at hand. [m or rad]
    pub away: f64,
}

impl Block {
    /// Jacobian of the block's rows in its own bodies' coordinates.
    #[inline]
    pub fn fill(&mut self, rows: &[Row]) {
        let n = 6 * self.bodies.len();
        let matrix = self.lu.matrix_mut();
        if n == 6 {
            // One body: each row is its half of the constraint's.
            let (mut to, _) = matrix.as_chunks_mut::<6>();
            for &(_, first, count, on_i, _) in &self.constraints {
                let (now, rest) = std::mem::take(&mut to).split_at_mut(count);
                to = rest;
                for (to, row) in now.iter_mut().zip(&rows[first..first + count]) {
                    let (halves, _) = row.jac.as_chunks::<6>();
                    *to = halves[usize::from(on_i.is_none())];
                }
            }
            return;
        }
        matrix.fill(0.0);
        let mut at = 0;
        for &(_, first, count, on_i, on_j) in &self.constraints {
            for row in &rows[first..first + count] {
                let to = &mut matrix[at * n..(at + 1) * n];
                if let Some(column) = on_i {
                    to[column..column + 6].copy_from_slice(&row.jac[..6]);
                }
                if let Some(column) = on_j {
                    to[column..column + 6].copy_from_slice(&row.jac[6..]);
                }
                at += 1;
            }
        }
    }

    fn constraint_of_local_row(&self, local: usize) -> Option<usize> {
        let mut at = 0;
        for &(constraint, _, count, _, _) in &self.constraints {
            at += count;
            if local < at {
                return Some(constraint);
            }
        }
        None
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
        let failure =
            |reason, constraint, iterations, residual| Failure { reason, constraint, iterations, residual };
        let mut step = f64::INFINITY;
        let mut iterations = 0;
        self.factored = false;
        self.away = 0.0;
        let mut chord = false;
        loop {
            for &body in &self.bodies {
                placed[body] = Placed::new(&poses[body]);
            }
            let (mut residual, mut worst, mut at) = (0.0, None, 0);
            for &(c, first, count, _, _) in &self.constraints {
                mechanism.constraints()[c].evaluate(placed, drives, &mut rows[first..first + count]);
                for row in &rows[first..first + count] {
                    self.rhs[at] = -row.phi;
                    at += 1;
                    // Negated so that NaN is the worst of all.
                    if !(row.phi.abs() <= residual) {
                        (residual, worst) = (row.phi.abs(), Some(c));
                    }
                }
            }
            if !residual.is_finite() {
                return Err(failure(Reason::OutOfReach, worst, iterations, f64::MAX));
            }
            let phi = if chord { CHORD_PHI } else { limits.phi };
            if residual <= phi && (step <= limits.step || residual <= Limits::PHI_NOTHING) {
                if self.factored && self.lu.determinant_positive() != self.design_positive {
                    return Err(failure(Reason::WrongBranch, worst, iterations, residual));
                }
                return Ok(Solved { iterations, residual });
            }
            if iterations == limits.iterations {
                return Err(failure(Reason::OutOfReach, worst, iterations, residual));
            }
            chord = self.factored && !chord && step <= CHORD_STEP;
            if !chord {
                self.fill(rows);
                if let Err(singular) = self.lu.factor() {
                    let constraint = self.constraint_of_local_row(singular.0);
                    return Err(failure(Reason::Singular, constraint, iterations, residual));
                }
                self.factored = true;
                self.away = 0.0;
            }
            self.lu.solve(&mut self.rhs);
            iterations += 1;
            step = self.rhs.iter().fold(0.0, |m, x| if x.abs() <= m { m } else { x.abs() });
            if !(step <= limits.step_max) {
                return Err(failure(Reason::OutOfReach, worst, iterations, residual));
            }
            self.away += step;
            for (&body, x) in self.bodies.iter().zip(self.rhs.chunks_exact(6)) {
                let (dr, dpi) = (Vector3::new(x[0], x[1], x[2]), Vector3::new(x[3], x[4], x[5]));
                poses[body] = poses[body].moved(&dr, &dpi);
            }
        }
    }

    pub fn velocity(
        &mut self,
        mechanism: &Mechanism,
        rows: &[Row],
        drives: &[Drive],
        fresh: bool,
        twists: &mut [Twist],
    ) -> Result<(), Failure> {
        let exact = fresh || !self.factored || self.away > AWAY_MAX;
        if exact {
            self.fill(rows);
            self.lu.factor().map_err(|singular| Failure {
                reason: Reason::Singular,
                constraint: self.constraint_of_local_row(singular.0),
                iterations: 0,
                residual: 0.0,
            })?;
            // These are not the factors of a Newton step.
            self.factored = false;
        }
        // ν less what the placed bodies' velocities contribute; then twice more for what is left of it, as
        // the factors may be those of the step before (each pass takes its error to the next power).
        for &body in &self.bodies {
            twists[body] = Twist::ZERO;
        }
        let mut at = 0;
        let mut nu = [0.0; ROWS_MAX];
        for &(c, first, count, on_i, on_j) in &self.constraints {
            let constraint = &mechanism.constraints()[c];
            constraint.velocity_right_side(drives, &mut nu);
            let (i, j) = (&twists[constraint.i], &twists[constraint.j]);
            let placed_i = on_i.is_none() && !constraint.kind.is_absolute();
            for (row, nu) in rows[first..first + count].iter().zip(&nu) {
                let of_i = if placed_i { along(&row.jac[..6], i) } else { 0.0 };
                let of_j = if on_j.is_none() { along(&row.jac[6..], j) } else { 0.0 };
                self.given[at] = nu - of_i - of_j;
                at += 1;
            }
        }
        for pass in 0..if exact { 1 } else { 3 } {
            self.rhs.copy_from_slice(&self.given);
            let mut at = 0;
            for &(c, first, count, on_i, on_j) in self.constraints.iter().filter(|_| pass > 0) {
                let constraint = &mechanism.constraints()[c];
                let (i, j) = (&twists[constraint.i], &twists[constraint.j]);
                for row in &rows[first..first + count] {
                    if on_i.is_some() {
                        self.rhs[at] -= along(&row.jac[..6], i);
                    }
                    if on_j.is_some() {
                        self.rhs[at] -= along(&row.jac[6..], j);
                    }
                    at += 1;
                }
            }
            self.lu.solve(&mut self.rhs);
            for (&body, x) in self.bodies.iter().zip(self.rhs.chunks_exact(6)) {
                let add = Twist::from_slice(x);
                twists[body] = Twist { v: twists[body].v + add.v, omega: twists[body].omega + add.omega };
            }
        }
        Ok(())
    }

    pub fn reactions(
        &mut self,
        mechanism: &Mechanism,
        rows: &[Row],
        load: &mut [f64],
        lambda: &mut [f64],
    ) -> Result<(), Failure> {
        self.fill(rows);
        self.lu.factor().map_err(|singular| Failure {
            reason: Reason::Singular,
            constraint: self.constraint_of_local_row(singular.0),
            iterations: 0,
            residual: 0.0,
        })?;
        self.factored = false;
        self.pass_on(mechanism, rows, load, lambda);
        Ok(())
    }

    /// λ of this block with the factors at hand, and what its constraints leave to bodies of earlier parts.
    pub fn pass_on(&mut self, mechanism: &Mechanism, rows: &[Row], load: &mut [f64], lambda: &mut [f64]) {
        for (&body, x) in self.bodies.iter().zip(self.rhs.chunks_exact_mut(6)) {
            x.copy_from_slice(&load[6 * body..6 * body + 6]);
        }
        self.lu.solve_transposed(&mut self.rhs);
        let mut at = 0;
        for &(c, first, count, on_i, on_j) in &self.constraints {
            lambda[first..first + count].copy_from_slice(&self.rhs[at..at + count]);
            at += count;
            let constraint = &mechanism.constraints()[c];
            for (body, own, offset) in [(constraint.i, on_i, 0), (constraint.j, on_j, 6)] {
                if own.is_some() || (offset == 0 && constraint.kind.is_absolute()) {
                    continue;
                }
                for r in first..first + count {
                    for k in 0..6 {
                        load[6 * body + k] -= rows[r].jac[offset + k] * lambda[r];
                    }
                }
            }
        }
    }
}

/// Row times a body's velocity.
#[inline]
pub(super) fn along(jac: &[f64], twist: &Twist) -> f64 {
    let (v, w) = (&twist.v, &twist.omega);
    jac[0] * v.x + jac[1] * v.y + jac[2] * v.z + jac[3] * w.x + jac[4] * w.y + jac[5] * w.z
}

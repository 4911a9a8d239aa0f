//! Forward dynamics: the augmented equations of motion, stabilised, and their integration.
//!
//! [M Φ_qᵀ; Φ_q 0][a; λ] = [Q − ω̃'J'ω'; γ] [Haug 1989, eq. 11.2.23 in body-frame rotations], integrated with the
//! classical Runge–Kutta method of fourth order at a fixed step. The drift of an index-1 formulation off
//! the constraints is taken back by projection after each step (mass-weighted least change of positions,
//! then of velocities) or damped by Baumgarte's terms −2αΦ̇ − β²Φ. Error of a step: h⁵. Not stiff-stable.

use spatial::Vector3;

use crate::body::{Pose, Twist};
use crate::constraint::{Drive, Row};
use crate::failure::{Failure, Reason};
use crate::linear::{DenseLu, SingularRow};
use crate::mechanism::Mechanism;

/// How the motion is kept on the constraints.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Stabilisation {
    /// Not at all.
    None,
    /// −2αΦ̇ − β²Φ on the right side. [1/s]
    Baumgarte {
        /// α.
        alpha: f64,
        /// β.
        beta: f64,
    },
    /// Projection after each step.
    Projection,
}

/// Most projection passes a step.
const PASSES: usize = 4;
/// Largest |Φ| after projection. [m, m²]
const PHI: f64 = 1e-12;

/// Bodies in motion, with the workspace of their equations.
#[derive(Debug, Clone)]
pub struct Dynamics {
    mechanism: Mechanism,
    /// First coordinate of each body; `None` for those that stand still.
    column: Vec<Option<usize>>,
    /// First row of each constraint among the equations; `None` between bodies that stand still.
    equation: Vec<Option<usize>>,
    coordinates: usize,
    order: usize,
    stabilisation: Stabilisation,
    gravity: Vector3<f64>,
    lu: DenseLu,
    rows: Vec<Row>,
    gamma: Vec<f64>,
    rhs: Vec<f64>,
    poses: Vec<Pose>,
    twists: Vec<Twist>,
}

impl Dynamics {
    /// Bodies without mass and inertia must be among `standing`. Gravity in the global frame. [m/s²]
    #[must_use]
    pub fn new(
        mechanism: Mechanism,
        poses: Vec<Pose>,
        twists: Vec<Twist>,
        standing: &[usize],
        gravity: Vector3<f64>,
        stabilisation: Stabilisation,
    ) -> Self {
        let mut coordinates = 0;
        let column: Vec<Option<usize>> = (0..poses.len())
            .map(|body| {
                (!standing.contains(&body)).then(|| {
                    coordinates += 6;
                    coordinates - 6
                })
            })
            .collect();
        let mut order = coordinates;
        let equation = mechanism
            .constraints()
            .iter()
            .map(|c| {
                let moves = column[c.j].is_some() || (!c.kind.is_absolute() && column[c.i].is_some());
                moves.then(|| {
                    order += c.kind.rows();
                    order - c.kind.rows()
                })
            })
            .collect();
        Self {
            column,
            equation,
            coordinates,
            order,
            stabilisation,
            gravity,
            lu: DenseLu::new(order),
            rows: vec![Row::ZERO; mechanism.rows()],
            gamma: vec![0.0; mechanism.rows()],
            rhs: vec![0.0; order],
            mechanism,
            poses,
            twists,
        }
    }

    /// The poses.
    #[must_use]
    pub fn poses(&self) -> &[Pose] {
        &self.poses
    }

    /// The velocities.
    #[must_use]
    pub fn twists(&self) -> &[Twist] {
        &self.twists
    }

    /// Kinetic and potential energy. [J]
    #[must_use]
    pub fn energy_j(&self) -> f64 {
        let of_body = |b: usize| {
            let (body, twist) = (&self.mechanism.bodies()[b], &self.twists[b]);
            let kinetic = 0.5 * body.mass_kg * twist.v.norm_squared()
                + 0.5 * twist.omega.dot(&(body.inertia_kg_m2 * twist.omega));
            kinetic - body.mass_kg * self.gravity.dot(&self.poses[b].r)
        };
        (0..self.poses.len()).filter(|b| self.column[*b].is_some()).map(of_body).sum()
    }

    /// Largest |Φ| at the present poses. [m or m² or -]
    #[must_use]
    pub fn violation(&self) -> f64 {
        let mut rows = self.rows.clone();
        self.mechanism.evaluate(&self.poses, &[], &mut rows);
        rows.iter().fold(0.0, |m, row| m.max(row.phi.abs()))
    }

    fn singular(&self, row: SingularRow) -> Failure {
        let at = |first: &Option<usize>| first.is_some_and(|first| first <= row.0);
        let constraint = if row.0 >= self.coordinates { self.equation.iter().rposition(at) } else { None };
        Failure { reason: Reason::Singular, constraint, iterations: 0, residual: 0.0 }
    }

    /// Fills and factors the augmented matrix at `poses`.
    fn factor(&mut self, poses: &[Pose]) -> Result<(), Failure> {
        self.mechanism.evaluate(poses, &[], &mut self.rows);
        let n = self.order;
        let matrix = self.lu.matrix_mut();
        matrix.fill(0.0);
        for (b, body) in self.mechanism.bodies().iter().enumerate() {
            let Some(at) = self.column[b] else { continue };
            for k in 0..3 {
                matrix[(at + k) * n + at + k] = body.mass_kg;
                for l in 0..3 {
                    matrix[(at + 3 + k) * n + at + 3 + l] = body.inertia_kg_m2[(k, l)];
                }
            }
        }
        for (c, constraint) in self.mechanism.constraints().iter().enumerate() {
            let Some(equation) = self.equation[c] else { continue };
            let first = self.mechanism.first_row(c);
            let absolute = constraint.kind.is_absolute();
            let on = [if absolute { None } else { self.column[constraint.i] }, self.column[constraint.j]];
            for r in 0..constraint.kind.rows() {
                for (half, at) in on.iter().enumerate() {
                    let Some(at) = at else { continue };
                    for k in 0..6 {
                        let x = self.rows[first + r].jac[6 * half + k];
                        matrix[(equation + r) * n + at + k] = x;
                        matrix[(at + k) * n + equation + r] = x;
                    }
                }
            }
        }
        self.lu.factor().map_err(|row| self.singular(row))
    }

    /// Φ_q v of an equation's row.
    fn rate(&self, c: usize, r: usize, twists: &[Twist]) -> f64 {
        let constraint = &self.mechanism.constraints()[c];
        let row = &self.rows[self.mechanism.first_row(c) + r];
        let along =
            |jac: &[f64], t: &Twist| (0..3).map(|k| jac[k] * t.v[k] + jac[3 + k] * t.omega[k]).sum::<f64>();
        let own = along(&row.jac[6..], &twists[constraint.j]);
        if constraint.kind.is_absolute() { own } else { own + along(&row.jac[..6], &twists[constraint.i]) }
    }

    /// Accelerations for poses and velocities; multipliers stay in the workspace.
    fn accelerate(&mut self, poses: &[Pose], twists: &[Twist], out: &mut [Twist]) -> Result<(), Failure> {
        self.factor(poses)?;
        self.mechanism.acceleration_right_side(poses, twists, &[], &mut self.gamma);
        for (b, body) in self.mechanism.bodies().iter().enumerate() {
            let Some(at) = self.column[b] else { continue };
            let w = twists[b].omega;
            let (force, moment) = (body.mass_kg * self.gravity, -w.cross(&(body.inertia_kg_m2 * w)));
            for k in 0..3 {
                self.rhs[at + k] = force[k];
                self.rhs[at + 3 + k] = moment[k];
            }
        }
        for c in 0..self.equation.len() {
            let Some(equation) = self.equation[c] else { continue };
            let first = self.mechanism.first_row(c);
            for r in 0..self.mechanism.constraints()[c].kind.rows() {
                self.rhs[equation + r] = self.gamma[first + r];
                if let Stabilisation::Baumgarte { alpha, beta } = self.stabilisation {
                    let rate = self.rate(c, r, twists);
                    self.rhs[equation + r] -= 2.0 * alpha * rate + beta * beta * self.rows[first + r].phi;
                }
            }
        }
        self.lu.solve(&mut self.rhs);
        for (twist, column) in out.iter_mut().zip(&self.column) {
            *twist = column.map_or(Twist::ZERO, |at| Twist::from_slice(&self.rhs[at..at + 6]));
        }
        Ok(())
    }

    /// One step of `h` seconds. Allocates; for analyses off the tick.
    ///
    /// # Errors
    /// Singular constraints, with the constraint's index.
    pub fn step(&mut self, h: f64) -> Result<(), Failure> {
        let (start, speed) = (self.poses.clone(), self.twists.clone());
        let moved = |rate: &[Twist], at: &[Pose], h: f64| -> Vec<Pose> {
            let one = |b: usize| {
                let p_rate = at[b].p.rate(&rate[b].omega);
                let p = spatial::EulerParameters {
                    e0: start[b].p.e0 + h * p_rate.e0,
                    e: start[b].p.e + h * p_rate.e,
                };
                Pose { r: start[b].r + h * rate[b].v, p }
            };
            (0..start.len()).map(one).collect()
        };
        let faster = |a: &[Twist], h: f64| -> Vec<Twist> {
            let one = |b: usize| Twist { v: speed[b].v + h * a[b].v, omega: speed[b].omega + h * a[b].omega };
            (0..start.len()).map(one).collect()
        };
        let mut a = vec![vec![Twist::ZERO; start.len()]; 4];
        let (mut q, mut v) = (vec![start.clone()], vec![speed.clone()]);
        for stage in 0..4 {
            let (at, rate) = (q[stage].clone(), v[stage].clone());
            let unit: Vec<Pose> = at.iter().map(|pose| Pose { r: pose.r, p: pose.p.normalised() }).collect();
            self.accelerate(&unit, &rate, &mut a[stage])?;
            if stage < 3 {
                let part = [0.5, 0.5, 1.0][stage] * h;
                q.push(moved(&rate, &at, part));
                v.push(faster(&a[stage], part));
            }
        }
        let weights = [1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0];
        for b in (0..start.len()).filter(|b| self.column[*b].is_some()) {
            for stage in 0..4 {
                let part = h * weights[stage];
                let p_rate = q[stage][b].p.rate(&v[stage][b].omega);
                self.poses[b].r += part * v[stage][b].v;
                self.poses[b].p.e0 += part * p_rate.e0;
                self.poses[b].p.e += part * p_rate.e;
                self.twists[b].v += part * a[stage][b].v;
                self.twists[b].omega += part * a[stage][b].omega;
            }
            self.poses[b].p = self.poses[b].p.normalised();
        }
        if self.stabilisation == Stabilisation::Projection { self.project() } else { Ok(()) }
    }

    /// Positions, then velocities, back onto the constraints by the mass-weighted least change.
    fn project(&mut self) -> Result<(), Failure> {
        for _ in 0..PASSES {
            let poses = self.poses.clone();
            self.factor(&poses)?;
            if self.rows.iter().all(|row| row.phi.abs() < PHI) {
                break;
            }
            self.solve_change(|all, c, r| -all.rows[all.mechanism.first_row(c) + r].phi);
            for (pose, column) in self.poses.iter_mut().zip(&self.column) {
                if let Some(at) = *column {
                    let x = &self.rhs[at..at + 6];
                    *pose = pose.moved(&Vector3::new(x[0], x[1], x[2]), &Vector3::new(x[3], x[4], x[5]));
                }
            }
        }
        let twists = self.twists.clone();
        self.solve_change(|all, c, r| -all.rate(c, r, &twists));
        for (twist, column) in self.twists.iter_mut().zip(&self.column) {
            if let Some(at) = *column {
                let x = Twist::from_slice(&self.rhs[at..at + 6]);
                *twist = Twist { v: twist.v + x.v, omega: twist.omega + x.omega };
            }
        }
        Ok(())
    }

    fn solve_change(&mut self, value: impl Fn(&Self, usize, usize) -> f64) {
        self.rhs[..self.coordinates].fill(0.0);
        for c in 0..self.equation.len() {
            let Some(equation) = self.equation[c] else { continue };
            for r in 0..self.mechanism.constraints()[c].kind.rows() {
                self.rhs[equation + r] = value(self, c, r);
            }
        }
        self.lu.solve(&mut self.rhs);
    }
}

/// Accelerations and λ of the six-coordinate form for any load [force global, moment body frame] per body,
/// gyroscopic terms included; every body needs mass and inertia. Dense; allocates.
///
/// # Errors
/// Singular.
pub fn accelerations(
    mechanism: &Mechanism,
    poses: &[Pose],
    twists: &[Twist],
    drives: &[Drive],
    load: &[f64],
) -> Result<(Vec<Twist>, Vec<f64>), Failure> {
    let (n, m) = (mechanism.coordinates(), mechanism.rows());
    let mut rows = vec![Row::ZERO; m];
    mechanism.evaluate(poses, drives, &mut rows);
    let jacobian = mechanism.dense_jacobian(&rows);
    let mut lu = DenseLu::new(n + m);
    let mut x = vec![0.0; n + m];
    let matrix = lu.matrix_mut();
    for (b, body) in mechanism.bodies().iter().enumerate() {
        let w = twists[b].omega;
        let gyroscopic = w.cross(&(body.inertia_kg_m2 * w));
        for k in 0..3 {
            matrix[(6 * b + k) * (n + m) + 6 * b + k] = body.mass_kg;
            x[6 * b + k] = load[6 * b + k];
            x[6 * b + 3 + k] = load[6 * b + 3 + k] - gyroscopic[k];
            for l in 0..3 {
                matrix[(6 * b + 3 + k) * (n + m) + 6 * b + 3 + l] = body.inertia_kg_m2[(k, l)];
            }
        }
    }
    for r in 0..m {
        for c in 0..n {
            matrix[(n + r) * (n + m) + c] = jacobian[r * n + c];
            matrix[c * (n + m) + n + r] = jacobian[r * n + c];
        }
    }
    mechanism.acceleration_right_side(poses, twists, drives, &mut x[n..]);
    lu.factor().map_err(|row| Failure {
        reason: Reason::Singular,
        constraint: (row.0 >= n).then(|| mechanism.constraint_of_row(row.0 - n)),
        iterations: 0,
        residual: 0.0,
    })?;
    lu.solve(&mut x);
    Ok((x[..n].chunks_exact(6).map(Twist::from_slice).collect(), x[n..].to_vec()))
}

//! Quasi-static equilibrium with elastic joints: poses and constraint forces solved together.
//!
//! Unknown are the poses of the free bodies and the multipliers. Equations: balance of every free body,
//! Q + F_elastic − Φ_qᵀλ − ψ_qᵀμ = 0; the rigid constraints Φ = 0; and as many closing rows as there are
//! carriers ψ. A carrier is a link that carries load (the spring); its closing row is either a driver
//! (wheel height given, spring length free) or the link's own length (spring locked). Newton on all of it
//! with the exact tangent: elastic and geometric stiffness, loads that turn with their body.
//!
//! Bushing: force on the arm −K d, d the displacement of the arm's point from the body's; moment −k_t φ, φ
//! the arm's rotation vector from design. Torsion spring: moments ∓k(θ₁ − θ₂) about a common hinge axis.
//! Both give back what they take (no loss). With a time between ticks, dampers act beside the bushings: force
//! −C (d − d₋)/h and moment −c_t ψ/h, d₋ and ψ the displacement at and the rotation since the tick before —
//! implicit Euler, which takes energy out at any h. Fixed bodies: those without coordinates here, posed by the
//! caller.

use spatial::{EulerParameters, Matrix3, Vector3, Wrench, skew};

use crate::body::{Placed, Pose, Twist};
use crate::constraint::{Drive, Kind, Row};
use crate::failure::{Failure, Reason, Solved};
use crate::geometric::{Stiffness, geometric_stiffness};
use crate::linear::{DenseLu, Entry, SingularRow, SparseLu};
use crate::mechanism::Mechanism;

/// An elastic joint between a free body and the ground.
#[derive(Debug, Clone)]
pub(crate) struct BushingElement {
    pub body: usize,
    /// Centre on the body. [m]
    pub s: Vector3<f64>,
    /// Centre on the ground. [m]
    pub anchor: Vector3<f64>,
    /// Stiffness in the global frame. [N/m]
    pub stiffness: Matrix3<f64>,
    /// Against rotation. [N m/rad]
    pub torsion: f64,
    /// Damping in the global frame. [N s/m]
    pub damping: Matrix3<f64>,
    /// Against rotation. [N m s/rad]
    pub torsion_damping: f64,
}

/// Where a bushing was at the tick before.
#[derive(Debug, Clone, Copy)]
struct Before {
    displacement: Vector3<f64>,
    attitude: EulerParameters,
}

/// A torsion spring between two bodies hinged on the ground about the same fixed axis.
#[derive(Debug, Clone)]
pub(crate) struct TorsionElement {
    pub bodies: [usize; 2],
    pub axis: Vector3<f64>,
    pub stiffness: f64,
}

/// What closes a carrier's column: the carrier's constraint and the driver's.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Carrier {
    pub link: usize,
    pub driver: usize,
}

/// Largest imbalance accepted, relative to the largest load (at least 1 N or 1 N m).
const BALANCE: f64 = 1e-10;
/// Largest last step after which the pose is accepted. [m or rad]
const STEP: f64 = 1e-7;
/// What rounding of a coordinate leaves of the balance, per stiffness: no imbalance below is asked for. [m]
const ROUNDING: f64 = 2e-15;
const PHI: f64 = 1e-12;
const ITERATIONS: u32 = 10;

/// The equilibrium of one mechanism, with its workspace.
#[derive(Debug, Clone)]
pub(crate) struct Equilibrium {
    mechanism: Mechanism,
    /// First unknown of a body's coordinates; `None` for fixed bodies.
    column: Vec<Option<usize>>,
    /// First unknown of a constraint's multipliers; `None` for the carriers' drivers and between fixed
    /// bodies.
    multiplier: Vec<Option<usize>>,
    bushings: Vec<BushingElement>,
    before: Vec<Before>,
    /// One over the time since the tick before; 0: no dampers. [1/s]
    rate: f64,
    torsion: Option<TorsionElement>,
    carriers: Vec<Carrier>,
    order: usize,
    bodies_order: usize,
    entries: Vec<Entry>,
    sparse: SparseLu,
    dense: DenseLu,
    used_dense: bool,
    design_positive: bool,
    matrix: Vec<f64>,
    rhs: Vec<f64>,
    placed: Vec<Placed>,
    rows: Vec<Row>,
    /// λ per row of the mechanism; 0 at drivers.
    lambda: Vec<f64>,
    /// Balance rows are divided by, and multipliers counted in, this stiffness: entries of like size.
    scale: f64,
    /// Largest damping. [N s/m]
    damping_scale: f64,
    /// Length at which each carrier is locked; free (driver) where `None`. [m]
    lock: Vec<Option<f64>>,
}

impl Equilibrium {
    /// Chooses the elimination order at the design poses.
    ///
    /// # Errors
    /// The name of a constraint or body at which the tangent is singular.
    pub fn new(
        mechanism: Mechanism,
        design: &[Pose],
        fixed: &[usize],
        bushings: Vec<BushingElement>,
        torsion: Option<TorsionElement>,
        carriers: Vec<Carrier>,
        drives: &[Drive],
    ) -> Result<Self, String> {
        let mut order = 0;
        let column: Vec<Option<usize>> = (0..design.len())
            .map(|body| {
                (!fixed.contains(&body)).then(|| {
                    order += 6;
                    order - 6
                })
            })
            .collect();
        let bodies_order = order;
        let multiplier: Vec<Option<usize>> = mechanism
            .constraints()
            .iter()
            .enumerate()
            .map(|(c, constraint)| {
                let drives = carriers.iter().any(|carrier| carrier.driver == c);
                let free = column[constraint.j].is_some()
                    || (!constraint.kind.is_absolute() && column[constraint.i].is_some());
                (free && !drives).then(|| {
                    order += constraint.kind.rows();
                    order - constraint.kind.rows()
                })
            })
            .collect();
        let n = order;
        let nothing = SparseLu::new(0, &[], |_| 0.0).map_err(|_| "empty".to_owned())?;
        let mut all = Self {
            rows: vec![Row::ZERO; mechanism.rows()],
            lambda: vec![0.0; mechanism.rows()],
            scale: bushings.iter().fold(1.0, |m: f64, b| m.max(b.stiffness.amax())),
            damping_scale: bushings.iter().fold(0.0, |m: f64, b| m.max(b.damping.amax())),
            lock: vec![None; carriers.len()],
            placed: design.iter().map(Placed::new).collect(),
            mechanism,
            column,
            multiplier,
            before: vec![
                Before { displacement: Vector3::zeros(), attitude: EulerParameters::IDENTITY };
                bushings.len()
            ],
            rate: 0.0,
            bushings,
            torsion,
            carriers,
            order: n,
            bodies_order,
            entries: (0..n * n).map(|k| Entry { row: k / n, column: k % n, source: k }).collect(),
            sparse: nothing,
            dense: DenseLu::new(n),
            used_dense: false,
            design_positive: true,
            matrix: vec![0.0; n * n],
            rhs: vec![0.0; n],
        };
        // Places that can be non-zero: at poses and with multipliers of every kind, springs free and locked.
        let mut seen = vec![false; n * n];
        for sample in 0..4_u32 {
            for (body, pose) in design.iter().enumerate() {
                let phase = f64::from(sample) * 1.3 + body as f64;
                let turn = Vector3::new(phase.sin(), (2.1 * phase).cos(), (3.3 * phase).sin());
                all.placed[body] = Placed::new(&pose.moved(&(0.1 * turn), &(0.5 * turn)));
            }
            all.lambda.iter_mut().enumerate().for_each(|(k, x)| *x = 100.0 + k as f64);
            all.lock.fill((sample % 2 == 0).then_some(0.3));
            let load = vec![1000.0; 6 * design.len()];
            all.mechanism.evaluate_placed(&all.placed, drives, &mut all.rows);
            all.assemble(&load);
            for (seen, x) in seen.iter_mut().zip(&all.matrix) {
                *seen |= *x != 0.0;
            }
        }
        all.entries.retain(|e| seen[e.source]);
        all.lambda.fill(0.0);
        all.lock.fill(None);
        for (placed, pose) in all.placed.iter_mut().zip(design) {
            *placed = Placed::new(pose);
        }
        all.mechanism.evaluate_placed(&all.placed, drives, &mut all.rows);
        all.assemble(&vec![0.0; 6 * design.len()]);
        let matrix = &all.matrix;
        let sparse = SparseLu::new(n, &all.entries, |k| matrix[k]);
        all.sparse = sparse.map_err(|row| all.name_of_row(row.0))?;
        all.factor().map_err(|row| all.name_of_row(row.0))?;
        all.design_positive = all.determinant_positive();
        Ok(all)
    }

    pub fn mechanism(&self) -> &Mechanism {
        &self.mechanism
    }

    pub fn rows(&self) -> &[Row] {
        &self.rows
    }

    pub fn lambda(&self) -> &[f64] {
        &self.lambda
    }

    pub fn lambda_mut(&mut self) -> &mut [f64] {
        &mut self.lambda
    }

    pub fn bushings(&self) -> &[BushingElement] {
        &self.bushings
    }

    /// Lets the dampers act against the motion from these poses, `rate` being one over the time since. [1/s]
    pub fn set_damping(&mut self, rate: f64, before: &[Pose]) {
        self.rate = rate;
        for (to, bushing) in self.before.iter_mut().zip(&self.bushings) {
            let pose = &before[bushing.body];
            *to = Before { displacement: pose.point(&bushing.s) - bushing.anchor, attitude: pose.p };
        }
    }

    /// Leaves the dampers out.
    pub fn no_damping(&mut self) {
        self.rate = 0.0;
    }

    /// Locks each carrier at a length, or leaves it to its driver. [m]
    pub fn set_lock(&mut self, carrier: usize, length_m: Option<f64>) {
        self.lock[carrier] = length_m;
    }

    fn constraint_of_row(&self, row: usize) -> Option<usize> {
        (row >= self.bodies_order).then_some(())?;
        let below = |m: &Option<usize>| m.is_some_and(|first| first <= row);
        self.multiplier.iter().rposition(below)
    }

    fn name_of_row(&self, row: usize) -> String {
        match self.constraint_of_row(row) {
            Some(c) => self.mechanism.constraints()[c].name.clone(),
            None => {
                let body = self.column.iter().rposition(|c| c.is_some_and(|first| first <= row));
                body.map_or_else(String::new, |b| self.mechanism.bodies()[b].name.clone())
            }
        }
    }

    fn factor(&mut self) -> Result<(), SingularRow> {
        let matrix = &self.matrix;
        self.used_dense = self.sparse.factor(|k| matrix[k]).is_err();
        if self.used_dense {
            self.dense.matrix_mut().copy_from_slice(&self.matrix);
            self.dense.factor()?;
        }
        Ok(())
    }

    fn determinant_positive(&self) -> bool {
        if self.used_dense { self.dense.determinant_positive() } else { self.sparse.determinant_positive() }
    }

    fn solve(&mut self) {
        if self.used_dense { self.dense.solve(&mut self.rhs) } else { self.sparse.solve(&mut self.rhs) }
    }

    fn add(&mut self, row: usize, column: usize, block: &Matrix3<f64>) {
        let inverse = 1.0 / self.scale;
        for r in 0..3 {
            for c in 0..3 {
                self.matrix[(row + r) * self.order + column + c] += inverse * block[(r, c)];
            }
        }
    }

    /// Fills matrix and right side at the evaluated rows. `load`: force (global) and moment (body frame)
    /// per body, both fixed in the body.
    fn assemble(&mut self, load: &[f64]) {
        let n = self.order;
        for e in &self.entries {
            self.matrix[e.source] = 0.0;
        }
        self.rhs.fill(0.0);
        for body in 0..self.column.len() {
            let Some(at) = self.column[body] else { continue };
            self.rhs[at..at + 6].copy_from_slice(&load[6 * body..6 * body + 6]);
            // The force turns with the body: −∂(A F')/∂π' = A F̃' = F̃ A.
            let force = Vector3::new(load[6 * body], load[6 * body + 1], load[6 * body + 2]);
            if force != Vector3::zeros() {
                let turn = skew(&force) * self.placed[body].a;
                self.add(at, at + 3, &turn);
            }
        }
        self.assemble_bushings();
        self.assemble_torsion();
        let mut stiffness: Stiffness = [[0.0; 12]; 12];
        let inverse = 1.0 / self.scale;
        for c in 0..self.multiplier.len() {
            let Some(m) = self.multiplier[c] else { continue };
            let constraint = &self.mechanism.constraints()[c];
            let first = self.mechanism.first_row(c);
            let count = constraint.kind.rows();
            let absolute = constraint.kind.is_absolute();
            let on = [if absolute { None } else { self.column[constraint.i] }, self.column[constraint.j]];
            geometric_stiffness(constraint, &self.placed, &self.lambda[first..first + count], &mut stiffness);
            for (half, to) in on.iter().enumerate() {
                let Some(to) = *to else { continue };
                for k in 0..6 {
                    for (half_from, from) in on.iter().enumerate() {
                        let Some(from) = *from else { continue };
                        for l in 0..6 {
                            self.matrix[(to + k) * n + from + l] +=
                                inverse * stiffness[6 * half + k][6 * half_from + l];
                        }
                    }
                    for r in 0..count {
                        let jac = self.rows[first + r].jac[6 * half + k];
                        self.rhs[to + k] -= jac * self.lambda[first + r];
                        self.matrix[(to + k) * n + m + r] += jac;
                    }
                }
            }
            let carrier = self.carriers.iter().position(|carrier| carrier.link == c);
            match carrier {
                Some(k) => self.close(k, m),
                None => {
                    for r in 0..count {
                        self.closing_row(m + r, first + r, on, self.rows[first + r].phi);
                    }
                }
            }
        }
    }

    fn closing_row(&mut self, row: usize, from: usize, on: [Option<usize>; 2], phi: f64) {
        for (half, to) in on.iter().enumerate() {
            let Some(to) = *to else { continue };
            for k in 0..6 {
                self.matrix[row * self.order + to + k] += self.rows[from].jac[6 * half + k];
            }
        }
        self.rhs[row] = -phi;
    }

    /// The closing row of carrier `k`: its driver, or its own length.
    fn close(&mut self, k: usize, row: usize) {
        let Carrier { link, driver } = self.carriers[k];
        let from = if self.lock[k].is_some() { link } else { driver };
        let constraint = &self.mechanism.constraints()[from];
        let absolute = constraint.kind.is_absolute();
        let on = [if absolute { None } else { self.column[constraint.i] }, self.column[constraint.j]];
        let first = self.mechanism.first_row(from);
        let mut phi = self.rows[first].phi;
        if let (Some(locked), Kind::Distance { length_m, .. }) = (self.lock[k], &constraint.kind) {
            phi += length_m * length_m - locked * locked;
        }
        self.closing_row(row, first, on, phi);
    }

    fn assemble_bushings(&mut self) {
        for b in 0..self.bushings.len() {
            let BushingElement { body, s, anchor, stiffness, torsion, damping, torsion_damping } =
                &self.bushings[b];
            let Some(at) = self.column[*body] else { continue };
            let placed = self.placed[*body];
            let displacement = placed.point(s) - anchor;
            let phi = placed.p.rotation_vector();
            let mut force = -stiffness * displacement;
            let mut turned = -*torsion * phi;
            // The rotation vector's rate in the body frame: φ̇ = (I + ½φ̃ + φ̃²/12 + …) ω'.
            let rate = |phi: &Vector3<f64>| {
                let phi = skew(phi);
                Matrix3::identity() + 0.5 * phi + phi * phi / 12.0
            };
            let mut against_turning = *torsion * rate(&phi);
            let mut stiffness = *stiffness;
            if self.rate > 0.0 {
                let before = &self.before[b];
                let since = before.attitude.relative_to(placed.p).rotation_vector();
                force -= self.rate * (damping * (displacement - before.displacement));
                turned -= self.rate * *torsion_damping * since;
                against_turning += self.rate * *torsion_damping * rate(&since);
                stiffness += self.rate * damping;
            }
            let s = *s;
            let local = placed.a.tr_mul(&force);
            let moment = s.cross(&local) + turned;
            for k in 0..3 {
                self.rhs[at + k] += force[k];
                self.rhs[at + 3 + k] += moment[k];
            }
            let turn = placed.a * skew(&s);
            let arm = skew(&s) * placed.a.transpose() * stiffness;
            self.add(at, at, &stiffness);
            self.add(at, at + 3, &(-stiffness * turn));
            self.add(at + 3, at, &arm);
            self.add(at + 3, at + 3, &(-arm * turn - skew(&s) * skew(&local) + against_turning));
        }
    }

    fn assemble_torsion(&mut self) {
        let Some(TorsionElement { bodies, axis, stiffness }) = self.torsion.clone() else { return };
        let angle = bodies.map(|b| {
            let p = self.placed[b].p;
            2.0 * axis.dot(&p.e).atan2(p.e0)
        });
        let torque = stiffness * (angle[0] - angle[1]);
        let outer = stiffness * (axis * axis.transpose());
        for (k, sign) in [(0, 1.0), (1, -1.0)] {
            let Some(at) = self.column[bodies[k]] else { continue };
            for c in 0..3 {
                self.rhs[at + 3 + c] -= sign * torque * axis[c];
            }
            for (l, sign_other) in [(0, 1.0), (1, -1.0)] {
                if let Some(from) = self.column[bodies[l]] {
                    self.add(at + 3, from + 3, &(sign * sign_other * outer));
                }
            }
        }
    }

    /// Newton from `poses` and the last multipliers. `load`: [force global, moment body frame] of the
    /// bodies as they stand in `poses`; forces turn with their bodies. On failure `poses` are whatever is
    /// left.
    ///
    /// # Errors
    /// Out of reach, singular, or beyond a dead point.
    pub fn position(
        &mut self,
        poses: &mut [Pose],
        drives: &[Drive],
        wrenches: &[Wrench],
        load: &mut [f64],
    ) -> Result<Solved, Failure> {
        let mut step = f64::INFINITY;
        let mut iterations = 0;
        loop {
            for ((body, placed), pose) in self.placed.iter_mut().enumerate().zip(poses.iter()) {
                *placed = Placed::new(pose);
                let force = placed.a * wrenches[body].force_n;
                load[6 * body..6 * body + 3].copy_from_slice(force.as_slice());
                load[6 * body + 3..6 * body + 6].copy_from_slice(wrenches[body].moment_n_m.as_slice());
            }
            self.mechanism.evaluate_placed(&self.placed, drives, &mut self.rows);
            self.assemble(load);
            let largest = |x: &[f64]| {
                let bigger = |(m, at): (f64, usize), (k, v): (usize, &f64)| {
                    if v.abs() <= m { (m, at) } else { (v.abs(), k) }
                };
                x.iter().enumerate().fold((0.0, 0), bigger)
            };
            let (imbalance, _) = largest(&self.rhs[..self.bodies_order]);
            let (residual, worst) = largest(&self.rhs[self.bodies_order..]);
            let failure = move |all: &Self, reason, row| Failure {
                reason,
                constraint: all.constraint_of_row(row),
                iterations,
                residual: if residual.is_finite() { residual } else { f64::MAX },
            };
            let worst = worst + self.bodies_order;
            let strongest = load.iter().chain(&self.lambda).fold(1.0_f64, |m, x| m.max(x.abs()));
            let balanced = BALANCE * strongest + ROUNDING * (self.scale + self.rate * self.damping_scale);
            if residual <= PHI && imbalance <= balanced && step <= STEP {
                if self.determinant_positive() != self.design_positive {
                    return Err(failure(self, Reason::WrongBranch, worst));
                }
                return Ok(Solved { iterations, residual });
            }
            if iterations == ITERATIONS || !residual.is_finite() || !imbalance.is_finite() {
                return Err(failure(self, Reason::OutOfReach, worst));
            }
            if let Err(singular) = self.factor() {
                return Err(failure(self, Reason::Singular, singular.0));
            }
            let inverse = 1.0 / self.scale;
            self.rhs[..self.bodies_order].iter_mut().for_each(|x| *x *= inverse);
            self.solve();
            iterations += 1;
            step =
                self.rhs[..self.bodies_order].iter().fold(0.0, |m, x| if x.abs() <= m { m } else { x.abs() });
            if !(step <= 1.0) {
                return Err(failure(self, Reason::OutOfReach, worst));
            }
            for (pose, column) in poses.iter_mut().zip(&self.column) {
                if let Some(at) = *column {
                    let x = &self.rhs[at..at + 6];
                    *pose = pose.moved(&Vector3::new(x[0], x[1], x[2]), &Vector3::new(x[3], x[4], x[5]));
                }
            }
            for (c, m) in self.multiplier.iter().enumerate() {
                let Some(m) = *m else { continue };
                let first = self.mechanism.first_row(c);
                for r in 0..self.mechanism.constraints()[c].kind.rows() {
                    self.lambda[first + r] += self.scale * self.rhs[m + r];
                }
            }
        }
    }

    /// Velocities at the last solved pose for moving drivers and fixed bodies with given velocity, loads
    /// held. Exact: the tangent is assembled and factored there first.
    ///
    /// # Errors
    /// Singular.
    pub fn velocity(
        &mut self,
        poses: &[Pose],
        drives: &[Drive],
        load: &[f64],
        twists: &mut [Twist],
    ) -> Result<(), Failure> {
        for (placed, pose) in self.placed.iter_mut().zip(poses) {
            *placed = Placed::new(pose);
        }
        self.mechanism.evaluate_placed(&self.placed, drives, &mut self.rows);
        self.assemble(load);
        self.factor().map_err(|row| Failure {
            reason: Reason::Singular,
            constraint: self.constraint_of_row(row.0),
            iterations: 0,
            residual: 0.0,
        })?;
        self.velocity_again(drives, twists);
        Ok(())
    }

    /// As `velocity`, for other drivers at the same pose.
    pub fn velocity_again(&mut self, drives: &[Drive], twists: &mut [Twist]) {
        self.rhs.fill(0.0);
        let inverse = 1.0 / self.scale;
        let mut stiffness: Stiffness = [[0.0; 12]; 12];
        for c in 0..self.multiplier.len() {
            let Some(m) = self.multiplier[c] else { continue };
            let constraint = &self.mechanism.constraints()[c];
            let (first, count) = (self.mechanism.first_row(c), constraint.kind.rows());
            // A fixed body that moves drags the constraint along: −J v in its rows, −K v in the balance.
            for (half, body) in [(0, constraint.i), (1, constraint.j)] {
                if self.column[body].is_some() || twists[body] == Twist::ZERO {
                    continue;
                }
                let v = &twists[body];
                let x = [v.v.x, v.v.y, v.v.z, v.omega.x, v.omega.y, v.omega.z];
                let lambda = &self.lambda[first..first + count];
                geometric_stiffness(constraint, &self.placed, lambda, &mut stiffness);
                for k in 0..6 {
                    for r in 0..count {
                        self.rhs[m + r] -= self.rows[first + r].jac[6 * half + k] * x[k];
                    }
                }
                let (other, other_half) = if half == 0 { (constraint.j, 1) } else { (constraint.i, 0) };
                if let Some(at) = self.column[other] {
                    for l in 0..6 {
                        for k in 0..6 {
                            self.rhs[at + l] -= inverse * stiffness[6 * other_half + l][6 * half + k] * x[k];
                        }
                    }
                }
            }
            if let Some(k) = self.carriers.iter().position(|carrier| carrier.link == c)
                && self.lock[k].is_none()
            {
                let mut nu = [0.0; crate::constraint::ROWS_MAX];
                self.mechanism.constraints()[self.carriers[k].driver].velocity_right_side(drives, &mut nu);
                self.rhs[m] = nu[0];
            }
        }
        self.solve();
        for (twist, column) in twists.iter_mut().zip(&self.column) {
            if let Some(at) = *column {
                *twist = Twist::from_slice(&self.rhs[at..at + 6]);
            }
        }
    }
}

//! Kinematic position, velocity and acceleration analysis of a whole mechanism at once, and its
//! quasi-static and inverse-dynamic reactions: the general path.
//!
//! Position: Newton–Raphson Φ_q Δ = −Φ from the pose handed in. Velocity: Φ_q v = ν. Acceleration:
//! Φ_q a = γ. Reactions: Φ_qᵀ λ = Q − M a, the constraint's force on the bodies being −Φ_qᵀλ; a = 0 gives
//! the quasi-static ones. Bounded, without allocation after construction.

use spatial::Vector3;

use crate::body::{Placed, Pose, Twist};
use crate::constraint::{Drive, Row};
use crate::failure::{AssemblyError, Failure, Reason, Solved};
use crate::mechanism::Mechanism;
use crate::system::JacobianSystem;

/// When Newton stops.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Largest |Φ| that is accepted. [m or m² or -]
    pub phi: f64,
    /// Largest last step after which the pose is accepted; the error left is of its square. [m or rad]
    pub step: f64,
    /// A longer step means that Newton is lost. [m or rad]
    pub step_max: f64,
    /// Most Newton steps.
    pub iterations: u32,
}

impl Limits {
    /// For every model of this crate.
    pub const STANDARD: Self = Self { phi: 1e-12, step: 1e-7, step_max: 1.0, iterations: 8 };
    /// |Φ| at which nothing is left to do, whatever the last step.
    pub(crate) const PHI_NOTHING: f64 = 2e-15;
}

/// Workspace of the analyses of one mechanism.
#[derive(Debug, Clone)]
pub struct Kinematics {
    mechanism: Mechanism,
    system: JacobianSystem,
    design_positive: bool,
    placed: Vec<Placed>,
    rows: Vec<Row>,
    rhs: Vec<f64>,
    left: Vec<f64>,
    correction: Vec<f64>,
    steps: Vec<f64>,
    limits: Limits,
    /// What the factors at hand belong to.
    factors: Factors,
}

/// Which Jacobian the factors at hand belong to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Factors {
    /// None of use.
    None,
    /// That of the last Newton step, a hair's breadth away from the evaluated rows.
    LastStep,
    /// That of the evaluated rows.
    Rows,
}

impl Kinematics {
    /// For a mechanism whose constraints are met and independent at the design poses.
    ///
    /// # Errors
    /// See [`JacobianSystem::new`].
    pub fn new(
        name: &str,
        mechanism: Mechanism,
        design: &[Pose],
        drives: &[Drive],
        limits: Limits,
    ) -> Result<Self, AssemblyError> {
        let mut system = JacobianSystem::new(name, &mechanism, design, drives)?;
        let placed: Vec<Placed> = design.iter().map(Placed::new).collect();
        let mut rows = vec![Row::ZERO; mechanism.rows()];
        mechanism.evaluate_placed(&placed, drives, &mut rows);
        system.factor(&rows).map_err(|row| AssemblyError::Redundant {
            mechanism: name.to_owned(),
            constraints: vec![mechanism.constraints()[mechanism.constraint_of_row(row.0)].name.clone()],
        })?;
        let design_positive = system.determinant_positive();
        let (rhs, left) = (vec![0.0; mechanism.rows()], vec![0.0; mechanism.rows()]);
        let correction = left.clone();
        let steps = Vec::with_capacity(limits.iterations as usize);
        Ok(Self {
            mechanism,
            system,
            design_positive,
            placed,
            rows,
            rhs,
            left,
            correction,
            steps,
            limits,
            factors: Factors::None,
        })
    }

    /// The mechanism.
    #[must_use]
    pub fn mechanism(&self) -> &Mechanism {
        &self.mechanism
    }

    /// Rows (Φ and Jacobian) of the last evaluation.
    #[must_use]
    pub fn rows(&self) -> &[Row] {
        &self.rows
    }

    /// Lengths of the Newton steps of the last position analysis, in order. [m or rad]
    #[must_use]
    pub fn steps(&self) -> &[f64] {
        &self.steps
    }

    /// Entries of the sparse factors.
    #[must_use]
    pub fn fill(&self) -> usize {
        self.system.fill()
    }

    fn place(&mut self, poses: &[Pose]) {
        for (placed, pose) in self.placed.iter_mut().zip(poses) {
            *placed = Placed::new(pose);
        }
    }

    fn failure(&self, reason: Reason, row: Option<usize>, iterations: u32, residual: f64) -> Failure {
        let constraint = row.map(|row| self.mechanism.constraint_of_row(row));
        Failure { reason, constraint, iterations, residual }
    }

    /// Moves `poses` to where the constraints are met. On failure `poses` are whatever Newton left.
    ///
    /// # Errors
    /// Out of reach, singular, or beyond a dead point, with the constraint that is worst off.
    pub fn position(&mut self, poses: &mut [Pose], drives: &[Drive]) -> Result<Solved, Failure> {
        let mut step = f64::INFINITY;
        self.factors = Factors::None;
        self.steps.clear();
        let mut iterations = 0;
        loop {
            self.place(poses);
            self.mechanism.evaluate_placed(&self.placed, drives, &mut self.rows);
            let (mut residual, mut worst) = (0.0, 0);
            for (r, row) in self.rows.iter().enumerate() {
                // Negated so that NaN is the worst of all.
                if !(row.phi.abs() <= residual) {
                    (residual, worst) = (row.phi.abs(), r);
                }
            }
            if !residual.is_finite() {
                return Err(self.failure(Reason::OutOfReach, Some(worst), iterations, f64::MAX));
            }
            let enough = step <= self.limits.step || residual <= Limits::PHI_NOTHING;
            if residual <= self.limits.phi && enough {
                if self.factors == Factors::LastStep
                    && self.system.determinant_positive() != self.design_positive
                {
                    return Err(self.failure(Reason::WrongBranch, Some(worst), iterations, residual));
                }
                return Ok(Solved { iterations, residual });
            }
            if iterations == self.limits.iterations {
                return Err(self.failure(Reason::OutOfReach, Some(worst), iterations, residual));
            }
            if let Err(singular) = self.system.factor(&self.rows) {
                return Err(self.failure(Reason::Singular, Some(singular.0), iterations, residual));
            }
            self.factors = Factors::LastStep;
            for (x, row) in self.rhs.iter_mut().zip(&self.rows) {
                *x = -row.phi;
            }
            self.system.solve(&mut self.rhs);
            step = self.rhs.iter().fold(0.0, |m, x| if x.abs() <= m { m } else { x.abs() });
            self.steps.push(step);
            if !(step <= self.limits.step_max) {
                return Err(self.failure(Reason::OutOfReach, Some(worst), iterations + 1, residual));
            }
            for (pose, x) in poses.iter_mut().zip(self.rhs.chunks_exact(6)) {
                *pose = pose.moved(&Vector3::new(x[0], x[1], x[2]), &Vector3::new(x[3], x[4], x[5]));
            }
            iterations += 1;
        }
    }

    /// Evaluates and factors at these poses, for the analyses below.
    ///
    /// # Errors
    /// Singular, with the constraint.
    pub fn prepare(&mut self, poses: &[Pose], drives: &[Drive]) -> Result<(), Failure> {
        self.place(poses);
        self.mechanism.evaluate_placed(&self.placed, drives, &mut self.rows);
        self.factor_rows()
    }

    fn factor_rows(&mut self) -> Result<(), Failure> {
        self.factors = Factors::None;
        if let Err(singular) = self.system.factor(&self.rows) {
            return Err(self.failure(Reason::Singular, Some(singular.0), 0, 0.0));
        }
        self.factors = Factors::Rows;
        Ok(())
    }

    /// Velocities where the rows were evaluated last (by `position` or `prepare`): Φ_q v = ν. After
    /// `position` the last Newton step's factors serve, corrected twice with the Jacobian of the rows.
    ///
    /// # Errors
    /// Singular, with the constraint.
    pub fn velocity(&mut self, drives: &[Drive], twists: &mut [Twist]) -> Result<(), Failure> {
        if self.factors == Factors::None {
            self.factor_rows()?;
        }
        self.mechanism.velocity_right_side(drives, &mut self.rhs);
        self.left.copy_from_slice(&self.rhs);
        self.system.solve(&mut self.rhs);
        // With the factors of the step before: each correction takes the error to the next power.
        let corrections = if self.factors == Factors::LastStep { 2 } else { 0 };
        for _ in 0..corrections {
            self.correction.copy_from_slice(&self.left);
            for (r, row) in self.rows.iter().enumerate() {
                self.correction[r] -= self.mechanism.row_product(r, row, &self.rhs);
            }
            self.system.solve(&mut self.correction);
            for (x, more) in self.rhs.iter_mut().zip(&self.correction) {
                *x += more;
            }
        }
        for (twist, x) in twists.iter_mut().zip(self.rhs.chunks_exact(6)) {
            *twist = Twist::from_slice(x);
        }
        Ok(())
    }

    /// Accelerations at the prepared poses: Φ_q a = γ.
    pub fn acceleration(&mut self, twists: &[Twist], drives: &[Drive], accelerations: &mut [Twist]) {
        for (c, constraint) in self.mechanism.constraints().iter().enumerate() {
            let first = self.mechanism.first_row(c);
            let out = &mut self.rhs[first..first + constraint.kind.rows()];
            constraint.acceleration_right_side(&self.placed, twists, drives, out);
        }
        self.system.solve(&mut self.rhs);
        for (acceleration, x) in accelerations.iter_mut().zip(self.rhs.chunks_exact(6)) {
            *acceleration = Twist::from_slice(x);
        }
    }

    /// Quasi-static reactions at the prepared poses: λ = Φ_q⁻ᵀ Q. `load` is Q, [force global, moment in
    /// the body frame] per body; `lambda` receives λ per row.
    pub fn reactions(&mut self, load: &[f64], lambda: &mut [f64]) {
        lambda.copy_from_slice(load);
        self.system.solve_transposed(lambda);
    }

    /// Inverse dynamics at the prepared poses: λ = Φ_q⁻ᵀ (Q − M a), with the gyroscopic term
    /// ω̃'J'ω' on the load's side.
    pub fn inverse_dynamics(
        &mut self,
        load: &[f64],
        twists: &[Twist],
        accelerations: &[Twist],
        lambda: &mut [f64],
    ) {
        for (b, body) in self.mechanism.bodies().iter().enumerate() {
            let (w, a) = (twists[b].omega, accelerations[b]);
            let force = body.mass_kg * a.v;
            let moment = body.inertia_kg_m2 * a.omega + w.cross(&(body.inertia_kg_m2 * w));
            for k in 0..3 {
                lambda[6 * b + k] = load[6 * b + k] - force[k];
                lambda[6 * b + 3 + k] = load[6 * b + 3 + k] - moment[k];
            }
        }
        self.system.solve_transposed(lambda);
    }
}

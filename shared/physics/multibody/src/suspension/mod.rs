//! Steered suspensions in two stages, after the source's chapter 4.4.
//!
//! Stage 1 solves the pose with the rack stroke and both wheel-centre heights as drivers. Stage 2 keeps
//! that pose, swaps the height drivers for the mechanism that carries the load (spring and damper), and
//! solves the constraint forces: a driver and a load on the same body would cancel, so with the drivers in
//! place the vertical load would never reach the tie rod. The parts have no mass here; the spring is a
//! massless link of the length found in stage 1. The stabiliser's torque acts on its halves only.
//!
//! With bushings there is one stage: arms, bushings, poses and forces are solved together each tick, the
//! wheel heights given and the springs' forces unknown.

use std::f64::consts::FRAC_1_SQRT_2;

use config::Check;
use config::axle::Axle;
use spatial::{Vector3, Wrench};

use crate::body::{Pose, Twist};
use crate::constraint::{Drive, Kind, Row};
use crate::equilibrium::Equilibrium;
use crate::failure::{AssemblyError, Failure, Reason, Solved};
use crate::mechanism::{Description, Mechanism};

mod assemble;
mod compliant;
mod friction;
mod io;
mod model;
mod readout;
mod solver;
mod stage;

pub use io::{SideOutput, Status, SuspensionInput, SuspensionOutput};

use friction::KingpinFriction;
use model::{BODY, Bar, Model, RACK, Side};
use solver::Solver;
use stage::Stage;

/// Longest move of an input that Newton takes in one go; longer ones are split. [m]
const STEP_INPUT_MAX_M: f64 = 0.005;
/// Most pieces into which a move is split.
const PIECES_MAX: f64 = 48.0;

/// Which solver runs. Both give the same numbers to 1e-10.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SolverPath {
    /// Ground and rack eliminated, independent parts solved one after the other.
    #[default]
    Structured,
    /// The whole mechanism at once.
    General,
}

/// Both stages' mechanisms, for people.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SuspensionDescription {
    /// Stage 1: pose.
    pub kinematic: Description,
    /// Stage 2: forces. With bushings there is one stage only, and both are it.
    pub reaction: Description,
    /// Names of the bushings, if any.
    pub bushings: Vec<String>,
}

/// Stage 2 of the last good tick, for reports and checks.
#[derive(Debug, Clone, Copy)]
pub struct ForceStage<'a> {
    /// Bodies and constraints.
    pub mechanism: &'a Mechanism,
    /// Poses of the bodies.
    pub poses: &'a [Pose],
    /// Φ and Jacobian per row.
    pub rows: &'a [Row],
    /// Applied loads per body: force in B, moment about the body's origin in the body's frame. [N, N m]
    pub load: &'a [f64],
    /// Multiplier per row; the constraint's force on its bodies is −Φ_qᵀλ.
    pub lambda: &'a [f64],
}

/// A suspension: model, last pose, preallocated workspace.
#[derive(Debug, Clone)]
pub struct Suspension {
    solver: Solver,
    sides: [Side; 2],
    bar: Option<Bar>,
    /// Side and place of each bushing among the outputs.
    bushings: Vec<(String, usize, usize)>,
    design: Vec<Pose>,
    poses: Vec<Pose>,
    /// The tick before, from which the next one is predicted.
    previous: Vec<Pose>,
    trial: Vec<Pose>,
    twists: Vec<Twist>,
    axis_twists: Vec<Twist>,
    force_poses: Vec<Pose>,
    load: Vec<f64>,
    lambda: Vec<f64>,
    friction: Option<[KingpinFriction; 2]>,
    /// Time between ticks; `None`: every tick is an equilibrium at rest. [s]
    period_s: Option<f64>,
    input: SuspensionInput,
    good: SuspensionOutput,
    held_ticks: u64,
}

impl Suspension {
    /// Assembles the axle, on the structured path; with bushings where the axle has them.
    ///
    /// # Errors
    /// All broken rules of the axle; or the constraint that is redundant, singular or not met at design.
    pub fn new(axle: &Axle) -> Result<Self, AssemblyError> {
        Self::with_path(axle, SolverPath::default())
    }

    /// Assembles the axle for the given solver. (With bushings there is one solver for both.)
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn with_path(axle: &Axle, path: SolverPath) -> Result<Self, AssemblyError> {
        let broken = axle.broken();
        if !broken.is_empty() {
            return Err(AssemblyError::Axle(broken));
        }
        let (solver, sides, bar, design, bushings) =
            if axle.bushings.is_some() { elastic(axle)? } else { rigid(axle, path)? };
        let friction =
            axle.kingpin_friction.as_ref().map(|f| [KingpinFriction::new(f), KingpinFriction::new(f)]);
        let force_bodies = solver.force_mechanism().bodies().len();
        let mut suspension = Self {
            sides,
            bar,
            bushings,
            poses: design.clone(),
            previous: design.clone(),
            trial: design.clone(),
            twists: vec![Twist::ZERO; design.len()],
            axis_twists: vec![Twist::ZERO; design.len()],
            force_poses: vec![Pose::IDENTITY; force_bodies],
            load: vec![0.0; 6 * force_bodies],
            lambda: vec![0.0; solver.force_mechanism().rows()],
            design,
            solver,
            friction,
            period_s: None,
            input: SuspensionInput::DESIGN,
            good: SuspensionOutput::default(),
            held_ticks: 0,
        };
        suspension.reset();
        Ok(suspension)
    }

    /// Back to the design pose, unloaded, without memory.
    pub fn reset(&mut self) {
        self.poses.copy_from_slice(&self.design);
        self.previous.copy_from_slice(&self.design);
        self.lambda.fill(0.0);
        for friction in self.friction.iter_mut().flatten() {
            friction.reset();
        }
        self.input = SuspensionInput::DESIGN;
        self.held_ticks = 0;
        self.refresh();
    }

    /// One tick: pose, then forces. Bounded, without allocation; never NaN out: what cannot be solved is
    /// held at the last good tick and flagged.
    pub fn step(&mut self, input: &SuspensionInput, output: &mut SuspensionOutput) {
        match self.solve(input) {
            Ok(solved) => {
                self.good.status = Status::Converged;
                self.good.iterations = solved.iterations;
                self.good.residual = solved.residual;
                self.held_ticks = 0;
                *output = self.good;
            }
            Err(failure) => {
                self.held_ticks += 1;
                self.previous.copy_from_slice(&self.poses);
                *output = self.good;
                for side in &mut output.side {
                    side.tie_rod_ball_velocity_m_s = Vector3::zeros();
                    side.knuckle_angular_velocity_rad_s = Vector3::zeros();
                }
                output.status = Status::Held { reason: failure.reason, constraint: failure.constraint };
                output.iterations = failure.iterations;
                output.residual = failure.residual;
                output.held_ticks = self.held_ticks;
            }
        }
    }

    /// Both stages' bodies and constraints.
    #[must_use]
    pub fn describe(&self) -> SuspensionDescription {
        SuspensionDescription {
            kinematic: self.solver.pose_mechanism().describe(),
            reaction: self.solver.force_mechanism().describe(),
            bushings: self.bushings.iter().map(|(name, _, _)| name.clone()).collect(),
        }
    }

    /// Name of a constraint of stage 1, as numbered in [`Status::Held`].
    #[must_use]
    pub fn constraint_name(&self, index: usize) -> Option<&str> {
        self.solver.pose_mechanism().constraints().get(index).map(|c| c.name.as_str())
    }

    /// Holds each spring at a length instead of holding each wheel at its height (`None`: wheel heights
    /// again), as on a test bench for compliance. Only with bushings: a rigid axle would not move.
    /// [m], left and right. Returns whether it was done.
    pub fn lock_springs(&mut self, length_m: Option<[f64; 2]>) -> bool {
        let Solver::Elastic { equilibrium, .. } = &mut self.solver else { return false };
        for side in 0..2 {
            equilibrium.set_lock(side, length_m.map(|length| length[side]));
        }
        true
    }

    /// Tells the time between ticks, which the bushings' dampers need; `None` (as at first): quasi-static,
    /// without dampers. A setting, not state. [s], > 0
    pub fn set_period(&mut self, period_s: Option<f64>) {
        self.period_s = period_s.filter(|period| period.is_finite() && *period > 0.0);
    }

    /// Body by body, what load and constraint forces of the last tick leave unbalanced: [force, moment] per
    /// body of the force stage; and the largest load. [N, N m] Without bushings only. Allocates.
    #[must_use]
    pub fn imbalance(&self) -> Option<(Vec<f64>, f64)> {
        matches!(self.solver, Solver::Rigid { .. }).then(|| {
            let mechanism = self.solver.force_mechanism();
            let left = mechanism.imbalance(self.solver.force_rows(), &self.lambda, &self.load);
            (left, self.load.iter().fold(0.0_f64, |m, x| m.max(x.abs())))
        })
    }

    /// The mechanism of the poses (stage 1) and the last good poses of its bodies.
    #[must_use]
    pub fn pose_stage(&self) -> (&Mechanism, &[Pose]) {
        (self.solver.pose_mechanism(), &self.poses)
    }

    /// The mechanism of the forces (stage 2), as the last good tick left it.
    #[must_use]
    pub fn force_stage(&self) -> ForceStage<'_> {
        ForceStage {
            mechanism: self.solver.force_mechanism(),
            poses: &self.force_poses,
            rows: self.solver.force_rows(),
            load: &self.load,
            lambda: &self.lambda,
        }
    }

    /// The drivers' values and rates at an input: rack stroke, then both wheel-centre heights.
    #[must_use]
    pub fn drives(&self, input: &SuspensionInput) -> [Drive; 3] {
        drives(&self.sides, input)
    }

    /// Numbers in the state.
    #[must_use]
    pub fn state_len(&self) -> usize {
        14 * self.poses.len() + self.lambda.len() + SuspensionInput::LEN + 2 + 1
    }

    /// Writes the state: poses of this tick and the one before, multipliers, last good input, friction,
    /// ticks held.
    ///
    /// # Panics
    /// If `state` is not [`Self::state_len`] long.
    pub fn save_state(&self, state: &mut [f64]) {
        assert_eq!(state.len(), self.state_len());
        let (poses, rest) = state.split_at_mut(14 * self.poses.len());
        for (to, pose) in poses.chunks_exact_mut(7).zip(self.poses.iter().chain(&self.previous)) {
            to.copy_from_slice(&pose.to_array());
        }
        let (lambda, rest) = rest.split_at_mut(self.lambda.len());
        lambda.copy_from_slice(&self.lambda);
        rest[..SuspensionInput::LEN].copy_from_slice(&self.input.to_array());
        let friction = &mut rest[SuspensionInput::LEN..];
        friction[0] = self.friction.map_or(0.0, |f| f[0].moment_n_m());
        friction[1] = self.friction.map_or(0.0, |f| f[1].moment_n_m());
        friction[2] = self.held_ticks as f64;
    }

    /// Reads a state of [`Self::save_state`]; the next tick goes on bit for bit.
    ///
    /// # Panics
    /// If `state` is not [`Self::state_len`] long.
    pub fn load_state(&mut self, state: &[f64]) {
        assert_eq!(state.len(), self.state_len());
        let (poses, rest) = state.split_at(14 * self.poses.len());
        for (pose, from) in self.poses.iter_mut().chain(&mut self.previous).zip(poses.chunks_exact(7)) {
            let mut q = [0.0; 7];
            q.copy_from_slice(from);
            *pose = Pose::from_array(q);
        }
        let (lambda, rest) = rest.split_at(self.lambda.len());
        self.lambda.copy_from_slice(lambda);
        self.input = SuspensionInput::from_array(rest);
        if let Some(friction) = &mut self.friction {
            friction[0].set_moment_n_m(rest[SuspensionInput::LEN]);
            friction[1].set_moment_n_m(rest[SuspensionInput::LEN + 1]);
        }
        self.held_ticks = rest[SuspensionInput::LEN + 2] as u64;
        self.refresh();
    }

    /// The last good output again, from pose, input, friction and multipliers.
    fn refresh(&mut self) {
        self.trial.copy_from_slice(&self.poses);
        let input = self.input;
        if let Solver::Elastic { equilibrium, .. } = &mut self.solver {
            equilibrium.lambda_mut().copy_from_slice(&self.lambda);
        }
        self.prepare_loads(&input, &input, 1.0);
        // The pose is a solved one: a failure can only mean a state that was not saved by this model; the
        // output then stays what it was, and the next tick is held.
        let _ = self.forces(&input, true);
    }

    /// A body of the trial pose has turned by more than a right angle from design: links fit together that way
    /// too, and with bushings the sign of the determinant alone does not tell; no axle gets there.
    fn astray(&self) -> bool {
        let turned = |(now, design): (&Pose, &Pose)| design.p.relative_to(now.p).e0.abs() < FRAC_1_SQRT_2;
        self.trial.iter().zip(&self.design).any(turned)
    }

    fn solve(&mut self, input: &SuspensionInput) -> Result<Solved, Failure> {
        let failure = |reason| Failure { reason, constraint: None, iterations: 0, residual: 0.0 };
        if !input.is_usable() {
            return Err(failure(Reason::NotFinite));
        }
        let last = self.input;
        if let (Solver::Elastic { equilibrium, .. }, Some(period_s)) = (&mut self.solver, self.period_s) {
            // Ticks that were held have passed too.
            equilibrium.set_damping(1.0 / (period_s * (self.held_ticks + 1) as f64), &self.poses);
        }
        let total = match self.pose(&last, input, false) {
            Ok(solved) => solved,
            // A last pose near a dead point may be a bad place to start from; the design pose never is.
            Err(from_last) => self.pose(&SuspensionInput::DESIGN, input, true).map_err(|_| from_last)?,
        };
        let total = if self.astray() {
            let total = self.pose(&SuspensionInput::DESIGN, input, true)?;
            if self.astray() {
                return Err(Failure { iterations: total.iterations, ..failure(Reason::WrongBranch) });
            }
            total
        } else {
            total
        };
        self.turn_friction();
        self.forces(input, false)?;
        self.previous.copy_from_slice(&self.poses);
        self.poses.copy_from_slice(&self.trial);
        self.input = *input;
        Ok(total)
    }

    /// Solves the trial pose for `input`, starting at the input `from` with the last pose or (`at_design`)
    /// the design pose, in as many pieces as the way is long.
    fn pose(
        &mut self,
        from: &SuspensionInput,
        input: &SuspensionInput,
        at_design: bool,
    ) -> Result<Solved, Failure> {
        let moves = [
            input.rack_m - from.rack_m,
            input.wheel_height_m[0] - from.wheel_height_m[0],
            input.wheel_height_m[1] - from.wheel_height_m[1],
        ];
        let longest = moves.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        let pieces = (longest / STEP_INPUT_MAX_M).ceil().clamp(1.0, PIECES_MAX);
        let count = pieces as u32;
        if at_design {
            self.trial.copy_from_slice(&self.design);
        } else if count == 1 {
            // The parts go on as they went in the last tick: then two Newton steps do.
            for ((trial, now), before) in self.trial.iter_mut().zip(&self.poses).zip(&self.previous) {
                let turn = before.p.relative_to(now.p);
                *trial = Pose { r: now.r + (now.r - before.r), p: now.p.then(turn).normalised() };
            }
        } else {
            self.trial.copy_from_slice(&self.poses);
        }
        if let Solver::Elastic { equilibrium, .. } = &mut self.solver {
            if at_design {
                equilibrium.lambda_mut().fill(0.0);
            } else {
                equilibrium.lambda_mut().copy_from_slice(&self.lambda);
            }
        }
        let mut total = Solved::default();
        for piece in 1..=count {
            let share = f64::from(piece) / pieces;
            let mut at = *input;
            if piece < count {
                at.rack_m = from.rack_m + share * moves[0];
                at.wheel_height_m = [0, 1].map(|side| from.wheel_height_m[side] + share * moves[1 + side]);
            }
            let drives = drives(&self.sides, &at);
            self.prepare_loads(from, input, share);
            let solved = self.solver.position(&mut self.trial, &drives, &mut self.load)?;
            total = Solved { iterations: total.iterations + solved.iterations, residual: solved.residual };
        }
        Ok(total)
    }

    /// Velocities and forces at the trial pose; writes `good`. `fresh` unless it has just been solved.
    fn forces(&mut self, input: &SuspensionInput, fresh: bool) -> Result<(), Failure> {
        let drives = drives(&self.sides, input);
        if let Solver::Elastic { equilibrium, .. } = &mut self.solver {
            // Velocities are those at which the dampers' forces do not change.
            equilibrium.no_damping();
        }
        self.solver.velocity(&self.trial, &drives, &self.load, fresh, &mut self.twists)?;
        if self.sides.iter().any(|s| matches!(s.steering_axis, model::SteeringAxis::Instantaneous)) {
            let mut unit = drives;
            unit[0].speed = 1.0;
            unit[1].speed = 0.0;
            unit[2].speed = 0.0;
            // A function of the pose alone, so that a restored state finds the same axis.
            self.solver.velocity(&self.trial, &unit, &self.load, true, &mut self.axis_twists)?;
        }
        self.solver.follow(&self.trial, &mut self.force_poses);
        let mut side_outputs = [SideOutput::default(); 2];
        self.read_pose(input, &mut side_outputs);
        self.fill_load(input, &mut side_outputs);
        self.solver.reactions(&self.force_poses, &drives, &self.load, &mut self.lambda)?;
        self.read_forces(&mut side_outputs);
        Ok(())
    }

    /// Lets the kingpin friction follow the knuckles' rotation from the last pose to the trial pose.
    fn turn_friction(&mut self) {
        let Some(friction) = &mut self.friction else { return };
        for (side, friction) in friction.iter_mut().enumerate() {
            let body = self.sides[side].knuckle;
            let turned = self.poses[body].p.relative_to(self.trial[body].p).rotation_vector();
            let axis = self.trial[body].p.matrix().tr_mul(&readout::steering_direction(
                &self.sides[side],
                &self.trial,
                &self.axis_twists,
            ));
            friction.turn(turned.dot(&axis));
        }
    }
}

type Assembled = (Solver, [Side; 2], Option<Bar>, Vec<Pose>, Vec<(String, usize, usize)>);

/// Two rigid stages.
fn rigid(axle: &Axle, path: SolverPath) -> Result<Assembled, AssemblyError> {
    let model: Model = assemble::assemble(axle)?;
    let drives = drives(&model.sides, &SuspensionInput::DESIGN);
    let stage = |name: &str, builder: &model::Builder| {
        let name = format!("{} ({name})", axle.name);
        Stage::new(&name, builder.mechanism(), &builder.design, &drives, path)
    };
    let kinematic = stage("kinematic", &model.kinematic)?;
    let mut reaction = Box::new(stage("reaction", &model.reaction)?);
    let body =
        |follow: &model::Follow| if let model::Follow::Same(body) = follow { Some(*body) } else { None };
    let same: Vec<Option<usize>> = model.follow.iter().map(body).collect();
    let shared = kinematic.share_rows(&mut reaction, &same);
    let solver = Solver::Rigid { kinematic, reaction, follow: model.follow, shared };
    Ok((solver, model.sides, model.bar, model.kinematic.design, Vec::new()))
}

/// One elastic equilibrium.
fn elastic(axle: &Axle) -> Result<Assembled, AssemblyError> {
    let model = compliant::assemble_compliant(axle)?;
    let drives = drives(&model.sides, &SuspensionInput::DESIGN);
    let design = model.builder.design.clone();
    let equilibrium = Equilibrium::new(
        model.builder.mechanism(),
        &design,
        &[BODY, RACK],
        model.bushings,
        model.torsion,
        model.carriers,
        &drives,
    )
    .map_err(|at| AssemblyError::Redundant {
        mechanism: format!("{} (with bushings)", axle.name),
        constraints: vec![at],
    })?;
    let wrenches = vec![Wrench::ZERO; design.len()];
    let rack_design = design[RACK].r;
    let solver = Solver::Elastic { equilibrium: Box::new(equilibrium), wrenches, rack_design };
    Ok((solver, model.sides, model.bar, design, model.bushing_names))
}

/// The drivers at an input: rack stroke, then both wheel-centre heights.
fn drives(sides: &[Side; 2], input: &SuspensionInput) -> [Drive; 3] {
    let height = |side: usize| Drive {
        value: sides[side].wheel_centre_z + input.wheel_height_m[side],
        speed: input.wheel_speed_m_s[side],
        acceleration: 0.0,
    };
    let rack = Drive { value: input.rack_m, speed: input.rack_speed_m_s, acceleration: 0.0 };
    [rack, height(0), height(1)]
}

/// Axial force of a link from its multiplier, 2Cλ, + tension.
fn link_force(kind: &Kind, length_m: f64, lambda: f64) -> f64 {
    debug_assert!(matches!(kind, Kind::Distance { .. }));
    2.0 * length_m * lambda
}

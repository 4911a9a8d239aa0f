//! Steered suspensions in two stages, after the source's chapter 4.4.
//!
//! Stage 1 solves the pose with the rack stroke and both wheel-centre heights as drivers. Stage 2 keeps
//! that pose, swaps the height drivers for the mechanism that carries the load (spring and damper), and
//! solves the constraint forces: a driver and a load on the same body would cancel, so with the drivers in
//! place the vertical load would never reach the tie rod. The parts have no mass here; the spring is a
//! massless link of the length found in stage 1. The stabiliser's torque acts on its halves only.

use config::Check;
use config::axle::Axle;
use spatial::Vector3;

use crate::body::{Pose, Twist};
use crate::constraint::{Drive, Kind};
use crate::failure::{AssemblyError, Failure, Reason, Solved};
use crate::mechanism::Description;

mod assemble;
mod friction;
mod io;
mod model;
mod readout;
mod stage;

pub use io::{SideOutput, Status, SuspensionInput, SuspensionOutput};

use friction::KingpinFriction;
use model::Model;
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
    /// Stage 2: forces.
    pub reaction: Description,
}

/// A suspension: model, last pose, preallocated workspace.
#[derive(Debug, Clone)]
pub struct Suspension {
    model: Model,
    kinematic: Stage,
    reaction: Stage,
    poses: Vec<Pose>,
    trial: Vec<Pose>,
    twists: Vec<Twist>,
    axis_twists: Vec<Twist>,
    reaction_poses: Vec<Pose>,
    load: Vec<f64>,
    lambda: Vec<f64>,
    friction: Option<[KingpinFriction; 2]>,
    input: SuspensionInput,
    good: SuspensionOutput,
    held_ticks: u64,
}

impl Suspension {
    /// Assembles the axle's two stages, on the structured path.
    ///
    /// # Errors
    /// All broken rules of the axle; or the constraint that is redundant, singular or not met at design.
    pub fn new(axle: &Axle) -> Result<Self, AssemblyError> {
        Self::with_path(axle, SolverPath::default())
    }

    /// Assembles the axle's two stages for the given solver.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn with_path(axle: &Axle, path: SolverPath) -> Result<Self, AssemblyError> {
        let broken = axle.broken();
        if !broken.is_empty() {
            return Err(AssemblyError::Axle(broken));
        }
        let model = assemble::assemble(axle)?;
        let drives = drives(&model, &SuspensionInput::DESIGN);
        let stage = |name: &str, builder: &model::Builder| {
            Stage::new(
                &format!("{} ({name})", axle.name),
                builder.mechanism(),
                &builder.design,
                &drives,
                path,
            )
        };
        let kinematic = stage("kinematic", &model.kinematic)?;
        let reaction = stage("reaction", &model.reaction)?;
        let poses = model.kinematic.design.clone();
        let friction =
            axle.kingpin_friction.as_ref().map(|f| [KingpinFriction::new(f), KingpinFriction::new(f)]);
        let mut suspension = Self {
            trial: poses.clone(),
            twists: vec![Twist::ZERO; poses.len()],
            axis_twists: vec![Twist::ZERO; poses.len()],
            reaction_poses: model.reaction.design.clone(),
            load: vec![0.0; 6 * model.reaction.bodies.len()],
            lambda: vec![0.0; reaction.mechanism().rows()],
            kinematic,
            reaction,
            poses,
            friction,
            input: SuspensionInput::DESIGN,
            good: SuspensionOutput::default(),
            held_ticks: 0,
            model,
        };
        suspension.reset();
        Ok(suspension)
    }

    /// Back to the design pose, unloaded, without memory.
    pub fn reset(&mut self) {
        self.poses.copy_from_slice(&self.model.kinematic.design);
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
            kinematic: self.kinematic.mechanism().describe(),
            reaction: self.reaction.mechanism().describe(),
        }
    }

    /// Name of a constraint of stage 1, as numbered in [`Status::Held`].
    #[must_use]
    pub fn constraint_name(&self, index: usize) -> Option<&str> {
        self.kinematic.mechanism().constraints().get(index).map(|c| c.name.as_str())
    }

    /// Numbers in the state.
    #[must_use]
    pub fn state_len(&self) -> usize {
        7 * self.poses.len() + SuspensionInput::LEN + 2 + 1
    }

    /// Writes the state: poses, last good input, friction, ticks held.
    ///
    /// # Panics
    /// If `state` is not [`Self::state_len`] long.
    pub fn save_state(&self, state: &mut [f64]) {
        assert_eq!(state.len(), self.state_len());
        let (poses, rest) = state.split_at_mut(7 * self.poses.len());
        for (to, pose) in poses.chunks_exact_mut(7).zip(&self.poses) {
            to.copy_from_slice(&pose.to_array());
        }
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
        let (poses, rest) = state.split_at(7 * self.poses.len());
        for (pose, from) in self.poses.iter_mut().zip(poses.chunks_exact(7)) {
            let mut q = [0.0; 7];
            q.copy_from_slice(from);
            *pose = Pose::from_array(q);
        }
        self.input = SuspensionInput::from_array(rest);
        if let Some(friction) = &mut self.friction {
            friction[0].set_moment_n_m(rest[SuspensionInput::LEN]);
            friction[1].set_moment_n_m(rest[SuspensionInput::LEN + 1]);
        }
        self.held_ticks = rest[SuspensionInput::LEN + 2] as u64;
        self.refresh();
    }

    /// The last good output again, from pose, input and friction.
    fn refresh(&mut self) {
        self.trial.copy_from_slice(&self.poses);
        let input = self.input;
        // The pose is a solved one: a failure can only mean a state that was not saved by this model; the
        // output then stays what it was, and the next tick is held.
        let _ = self.forces(&input, true);
    }

    fn solve(&mut self, input: &SuspensionInput) -> Result<Solved, Failure> {
        let failure = |reason| Failure { reason, constraint: None, iterations: 0, residual: 0.0 };
        if !input.is_finite() {
            return Err(failure(Reason::NotFinite));
        }
        let from = self.input;
        let moves = [
            input.rack_m - from.rack_m,
            input.wheel_height_m[0] - from.wheel_height_m[0],
            input.wheel_height_m[1] - from.wheel_height_m[1],
        ];
        let longest = moves.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        let pieces = (longest / STEP_INPUT_MAX_M).ceil().clamp(1.0, PIECES_MAX);
        self.trial.copy_from_slice(&self.poses);
        let mut total = Solved::default();
        let count = pieces as u32;
        for piece in 1..=count {
            let share = f64::from(piece) / pieces;
            let mut at = *input;
            if piece < count {
                at.rack_m = from.rack_m + share * moves[0];
                at.wheel_height_m = [0, 1].map(|side| from.wheel_height_m[side] + share * moves[1 + side]);
            }
            let drives = drives(&self.model, &at);
            let solved = self.kinematic.position(&mut self.trial, &drives)?;
            total = Solved { iterations: total.iterations + solved.iterations, residual: solved.residual };
        }
        self.turn_friction();
        self.forces(input, false)?;
        self.poses.copy_from_slice(&self.trial);
        self.input = *input;
        Ok(total)
    }

    /// Velocities and stage 2 at the trial pose; writes `good`. `fresh` unless stage 1 has just ended there.
    fn forces(&mut self, input: &SuspensionInput, fresh: bool) -> Result<(), Failure> {
        let drives = drives(&self.model, input);
        self.kinematic.velocity(&self.trial, &drives, fresh, &mut self.twists)?;
        if self.model.sides.iter().any(|s| matches!(s.steering_axis, model::SteeringAxis::Instantaneous)) {
            let mut unit = drives;
            unit[0].speed = 1.0;
            unit[1].speed = 0.0;
            unit[2].speed = 0.0;
            // A function of the pose alone, so that a restored state finds the same axis.
            self.kinematic.velocity(&self.trial, &unit, true, &mut self.axis_twists)?;
        }
        for (pose, follow) in self.reaction_poses.iter_mut().zip(&self.model.follow) {
            *pose = follow.pose(&self.trial);
        }
        let mut side_outputs = [SideOutput::default(); 2];
        self.read_pose(input, &mut side_outputs);
        self.fill_load(input, &mut side_outputs);
        self.reaction.reactions(&self.reaction_poses, &drives, &self.load, &mut self.lambda)?;
        self.read_forces(&mut side_outputs);
        Ok(())
    }

    /// Lets the kingpin friction follow the knuckles' rotation from the last pose to the trial pose.
    fn turn_friction(&mut self) {
        let Some(friction) = &mut self.friction else { return };
        for (side, friction) in friction.iter_mut().enumerate() {
            let body = self.model.sides[side].knuckle;
            let turned = self.poses[body].p.relative_to(self.trial[body].p).rotation_vector();
            let axis = self.trial[body].p.matrix().tr_mul(&readout::steering_direction(
                &self.model.sides[side],
                &self.trial,
                &self.axis_twists,
            ));
            friction.turn(turned.dot(&axis));
        }
    }
}

/// The drivers at an input: rack stroke, then both wheel-centre heights.
fn drives(model: &Model, input: &SuspensionInput) -> [Drive; 3] {
    let height = |side: usize| Drive {
        value: model.sides[side].wheel_centre_z + input.wheel_height_m[side],
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

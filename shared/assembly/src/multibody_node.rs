//! The multibody node: rack and wheel travel give the pose, wheel forces give the tie-rod forces.

use crate::AssemblyError;
use crate::guard::{Guard, Verdict};
use crate::live::Live;
use config::ResolvedBench;
use multibody::{Status, Suspension, SuspensionInput, SuspensionOutput};
use nalgebra::Vector3;
use params::{Id, value};
use regions::{
    MultibodyCheckpoint, NO_TICK, Parameters, Payload, RegionId, RigMeasurement, SuspensionState,
    VehicleState, model_flags,
};
use runtime::{InputSpec, Inputs, Model, NodeSpec, Step, When};

const READS: &[InputSpec] = &[
    InputSpec { region: RegionId::RigMeasurement, when: When::SameTick },
    InputSpec { region: RegionId::VehicleState, when: When::SameTick },
    InputSpec { region: RegionId::Parameters, when: When::Latest },
];
const NODES: &[NodeSpec] = &[NodeSpec {
    name: "multibody",
    reads: READS,
    writes: RegionId::SuspensionState,
    checkpoint: Some(RegionId::MultibodyCheckpoint),
    rings: true,
}];

/// Forces beyond this are no wheel's. [N], [N·m]
const FORCE_MAX: f64 = 1e6;

/// The front suspension.
pub struct MultibodyNode {
    suspension: Suspension,
    output: SuspensionOutput,
    input: SuspensionInput,
    period_s: f64,
    rack_max_m: f64,
    ball_design_m: [f64; 2],
    rig_guard: Guard,
    vehicle_guard: Guard,
    used: [u64; 2],
    restored: bool,
    live: Live,
    force_scale: f64,
    last: SuspensionState,
}

impl MultibodyNode {
    /// Builds the suspension from its hardpoints.
    ///
    /// # Errors
    /// What is wrong with them.
    pub fn new(resolved: &ResolvedBench) -> Result<Self, AssemblyError> {
        let axle = &resolved.front_axle;
        let mut suspension = Suspension::new(axle).map_err(|e| AssemblyError::new("front axle", [e]))?;
        let mut output = SuspensionOutput::default();
        suspension.step(&SuspensionInput::DESIGN, &mut output);
        if output.status != Status::Converged {
            return Err(AssemblyError::new(
                "front axle",
                ["the design pose cannot be solved: check the hardpoints"],
            ));
        }
        let limit = resolved.rig.limits.stale_ticks;
        let mut last = SuspensionState::absent();
        (last.used_rig_measurement, last.used_vehicle_state) = (NO_TICK, NO_TICK);
        let ball_design_m = [output.side[0].tie_rod_ball_m.z, output.side[1].tie_rod_ball_m.z];
        if suspension.state_len() + OWN > MultibodyCheckpoint::absent().state.len() {
            return Err(AssemblyError::new("front axle", ["its state does not fit the checkpoint region"]));
        }
        suspension.reset();
        suspension.set_period(Some(resolved.scenario.timing.period_s()));
        Ok(MultibodyNode {
            suspension,
            output,
            input: SuspensionInput::DESIGN,
            period_s: resolved.scenario.timing.period_s(),
            rack_max_m: axle.rack_stroke_m,
            ball_design_m,
            rig_guard: Guard::new(limit),
            vehicle_guard: Guard::new(limit),
            used: [NO_TICK; 2],
            restored: false,
            live: Live::default(),
            force_scale: 1.0,
            last,
        })
    }
}

/// Words of the node's own state behind the suspension's in a checkpoint: the input in force and the last output, for a
/// first step behind a restart that finds its inputs missing.
const OWN: usize = SuspensionInput::LEN + size_of::<SuspensionState>() / 8;

fn vectors(words: &[f64]) -> [Vector3<f64>; 2] {
    [Vector3::new(words[0], words[1], words[2]), Vector3::new(words[3], words[4], words[5])]
}

impl Model for MultibodyNode {
    fn nodes(&self) -> &'static [NodeSpec] {
        NODES
    }

    fn step(&mut self, _: usize, step: &Step, inputs: &Inputs, output: &mut [u64]) {
        let (measured, rig_input) = inputs.get::<RigMeasurement>(0);
        let (car, car_input) = inputs.get::<VehicleState>(1);
        let (parameters, parameters_input) = inputs.get::<Parameters>(2);
        if let Some(values) = self.live.news(parameters, parameters_input) {
            self.force_scale = value(values, Id::TieRodForceScale);
        }
        let mut flags = 0;

        let rack = measured.rack_displacement_m;
        let plausible = rack.is_finite() && rack.abs() <= 1.5 * self.rack_max_m;
        let rig = self.rig_guard.judge(step, rig_input, plausible, self.used[0], &mut flags);
        let force = &car.wheel_centre_force_n[..6];
        let moment = &car.wheel_centre_moment_n_m[..6];
        let plausible = force.iter().chain(moment).all(|f| f.abs() <= FORCE_MAX)
            && car.wheel_travel_m[..2].iter().chain(&car.wheel_travel_speed_m_s[..2]).all(|v| v.is_finite())
            && car.flags & (model_flags::STALE | model_flags::MODEL_FAULT) == 0;
        let vehicle = self.vehicle_guard.judge(step, car_input, plausible, self.used[1], &mut flags);

        if rig == Verdict::Good {
            self.input.rack_m = rack;
            self.input.rack_speed_m_s = measured.rack_speed_m_s;
            self.used[0] = rig_input.tick();
        }
        if vehicle == Verdict::Good {
            self.input.wheel_height_m = [car.wheel_travel_m[0], car.wheel_travel_m[1]];
            self.input.wheel_speed_m_s = [car.wheel_travel_speed_m_s[0], car.wheel_travel_speed_m_s[1]];
            self.input.wheel_force_n = vectors(force);
            self.input.wheel_moment_n_m = vectors(moment);
            self.used[1] = car_input.tick();
        }
        if std::mem::take(&mut self.restored) {
            flags |= model_flags::RESTORED;
        }
        let state = &mut self.last;
        if rig != Verdict::Stale && vehicle != Verdict::Stale {
            self.suspension.step(&self.input, &mut self.output);
            if self.output.status != Status::Converged {
                flags |= model_flags::HELD_POSE;
            }
            fill(state, &self.output, &self.ball_design_m);
            state.tie_rod_force_n = state.tie_rod_force_n.map(|force| self.force_scale * force);
            state.rack_displacement_m = self.input.rack_m;
            // Compared where both speak of the same tick; a word that was refused is not one.
            for side in (0..2).filter(|_| vehicle == Verdict::Good) {
                state.toe_map_error_rad[side] = car.toe_rad[side] - state.toe_rad[side];
                state.camber_map_error_rad[side] = car.camber_rad[side] - state.camber_rad[side];
            }
        }
        state.tick = step.n;
        state.time_s = (step.n + 1) as f64 * self.period_s;
        state.flags = flags;
        state.parameters_version = self.live.version();
        (state.used_rig_measurement, state.used_vehicle_state) = (self.used[0], self.used[1]);
        state.held_count = self.rig_guard.held_count() + self.vehicle_guard.held_count();
        output.copy_from_slice(state.words());
    }

    fn save(&self, n: u64, words: &mut [u64]) {
        let checkpoint: &mut [MultibodyCheckpoint] = bytemuck::cast_slice_mut(words);
        let checkpoint = &mut checkpoint[0];
        let len = self.suspension.state_len();
        checkpoint.tick = n;
        checkpoint.len = (len + OWN) as u64;
        checkpoint.counters =
            [self.rig_guard.held_count(), self.vehicle_guard.held_count(), self.used[0], self.used[1], 0, 0];
        self.suspension.save_state(&mut checkpoint.state[..len]);
        let (input, last) = checkpoint.state[len..len + OWN].split_at_mut(SuspensionInput::LEN);
        input.copy_from_slice(&self.input.to_array());
        // Bits, whatever they mean.
        bytemuck::cast_slice_mut::<f64, u64>(last).copy_from_slice(self.last.words());
    }

    fn unpublished(&mut self) {
        self.restored |= self.last.flags & model_flags::RESTORED != 0;
    }

    fn restore(&mut self, words: &[u64]) -> bool {
        let checkpoint: &[MultibodyCheckpoint] = bytemuck::cast_slice(words);
        let checkpoint = &checkpoint[0];
        let len = self.suspension.state_len();
        let (input, last) = checkpoint.state[len..len + OWN].split_at(SuspensionInput::LEN);
        let numbers = checkpoint.state[..len].iter().chain(input);
        if checkpoint.len != (len + OWN) as u64 || !numbers.copied().all(f64::is_finite) {
            return false;
        }
        self.suspension.load_state(&checkpoint.state[..len]);
        self.input = SuspensionInput::from_array(input);
        self.last.words_mut().copy_from_slice(bytemuck::cast_slice(last));
        self.rig_guard.restore(checkpoint.counters[0]);
        self.vehicle_guard.restore(checkpoint.counters[1]);
        self.used = [checkpoint.counters[2], checkpoint.counters[3]];
        self.restored = true;
        true
    }
}

fn fill(state: &mut SuspensionState, o: &SuspensionOutput, ball_design_m: &[f64; 2]) {
    state.solver_status = u64::from(o.status.code());
    state.iterations = u64::from(o.iterations);
    state.residual_m = o.residual;
    state.rack_force_n = o.rack_force_n;
    for (i, side) in o.side.iter().enumerate() {
        state.tie_rod_force_n[i] = side.tie_rod_force_n;
        state.tie_rod_ball_m[3 * i..3 * i + 3].copy_from_slice(side.tie_rod_ball_m.as_slice());
        state.tie_rod_ball_velocity_m_s[3 * i..3 * i + 3]
            .copy_from_slice(side.tie_rod_ball_velocity_m_s.as_slice());
        state.ball_height_m[i] = side.tie_rod_ball_m.z - ball_design_m[i];
        state.ball_height_speed_m_s[i] = side.tie_rod_ball_velocity_m_s.z;
        state.wheel_centre_m[3 * i..3 * i + 3].copy_from_slice(side.wheel_centre_m.as_slice());
        state.knuckle_quaternion[4 * i..4 * i + 4].copy_from_slice(&side.knuckle_quaternion);
        state.steer_rad[i] = side.steer_rad;
        state.toe_rad[i] = side.toe_rad;
        state.camber_rad[i] = side.camber_rad;
        state.caster_rad[i] = side.caster_rad;
        state.kingpin_inclination_rad[i] = side.kingpin_inclination_rad;
        state.kingpin_moment_n_m[i] = side.kingpin_moment_n_m;
        state.spring_force_n[i] = side.spring_force_n;
    }
}

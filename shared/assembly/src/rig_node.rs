//! The rig node: sensors at the start of a tick; safety, controller and actuators at the output phase.
//!
//! The plant is the virtual one. It is integrated with exactly the timing of the loop: up to the output
//! phase on the command before, from there on the new one. Whether inputs are fresh is counted here, in
//! output phases that were really executed; what follows from it is safety's.

use crate::AssemblyError;
use crate::live::{HumanSteer, Live, RigTuning};
use crate::wheel::Wheel;
use config::can::AssistSource;
use config::rig::{Rig, SteerDevice};
use config::{Broken, ResolvedBench};
use functional_model::Model as FunctionalModel;
use regions::{
    Bench, Can, Fault, NO_TICK, Parameters, Payload, RegionId, RigMeasurement, RigStatus, SuspensionState,
    VehicleState, fault_kind, model_flags, rig_flags,
};
use rig_control::{ControlDiagnostics, RackEstimate, RigCommand, RigController, SteerCommand};
use rig_plant::{Actuation, Channel, ComposedUnit, Measurement, RigEnvironment, VirtualRig};
use runtime::{InputSpec, Inputs, Model, NodeSpec, Step, When};
use safety::{EcuWord, OperatorRequest, Safety, SafetyInput};

const READS: &[InputSpec] = &[
    InputSpec { region: RegionId::VehicleState, when: When::SameTick },
    InputSpec { region: RegionId::SuspensionState, when: When::SameTick },
    InputSpec { region: RegionId::Bench, when: When::Latest },
    InputSpec { region: RegionId::Parameters, when: When::Latest },
];
/// Where the ECU on the bus drives the unit's motor. What it says follows from what the rig did before.
const READS_WITH_ECU: &[InputSpec] =
    &[READS[0], READS[1], READS[2], READS[3], InputSpec { region: RegionId::Can, when: When::Previous }];
const SAMPLE: NodeSpec = NodeSpec {
    name: "rig_sample",
    reads: &[],
    writes: RegionId::RigMeasurement,
    checkpoint: None,
    rings: true,
};
const APPLY: NodeSpec =
    NodeSpec { name: "rig_apply", reads: READS, writes: RegionId::RigStatus, checkpoint: None, rings: false };
const NODES: &[NodeSpec] = &[SAMPLE, APPLY];
const NODES_WITH_ECU: &[NodeSpec] = &[SAMPLE, NodeSpec { reads: READS_WITH_ECU, rings: true, ..APPLY }];

/// Without a word from the supervisor for this long the rig stops safely. [s]
const SUPERVISOR_MAX_S: f64 = 10.0;
/// The virtual hardware's own watchdog: without a command for this long its valves close. [s]
const WATCHDOG_S: f64 = 0.02;
/// A stall is made up for in the virtual plant by at most this. [s]
const STALL_MAX_S: f64 = 2.0;
/// No steering angle, rate or speed of a car is that large. [rad], [rad/s], [m/s]
const IMPLAUSIBLE: f64 = 1e3;
/// No tie rod carries that much. [N]
const IMPLAUSIBLE_N: f64 = 1e6;
/// Corner of the rack-speed observer. [Hz]
const RACK_SPEED_HZ: f64 = 30.0;

/// The rig with its plant.
pub struct RigNode {
    plant: VirtualRig,
    controller: RigController,
    safety: Safety,
    period_s: f64,
    before_phase_s: f64,
    after_phase_s: f64,
    output_phase_s: f64,
    supervisor_max_ticks: u64,
    measurement: Measurement,
    actuation: Actuation,
    command: RigCommand,
    diagnostics: ControlDiagnostics,
    /// A human at a wheel device, in place of the manoeuvre's steering.
    wheel: Option<Wheel>,
    rack: RackEstimate,
    rack_speed: RackSpeed,
    started: bool,
    missed: u64,
    stale: u64,
    late: u64,
    used: [u64; 3],
    /// The ECU on the bus drives the unit's motor.
    ecu_drives: bool,
    environment: RigEnvironment,
    requests_seen: u64,
    request_pending: OperatorRequest,
    no_supervisor: bool,
    /// Orders of a fault campaign to the sensors, with the reading that a stuck one holds.
    sensor_faults: [Option<(Fault, f64)>; 4],
    live: Live,
    tuning: RigTuning,
    human: HumanSteer,
    status: RigStatus,
}

/// Rack speed from the measured stroke: a critically damped observer of second order.
#[derive(Debug, Clone, Copy)]
struct RackSpeed {
    stroke_m: f64,
    speed_m_s: f64,
    gains: [f64; 2],
    period_s: f64,
    started: bool,
}

impl RackSpeed {
    fn new(period_s: f64) -> Self {
        let pole = (-std::f64::consts::TAU * RACK_SPEED_HZ * period_s).exp();
        // Both poles of the prediction-correction form at `pole`.
        let gains = [1.0 - pole * pole, (1.0 - pole) * (1.0 - pole)];
        RackSpeed { stroke_m: 0.0, speed_m_s: 0.0, gains, period_s, started: false }
    }

    fn step(&mut self, measured_m: f64) -> f64 {
        if !measured_m.is_finite() {
            return self.speed_m_s;
        }
        if !std::mem::replace(&mut self.started, true) {
            self.stroke_m = measured_m;
        }
        let predicted = self.stroke_m + self.speed_m_s * self.period_s;
        let error = measured_m - predicted;
        self.stroke_m = predicted + self.gains[0] * error;
        self.speed_m_s += self.gains[1] * error / self.period_s;
        self.speed_m_s
    }
}

/// The largest sub-step not above the configured one of which both the period and the output phase are whole
/// numbers (the phase to within 2 % of the period).
fn sub_steps(rig: &Rig, period_s: f64, output_phase: f64) -> (f64, u32, u32) {
    let fewest = (period_s / rig.plant.sub_step_s - 1e-9).ceil().max(1.0) as u32;
    let whole = |count: u32| {
        let at = output_phase * f64::from(count);
        ((at - at.round()) / f64::from(count)).abs() < 0.02
    };
    let count = (fewest..fewest + 50).find(|&count| whole(count)).unwrap_or(fewest);
    let before = (output_phase * f64::from(count)).round() as u32;
    (period_s / f64::from(count), before, count - before)
}

/// The virtual rig around the built-in steering unit, or around the one its file composes.
fn virtual_rig(resolved: &ResolvedBench, rig: &Rig, period_s: f64) -> Result<VirtualRig, AssemblyError> {
    let (unit, seed) = (&resolved.unit, resolved.scenario.seed);
    let refused = |part: &'static str| {
        move |broken: Vec<Broken>| {
            AssemblyError::new(part, broken.into_iter().map(|b| format!("{}: {}", b.key, b.rule)))
        }
    };
    let (Some(named), Some(files)) = (&unit.model, &resolved.unit_model) else {
        return VirtualRig::new(rig, unit, seed, period_s).map_err(refused("rig"));
    };
    let model = FunctionalModel::from_toml(&files.main.text, &files.main.name, &|name| files.part(name))
        .map_err(|errors| AssemblyError::new("unit", errors))?;
    let set: Vec<(String, String)> =
        named.set.iter().flatten().map(|(name, value)| (name.clone(), value.clone())).collect();
    let upstream = match rig.plant.steer.device {
        SteerDevice::Actuator => rig.plant.steer.inertia_kg_m2,
        SteerDevice::MeasuringWheel => unit.hand_wheel_inertia_kg_m2,
    };
    let ratio = unit.rack_travel_m_per_rev / std::f64::consts::TAU;
    let composed =
        ComposedUnit::new(&model, &set, upstream, ratio, rig.plant.sub_step_s).map_err(refused("unit"))?;
    VirtualRig::with_unit(rig, Box::new(composed), seed, period_s).map_err(refused("rig"))
}

/// Whether the ECU on the bus drives the unit's motor: the scenario asks for it, its mapping receives the torque, and
/// the unit has a motor that takes it.
fn ecu_drives(resolved: &ResolvedBench, plant: &VirtualRig) -> Result<bool, AssemblyError> {
    const TARGET: &str = "can.ecu_assist_torque_n_m";
    let asked = resolved.scenario.can.as_ref().and_then(|can| can.assist);
    let (Some(AssistSource::Ecu), Some(can)) = (asked, &resolved.can) else { return Ok(false) };
    let mut faults = Vec::new();
    let signals = can.mapping.receive.iter().flat_map(|message| &message.signals);
    if !signals.into_iter().any(|signal| signal.target == TARGET) {
        faults.push(format!(
            "can.assist = \"ecu\" needs a received signal with the target {TARGET} in the mapping"
        ));
    }
    if !plant.takes_assist_request() {
        faults.push(format!(
            "can.assist = \"ecu\": unit {} has no motor that takes a torque from outside (a built-in electric assist, or \
             a model file with the input `assist_request`)",
            resolved.unit.name
        ));
    }
    if faults.is_empty() { Ok(true) } else { Err(AssemblyError::new("scenario", faults)) }
}

impl RigNode {
    /// Builds the rig from its files.
    ///
    /// # Errors
    /// Everything that is wrong with them.
    pub fn new(resolved: &ResolvedBench) -> Result<Self, AssemblyError> {
        let scenario = &resolved.scenario;
        let period_s = scenario.timing.period_s();
        let refused = |part: &'static str| {
            move |broken: Vec<Broken>| {
                AssemblyError::new(part, broken.into_iter().map(|b| format!("{}: {}", b.key, b.rule)))
            }
        };
        let mut rig = resolved.rig.clone();
        let (step_s, before, after) = sub_steps(&rig, period_s, scenario.timing.output_phase);
        rig.plant.sub_step_s = step_s;
        let unit = &resolved.unit;
        let plant = virtual_rig(resolved, &rig, period_s)?;
        let ecu_drives = ecu_drives(resolved, &plant)?;
        let mut status = RigStatus::absent();
        status.flags = rig_flags::VIRTUAL;
        Ok(RigNode {
            plant,
            controller: RigController::with_phase(&rig, unit, period_s, f64::from(before) * step_s)
                .map_err(refused("rig"))?,
            safety: Safety::new(&rig, unit, period_s, true).map_err(refused("rig"))?,
            period_s,
            before_phase_s: f64::from(before) * step_s,
            after_phase_s: f64::from(after) * step_s,
            output_phase_s: scenario.timing.output_phase_s(),
            supervisor_max_ticks: (SUPERVISOR_MAX_S / period_s) as u64,
            measurement: Measurement::default(),
            actuation: Actuation::default(),
            command: RigCommand::default(),
            diagnostics: ControlDiagnostics::default(),
            wheel: scenario.wheel.as_ref().map(|wheel| Wheel::new(wheel, period_s)).transpose()?,
            rack: RackEstimate::new(unit, &rig.control, period_s),
            rack_speed: RackSpeed::new(period_s),
            started: false,
            missed: 0,
            stale: 0,
            late: 0,
            used: [NO_TICK; 3],
            ecu_drives,
            environment: RigEnvironment::default(),
            requests_seen: 0,
            request_pending: OperatorRequest::SwitchOn,
            no_supervisor: false,
            sensor_faults: [None; 4],
            live: Live::default(),
            tuning: RigTuning::new(resolved),
            human: HumanSteer::default(),
            status,
        })
    }

    /// The plant goes on while its controller does not: first on the last command, then its watchdog closes.
    fn pass(&mut self, ticks: u64) {
        let watchdog = (WATCHDOG_S / self.period_s) as u64;
        let most = (STALL_MAX_S / self.period_s) as u64;
        for k in 0..ticks.min(most) {
            if k == watchdog {
                self.actuation = Actuation::default();
                self.plant.set_actuation(&self.actuation);
            }
            self.plant.advance(self.before_phase_s + self.after_phase_s);
        }
    }

    /// What a campaign's orders make of the readings of tick `n`.
    fn spoil_sensors(&mut self, n: u64) {
        for slot in &mut self.sensor_faults {
            let Some((order, held)) = slot else { continue };
            if n >= order.end_tick {
                *slot = None;
                continue;
            }
            let mut readings = self.measurement.channels();
            let channel = order.value[0] as usize;
            let Some(reading) = readings.get_mut(channel).filter(|_| n >= order.from_tick) else { continue };
            let mut validity = self.measurement.validity;
            match order.value[1] as u64 {
                0 => validity &= !(1 << channel),
                1 if held.is_nan() => *held = *reading,
                1 => *reading = *held,
                _ => *reading += order.value[2],
            }
            self.measurement = Measurement::from_channels(&readings, validity);
        }
    }

    fn sample(&mut self, step: &Step, output: &mut [u64]) {
        let first = !std::mem::replace(&mut self.started, true);
        // A rig that was started again has a plant that was started again: at rest, and off.
        self.missed = if first { 0 } else { step.skipped };
        self.pass(self.missed);
        self.plant.sample(&mut self.measurement);
        self.spoil_sensors(step.n);
        let m = &self.measurement;
        let mut region = RigMeasurement::absent();
        region.tick = step.n;
        region.time_s = step.n as f64 * self.period_s;
        region.flags = rig_flags::VIRTUAL | if self.missed > 0 { rig_flags::STALLED } else { 0 };
        region.sensor_faults = !m.validity & Measurement::ALL_VALID;
        region.steering_wheel_angle_rad = m.steering_wheel_angle_rad;
        region.steering_wheel_torque_n_m = m.steering_wheel_torque_n_m;
        region.torsion_bar_torque_n_m = m.torsion_bar_torque_n_m;
        region.assist_torque_n_m = m.assist_torque_n_m;
        // A potentiometer that is not believed is not joined: the models then judge the reading itself.
        let rack_m = self.rack.step(m);
        let believed = m.is_valid(Channel::RackDisplacement) && m.rack_displacement_m.is_finite();
        region.rack_displacement_m = if believed { rack_m } else { m.rack_displacement_m };
        region.rack_potentiometer_m = m.rack_displacement_m;
        region.rack_speed_m_s = self.rack_speed.step(region.rack_displacement_m);
        region.tie_rod_force_n = m.tie_rod_force_n;
        region.actuator_force_n = m.actuator_force_n;
        region.horizontal_stroke_m = m.horizontal_stroke_m;
        region.vertical_stroke_m = m.vertical_stroke_m;
        output.copy_from_slice(region.words());
    }

    /// Looks at the supervisor's word: a request is passed on once.
    fn look_at_bench(&mut self, step: &Step, bench: &Bench, age: u64, fresh: bool) {
        self.no_supervisor = age > self.supervisor_max_ticks;
        if self.no_supervisor {
            self.request_pending = OperatorRequest::Stop;
            return;
        }
        if !fresh {
            return;
        }
        if bench.request_count != self.requests_seen {
            // A rig that comes up in the middle of a run waits for a new word: old requests are not obeyed.
            let old = self.status.used_bench == 0 && self.used[2] == NO_TICK && step.n > 10;
            self.requests_seen = bench.request_count;
            if !old {
                self.request_pending = match bench.request {
                    1 => OperatorRequest::Arm,
                    2 => OperatorRequest::Start,
                    3 => OperatorRequest::Stop,
                    4 => OperatorRequest::Acknowledge,
                    5 => OperatorRequest::SwitchOff,
                    _ => OperatorRequest::None,
                };
            }
        }
    }

    fn apply(&mut self, step: &Step, inputs: &Inputs, output: &mut [u64]) {
        let (car, car_input) = inputs.get::<VehicleState>(0);
        let (suspension, input) = inputs.get::<SuspensionState>(1);
        let (bench, bench_input) = inputs.get::<Bench>(2);
        let (parameters, parameters_input) = inputs.get::<Parameters>(3);
        if let Some(values) = self.live.news(parameters, parameters_input) {
            self.tuning.apply(values, &mut self.controller, &mut self.plant);
            self.human.apply(values);
        }
        let mut flags = rig_flags::VIRTUAL;

        self.look_at_bench(step, bench, bench_input.age(step.n), bench_input.fresh());
        if bench_input.fresh() {
            self.used[2] = bench_input.tick();
        }

        let unfit = model_flags::STALE | model_flags::HELD_POSE | model_flags::MODEL_FAULT;
        // Nonsense is no command; what is merely too much, safety clamps or trips on.
        let finite = suspension.tie_rod_force_n.iter().all(|f| f.abs() < IMPLAUSIBLE_N)
            && suspension
                .ball_height_m
                .iter()
                .chain(&suspension.ball_height_speed_m_s)
                .all(|v| v.abs() < IMPLAUSIBLE);
        let steer = [car.steering_wheel_angle_command_rad, car.steering_wheel_rate_command_rad_s];
        let sane = steer.iter().chain(&car.velocity_m_s).all(|v| v.abs() < IMPLAUSIBLE);
        let fresh = input.fresh() && car_input.fresh() && finite && sane && suspension.flags & unfit == 0;
        if fresh {
            self.stale = 0;
            self.used = [input.tick(), car_input.tick(), self.used[2]];
            let steer = if car.hand_wheel_mode == 0 {
                SteerCommand::Free
            } else {
                SteerCommand::Angle {
                    angle_rad: car.steering_wheel_angle_command_rad,
                    rate_rad_s: car.steering_wheel_rate_command_rad_s,
                }
            };
            let m = &self.measurement;
            let (angle, torque) = (m.steering_wheel_angle_rad, m.steering_wheel_torque_n_m);
            // A human at a wheel device, or at the operator's page: the device goes first.
            let at_page = self.human.step(steer, angle, torque, self.period_s);
            let at_device =
                self.wheel.as_mut().map(|wheel| wheel.step(step.n as f64 * self.period_s, torque));
            let steer = match at_device {
                None => at_page.unwrap_or(steer),
                Some(Some((angle_rad, rate_rad_s))) => SteerCommand::Angle { angle_rad, rate_rad_s },
                // The device is gone: hands off.
                Some(None) => SteerCommand::Free,
            };
            self.command = RigCommand {
                tie_rod_force_n: suspension.tie_rod_force_n,
                ball_height_m: suspension.ball_height_m,
                ball_height_velocity_m_s: suspension.ball_height_speed_m_s,
                steer,
                fade: self.command.fade,
            };
            self.environment.vehicle_speed_m_s = car.velocity_m_s[0];
        } else {
            self.stale += 1;
            self.late += 1;
            flags |= if input.fresh() { rig_flags::REFUSED_COMMAND } else { rig_flags::LATE_COMMAND };
        }
        if self.missed > 0 {
            flags |= rig_flags::STALLED;
        }
        if self.no_supervisor {
            flags |= rig_flags::NO_SUPERVISOR;
        }

        let ecu = self.ecu_drives.then(|| {
            let (can, can_input) = inputs.get::<Can>(4);
            self.status.used_can = can_input.tick();
            EcuWord {
                assist_torque_n_m: can.ecu_assist_torque_n_m,
                age_ticks: u32::try_from(can_input.age(step.n)).unwrap_or(u32::MAX),
            }
        });
        let verdict = self.safety.step(&SafetyInput {
            tick: step.n,
            request: std::mem::take(&mut self.request_pending),
            emergency_stop: bench_input.fresh() && bench.emergency_stop != 0,
            interlock_open: false,
            inputs_stale_ticks: self.stale.min(u64::from(u32::MAX)) as u32,
            missed_ticks: self.missed.min(u64::from(u32::MAX)) as u32,
            measurement: self.measurement,
            command: self.command,
            energy_cycle_j: self.diagnostics.energy_cycle_j,
            energy_second_j: self.diagnostics.energy_second_j,
            ecu,
        });
        self.environment.assist_request_n_m = verdict.assist_request_n_m;
        self.plant.set_environment(&self.environment);
        self.plant.advance(self.before_phase_s);
        self.controller.step(&verdict.command, &self.measurement, &mut self.actuation, &mut self.diagnostics);
        let clamped = verdict.clamped | self.safety.clamp_actuation(&mut self.actuation);
        self.plant.set_actuation(&self.actuation);
        self.plant.advance(self.after_phase_s);

        let status = &mut self.status;
        status.tick = step.n;
        status.time_s = step.n as f64 * self.period_s + self.output_phase_s;
        status.flags = flags;
        (status.used_suspension_state, status.used_vehicle_state) = (self.used[0], self.used[1]);
        status.used_bench = self.used[2];
        status.parameters_version = self.live.version();
        status.state = verdict.state as u64;
        if let Some(trip) = verdict.trip {
            (status.trip_code, status.trip_tick) = (trip.code as u64, trip.tick);
            (status.trip_limit, status.trip_value) = (trip.limit, trip.value);
        } else {
            (status.trip_code, status.trip_tick) = (0, 0);
            (status.trip_limit, status.trip_value) = (f64::NAN, f64::NAN);
        }
        status.stale_count = self.stale;
        status.late_command_count = self.late;
        status.clamped = clamped;
        status.force_fade_ratio = verdict.fade.force;
        status.tie_rod_force_command_n = self.command.tie_rod_force_n;
        status.tie_rod_force_applied_n = verdict.command.tie_rod_force_n.map(|f| f * verdict.fade.force);
        status.ball_height_applied_m = verdict.command.ball_height_m;
        status.steering_wheel_angle_applied_rad = match verdict.command.steer {
            SteerCommand::Angle { angle_rad, .. } => angle_rad,
            SteerCommand::Free | SteerCommand::Torque { .. } => f64::NAN,
        };
        status.horizontal_valve_ratio = self.actuation.horizontal_valve;
        status.vertical_valve_ratio = self.actuation.vertical_valve;
        status.assist_request_n_m = verdict.assist_request_n_m.unwrap_or(f64::NAN);
        status.steer_torque_command_n_m = self.actuation.steer_torque_n_m;
        status.port_energy_j = self.diagnostics.energy_total_j;
        status.port_energy_cycle_j = self.diagnostics.energy_cycle_j;
        status.port_power_w = self.diagnostics.energy_second_j;
        status.loop_delay_s = if self.diagnostics.loop_delay_known == 0 {
            f64::NAN
        } else {
            0.5 * (self.diagnostics.loop_delay_s[0] + self.diagnostics.loop_delay_s[1])
        };
        let truth = self.plant.truth();
        status.true_tie_rod_force_n = truth.tie_rod_force_n;
        status.true_rack_displacement_m = truth.unit.rack_displacement_m;
        if let Some(a) = self.plant.unit_account() {
            (status.unit_power_flow_w, status.unit_power_residual_w) = (a.power_flow_w, a.power_residual_w);
            (status.unit_stored_j, status.unit_entered_j) = (a.stored_j, a.entered_j);
            (status.unit_supplied_j, status.unit_lost_j) = (a.supplied_j, a.lost_j);
            (status.unit_imbalance_j, status.unit_fault_count) = (a.imbalance_j, a.fault_count as u64);
        }
        output.copy_from_slice(status.words());
    }
}

impl Model for RigNode {
    fn nodes(&self) -> &'static [NodeSpec] {
        if self.ecu_drives { NODES_WITH_ECU } else { NODES }
    }

    fn fault(&mut self, order: &Fault) {
        if order.kind == fault_kind::SENSOR
            && let Some(free) = self.sensor_faults.iter_mut().find(|slot| slot.is_none())
        {
            *free = Some((*order, f64::NAN));
        }
    }

    fn step(&mut self, node: usize, step: &Step, inputs: &Inputs, output: &mut [u64]) {
        if node == 0 {
            self.sample(step, output);
        } else {
            self.apply(step, inputs, output);
        }
    }
}

//! Tests of the rig's axes, run through safety and controller as any run is, and what they tell.
//!
//! The bench arms, starts, tests one axis after the other and stops. Excited are commands, never valves, so that
//! every limit holds; what the valves were sent is known, so the response of the machine itself follows from two
//! measured signals. Left and right are tested together on lines of their own. What a test finds goes into
//! [`Identified`], whose [`Identified::to_toml`] extends the rig's file.

use crate::AssemblyError;
use config::rig::{Limits, Rig};
use config::unit::SteeringUnit;
use rig_control::identification::{
    AxisFit, Excitation, FrequencyResponse, HubFit, Periodic, SeriesFit, fit_axis, fit_hub, fit_mass,
    fit_stiffness, response,
};
use rig_control::{ControlDiagnostics, Fade, RigCommand, RigController, SteerCommand};
use rig_plant::{Actuation, Linkage, Measurement, RigEnvironment, VirtualRig};
use safety::{BenchState, OperatorRequest, Safety, SafetyInput};

/// Amplitudes and lengths of the tests.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TestPlan {
    /// Peak of the tested tie-rod force. [N]
    pub force_n: f64,
    /// Peak of the tested height. [m]
    pub height_m: f64,
    /// Peak of the tested steering angle. [rad]
    pub angle_rad: f64,
    /// Length of one period of a test. [s]
    pub period_s: f64,
    /// Periods of each test; the first is left out.
    pub periods: usize,
    /// Highest frequency tested. [Hz]
    pub high_hz: f64,
}

impl Default for TestPlan {
    fn default() -> Self {
        Self { force_n: 400.0, height_m: 0.004, angle_rad: 0.15, period_s: 4.0, periods: 6, high_hz: 35.0 }
    }
}

/// A step test of one axis.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct StepTest {
    /// Axis.
    pub name: &'static str,
    /// Unit of command and answer.
    pub unit: &'static str,
    /// Time from the step. [s]
    pub time_s: Vec<f64>,
    /// Command.
    pub command: Vec<f64>,
    /// Reading.
    pub reading: Vec<f64>,
    /// Time from 10 % to 90 %. [s]
    pub rise_s: f64,
    /// Largest excess over the step. [%]
    pub overshoot_percent: f64,
    /// Time until the reading moved by 5 % of the step: delay as seen in time. [s]
    pub dead_time_s: f64,
}

/// A named frequency response.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedResponse {
    /// What it is.
    pub name: String,
    /// Unit of output over input.
    pub unit: &'static str,
    /// The response.
    pub response: FrequencyResponse,
}

/// What the tests found.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Identified {
    /// Horizontal axes, left and right.
    pub horizontal: [Option<AxisFit>; 2],
    /// Vertical axes, left and right.
    pub vertical: [Option<AxisFit>; 2],
    /// Tie-rod force over elongation, left and right. [N/m]
    pub stiffness_n_m: [Option<SeriesFit>; 2],
    /// Moving mass at the tip of the upper arm, left and right. [kg]
    pub mass_kg: [Option<SeriesFit>; 2],
    /// Steer actuator.
    pub hub: Option<HubFit>,
    /// Friction of the rack of the unit under test, without assist. [N]
    pub rack_friction_n: Option<f64>,
    /// Viscous damping at the rack. [N·s/m]
    pub rack_damping_n_s_m: Option<f64>,
    /// Friction of its column. [N·m]
    pub column_friction_n_m: Option<f64>,
    /// Rack travel per radian of the hand wheel. [m/rad]
    pub rack_per_radian_m: Option<f64>,
    /// Frequency responses, for the report.
    pub responses: Vec<NamedResponse>,
    /// Steps, for the report.
    pub steps: Vec<StepTest>,
    /// Transport delay that the axes' total delays leave for the commands. [s]
    pub command_delay_s: Option<f64>,
    /// Lag of the steer actuator's torque beyond that delay. [s]
    pub torque_lag_s: Option<f64>,
}

/// Rig, safety and controller in one thread.
struct TestLoop {
    plant: VirtualRig,
    safety: Safety,
    controller: RigController,
    linkage: Linkage,
    limits: Limits,
    period_s: f64,
    first_s: f64,
    tick: u64,
    measurement: Measurement,
    actuation: Actuation,
    diagnostics: ControlDiagnostics,
    environment: RigEnvironment,
}

/// What one test recorded, a value a tick.
#[derive(Default)]
struct Recorded {
    reference: Vec<f64>,
    command: Vec<RigCommand>,
    measurement: Vec<Measurement>,
    actuation: Vec<Actuation>,
}

impl Recorded {
    fn of(&self, pick: impl Fn(&Measurement) -> f64) -> Vec<f64> {
        self.measurement.iter().map(pick).collect()
    }
    fn sent(&self, pick: impl Fn(&Actuation) -> f64) -> Vec<f64> {
        self.actuation.iter().map(pick).collect()
    }
}

fn faults(part: &'static str) -> impl Fn(Vec<config::Broken>) -> AssemblyError {
    move |broken| AssemblyError::new(part, broken.into_iter().map(|b| format!("{}: {}", b.key, b.rule)))
}

impl TestLoop {
    fn new(
        rig: &Rig,
        unit: &SteeringUnit,
        seed: u64,
        period_s: f64,
        phase: f64,
    ) -> Result<Self, AssemblyError> {
        let first_s = phase * period_s;
        Ok(Self {
            plant: VirtualRig::new(rig, unit, seed, period_s).map_err(faults("rig"))?,
            safety: Safety::new(rig, unit, period_s, true).map_err(faults("rig"))?,
            controller: RigController::with_phase(rig, unit, period_s, first_s).map_err(faults("rig"))?,
            linkage: Linkage::new(&rig.geometry),
            limits: rig.limits.clone(),
            period_s,
            first_s,
            tick: 0,
            measurement: Measurement::default(),
            actuation: Actuation::default(),
            diagnostics: ControlDiagnostics::default(),
            environment: RigEnvironment::default(),
        })
    }

    /// One tick; the state of the bench after it.
    fn step(&mut self, command: &RigCommand, request: OperatorRequest) -> Result<BenchState, AssemblyError> {
        self.plant.sample(&mut self.measurement);
        let verdict = self.safety.step(&SafetyInput {
            tick: self.tick,
            request,
            emergency_stop: false,
            interlock_open: false,
            inputs_stale_ticks: 0,
            missed_ticks: 0,
            measurement: self.measurement,
            command: *command,
            energy_cycle_j: self.diagnostics.energy_cycle_j,
            energy_second_j: self.diagnostics.energy_second_j,
            ecu: None,
        });
        self.tick += 1;
        if let Some(trip) = verdict.trip {
            let (name, unit) = trip.code.describe();
            return Err(AssemblyError::new(
                "identification",
                [format!("tripped by {name}: {} {unit}, limit {}", trip.value, trip.limit)],
            ));
        }
        self.controller.step(&verdict.command, &self.measurement, &mut self.actuation, &mut self.diagnostics);
        self.safety.clamp_actuation(&mut self.actuation);
        self.plant.set_environment(&self.environment);
        self.plant.advance(self.first_s);
        self.plant.set_actuation(&self.actuation);
        self.plant.advance(self.period_s - self.first_s);
        Ok(verdict.state)
    }

    fn start(&mut self) -> Result<(), AssemblyError> {
        let still = still(0.0);
        for request in [OperatorRequest::SwitchOn, OperatorRequest::Arm, OperatorRequest::Start] {
            self.step(&still, request)?;
            for _ in 0..10 {
                self.step(&still, OperatorRequest::None)?;
            }
        }
        for _ in 0..(10.0 / self.period_s) as u32 {
            if self.step(&still, OperatorRequest::None)? == BenchState::Running {
                return Ok(());
            }
        }
        Err(AssemblyError::new("identification", ["the bench did not start"]))
    }

    /// Runs a test of `ticks`; `command` gives reference and command of each tick.
    fn record(
        &mut self,
        ticks: usize,
        mut command: impl FnMut(usize, f64) -> (f64, RigCommand),
    ) -> Result<Recorded, AssemblyError> {
        let mut out = Recorded::default();
        for n in 0..ticks {
            let (reference, asked) = command(n, n as f64 * self.period_s);
            self.step(&asked, OperatorRequest::None)?;
            out.reference.push(reference);
            out.command.push(asked);
            out.measurement.push(self.measurement);
            out.actuation.push(self.actuation);
        }
        Ok(out)
    }

    /// The part of a test's amplitude at which no speed and no force passes half its limit, as one period at a quarter
    /// of it tells: a machine that answers more than it was believed to is not driven into its limits. At most 1.
    fn gentle(
        &mut self,
        ticks: usize,
        command: impl Fn(usize, f64) -> RigCommand,
    ) -> Result<f64, AssemblyError> {
        const PROBE: f64 = 0.25;
        let record = self.record(ticks, |n, _| (0.0, command(n, PROBE)))?;
        let l = &self.limits;
        let window = (l.speed_window_s / self.period_s).round().max(1.0) as usize;
        let span = window as f64 * self.period_s;
        let mut used = f64::MIN_POSITIVE;
        for m in &record.measurement {
            for side in 0..2 {
                used = used
                    .max(m.tie_rod_force_n[side].abs() / l.tie_rod_force_n)
                    .max(m.actuator_force_n[side].abs() / l.actuator_force_n);
            }
        }
        for pair in record.measurement.windows(window + 1) {
            let (a, b) = (&pair[0], &pair[window]);
            for side in 0..2 {
                let horizontal = (b.horizontal_stroke_m[side] - a.horizontal_stroke_m[side]).abs() / span;
                let vertical = (b.vertical_stroke_m[side] - a.vertical_stroke_m[side]).abs() / span;
                used = used.max(horizontal / l.horizontal_speed_m_s).max(vertical / l.vertical_speed_m_s);
            }
        }
        Ok((0.5 * PROBE / used).min(1.0))
    }

    /// Elongation of spring and rod of one side by the readings of strokes and rack. [m]
    fn elongation(&self, m: &Measurement, side: usize) -> f64 {
        let arm = self.linkage.arm_at_stroke(m.horizontal_stroke_m[side]);
        let rack = [1.0, -1.0][side] * m.rack_displacement_m;
        self.linkage.rod(&arm, m.vertical_stroke_m[side], rack).elongation_m
    }
}

fn still(angle_rad: f64) -> RigCommand {
    RigCommand {
        steer: SteerCommand::Angle { angle_rad, rate_rad_s: 0.0 },
        fade: Fade::FULL,
        ..RigCommand::default()
    }
}

/// Tests every axis of a virtual rig. `said` is told what is being done and how far it is, 0 to 1.
///
/// # Errors
/// A rig or unit that breaks its rules, or a test that tripped a limit: then which.
pub fn identify(
    rig: &Rig,
    unit: &SteeringUnit,
    seed: u64,
    period_s: f64,
    output_phase: f64,
    plan: &TestPlan,
    mut said: impl FnMut(&str, f64),
) -> Result<Identified, AssemblyError> {
    let mut bench = TestLoop::new(rig, unit, seed, period_s, output_phase)?;
    let mut found = Identified::default();
    said("start", 0.0);
    bench.start()?;
    let interleaved = |offset| {
        let kind = Excitation::Multisine { offset, stride: 2, corner_hz: 3.0 };
        Periodic::new(kind, plan.period_s, 0.5, plan.high_hz, period_s)
    };
    let pair = [interleaved(0), interleaved(1)];
    let all = pair[0].values.len() * plan.periods;

    said("horizontal axes: multisine", 0.05);
    let forces = |n: usize, part: f64| {
        let mut c = still(0.0);
        c.tie_rod_force_n = [0, 1].map(|side| part * plan.force_n * pair[side].at(n));
        c
    };
    let part = bench.gentle(pair[0].values.len(), forces)?;
    let force_n = part * plan.force_n;
    let force = bench.record(all, |n, _| (0.0, forces(n, part)))?;
    for side in 0..2 {
        let name = ["left", "right"][side];
        let valve = force.sent(|a| a.horizontal_valve[side]);
        let stroke = force.of(|m| m.horizontal_stroke_m[side]);
        let read = force.of(|m| m.tie_rod_force_n[side]);
        let long: Vec<f64> = force.measurement.iter().map(|m| bench.elongation(m, side)).collect();
        let asked: Vec<f64> = force.command.iter().map(|c| c.tie_rod_force_n[side]).collect();
        let test = &pair[side];
        if let Some(g) = response(test, 1, &valve, &stroke) {
            found.horizontal[side] = fit_axis(&g.within(1.0, plan.high_hz), 1.0, period_s);
            keep(&mut found, format!("{name} horizontal: valve to stroke"), "m", g);
        }
        if let Some(g) = response(test, 1, &long, &read) {
            found.stiffness_n_m[side] = fit_stiffness(&g.within(0.5, 10.0));
            keep(&mut found, format!("{name}: elongation to tie-rod force"), "N/m", g);
        }
        // What accelerates arm and column: the cylinder's cell, converted, less the tie rod's.
        let (mut extra, mut tip) = (Vec::new(), Vec::new());
        for m in &force.measurement {
            let arm = bench.linkage.arm_at_stroke(m.horizontal_stroke_m[side]);
            let rack = [1.0, -1.0][side] * m.rack_displacement_m;
            let rod = bench.linkage.rod(&arm, m.vertical_stroke_m[side], rack);
            let lever = arm.stroke_per_angle_m_rad / bench.linkage.upper_arm_m();
            extra.push(m.actuator_force_n[side] * lever - m.tie_rod_force_n[side] * rod.per_tip);
            tip.push(bench.linkage.upper_arm_m() * arm.angle_rad);
        }
        if let Some(g) = response(test, 1, &tip, &extra) {
            found.mass_kg[side] = fit_mass(&g.within(12.0, plan.high_hz));
            keep(&mut found, format!("{name}: tip of the arm to extra force"), "N/m", g);
        }
        if let Some(g) = response(test, 1, &asked, &read) {
            keep(&mut found, format!("{name}: force loop, multisine"), "1", g);
        }
    }

    for (label, kind, at) in [
        ("chirp", Excitation::Chirp, 0.25),
        ("binary sequence", Excitation::BinarySequence { bits: 8 }, 0.35),
    ] {
        said(&format!("force loop: {label}"), at);
        let test = Periodic::new(kind, plan.period_s, 0.5, plan.high_hz, period_s);
        let record = bench.record(test.values.len() * 4, |n, _| {
            let mut c = still(0.0);
            c.tie_rod_force_n = [0.25 * force_n * test.at(n), 0.0];
            (0.0, c)
        })?;
        let asked: Vec<f64> = record.command.iter().map(|c| c.tie_rod_force_n[0]).collect();
        if let Some(g) = response(&test, 1, &asked, &record.of(|m| m.tie_rod_force_n[0])) {
            keep(&mut found, format!("left: force loop, {label}"), "1", g);
        }
        let (valve, stroke) =
            (record.sent(|a| a.horizontal_valve[0]), record.of(|m| m.horizontal_stroke_m[0]));
        if let Some(g) = response(&test, 1, &valve, &stroke) {
            keep(&mut found, format!("left horizontal: valve to stroke, {label}"), "m", g);
        }
    }

    said("vertical axes: multisine", 0.45);
    let heights = |n: usize, part: f64| {
        let mut c = still(0.0);
        for side in 0..2 {
            let (now, next) = (pair[side].at(n), pair[side].at(n + 1));
            c.ball_height_m[side] = part * plan.height_m * now;
            c.ball_height_velocity_m_s[side] = part * plan.height_m * (next - now) / period_s;
        }
        c
    };
    let part = bench.gentle(pair[0].values.len(), heights)?;
    let height = bench.record(all, |n, _| (0.0, heights(n, part)))?;
    for side in 0..2 {
        let name = ["left", "right"][side];
        let valve = height.sent(|a| a.vertical_valve[side]);
        if let Some(g) = response(&pair[side], 1, &valve, &height.of(|m| m.vertical_stroke_m[side])) {
            found.vertical[side] = fit_axis(&g.within(1.0, plan.high_hz), 1.0, period_s);
            keep(&mut found, format!("{name} vertical: valve to stroke"), "m", g);
        }
        let asked: Vec<f64> = height.command.iter().map(|c| c.ball_height_m[side]).collect();
        if let Some(g) = response(&pair[side], 1, &asked, &height.of(|m| m.vertical_stroke_m[side])) {
            keep(&mut found, format!("{name}: height loop, multisine"), "1", g);
        }
    }

    said("steer axis: multisine", 0.65);
    let kind = Excitation::Multisine { offset: 0, stride: 1, corner_hz: 2.0 };
    let test = Periodic::new(kind, plan.period_s, 0.5, 25.0, period_s);
    let steer = bench.record(test.values.len() * plan.periods, |n, _| {
        let rate = plan.angle_rad * (test.at(n + 1) - test.at(n)) / period_s;
        let mut c = still(0.0);
        c.steer = SteerCommand::Angle { angle_rad: plan.angle_rad * test.at(n), rate_rad_s: rate };
        (0.0, c)
    })?;
    let sent = steer.sent(|a| a.steer_torque_n_m);
    let angle = response(&test, 1, &sent, &steer.of(|m| m.steering_wheel_angle_rad));
    let cell = response(&test, 1, &sent, &steer.of(|m| m.steering_wheel_torque_n_m));
    if let (Some(angle), Some(cell)) = (angle, cell) {
        found.hub = fit_hub(&angle, &cell, period_s);
        keep(&mut found, "steer actuator: torque to angle".to_owned(), "rad/(N·m)", angle);
        keep(&mut found, "steer actuator: torque to cell".to_owned(), "1", cell);
    }

    said("friction: slow ramps without assist", 0.8);
    friction(&mut bench, &mut found)?;
    said("steps", 0.92);
    steps(&mut bench, plan, &mut found)?;
    conclude(&mut found, rig, period_s, output_phase);
    Ok(found)
}

fn keep(found: &mut Identified, name: String, unit: &'static str, response: FrequencyResponse) {
    found.responses.push(NamedResponse { name, unit, response });
}

/// Column and rack friction from ramps of two speeds, both ways, with the assist off: half the difference
/// between the directions; the two speeds separate friction from viscous damping.
fn friction(bench: &mut TestLoop, found: &mut Identified) -> Result<(), AssemblyError> {
    bench.environment.engine_on = false;
    let mut at = Vec::new();
    for speed in [0.5, 1.5_f64] {
        let reach = 0.6;
        let quarter_s = reach / speed;
        let ticks = (8.0 * quarter_s / bench.period_s) as usize;
        let record = bench.record(ticks, |_, t| {
            let phase = (t / quarter_s) % 4.0;
            let (angle, sign) = match phase {
                p if p < 1.0 => (p, 1.0),
                p if p < 3.0 => (2.0 - p, -1.0),
                p => (p - 4.0, 1.0),
            };
            let mut c = still(0.0);
            c.steer = SteerCommand::Angle { angle_rad: reach * angle, rate_rad_s: sign * speed };
            (sign, c)
        })?;
        // Second round only, away from the turning points.
        let (mut cell, mut bar, mut rods, mut count) = ([0.0; 2], [0.0; 2], [0.0; 2], [0.0; 2]);
        let (mut travel, mut turned) = ([0.0_f64; 2], [0.0_f64; 2]);
        let mut last: Option<(f64, f64, f64)> = None;
        for (n, m) in record.measurement.iter().enumerate().skip(ticks / 2) {
            let m_angle = m.steering_wheel_angle_rad;
            if m_angle.abs() > 0.5 * reach {
                last = None;
                continue;
            }
            let way = usize::from(record.reference[n] < 0.0);
            cell[way] += m.steering_wheel_torque_n_m;
            bar[way] += m.torsion_bar_torque_n_m;
            rods[way] += m.tie_rod_force_n[0] - m.tie_rod_force_n[1];
            count[way] += 1.0;
            if let Some((angle, rack, _)) = last {
                turned[way] += m_angle - angle;
                travel[way] += m.rack_displacement_m - rack;
            }
            last = Some((m_angle, m.rack_displacement_m, 0.0));
        }
        if count.contains(&0.0) || turned.contains(&0.0) {
            return Ok(());
        }
        let half = |v: [f64; 2]| 0.5 * (v[0] / count[0] - v[1] / count[1]);
        let ratio = 0.5 * (travel[0] / turned[0] + travel[1] / turned[1]);
        // Over the rod's direction the outboard share of the force acts on the rack: near 1, taken as 1.
        let rack = half(bar) / ratio + half(rods);
        at.push((speed, half(cell) - half(bar), rack, ratio));
    }
    bench.environment.engine_on = true;
    let [slow, fast] = at[..] else { return Ok(()) };
    let line = |low: f64, high: f64, x0: f64, x1: f64| {
        let slope = (high - low) / (x1 - x0);
        (low - slope * x0, slope)
    };
    let (column, _) = line(slow.1, fast.1, slow.0, fast.0);
    let rack = |v: f64, ratio: f64| v * ratio.signum();
    let speeds = [slow.0 * slow.3.abs(), fast.0 * fast.3.abs()];
    let (friction, damping) = line(rack(slow.2, slow.3), rack(fast.2, fast.3), speeds[0], speeds[1]);
    found.column_friction_n_m = Some(column);
    found.rack_friction_n = Some(friction);
    found.rack_damping_n_s_m = Some(damping);
    found.rack_per_radian_m = Some(slow.3);
    Ok(())
}

fn steps(bench: &mut TestLoop, plan: &TestPlan, found: &mut Identified) -> Result<(), AssemblyError> {
    let before = (0.2 / bench.period_s) as usize;
    let ticks = before + (0.4 / bench.period_s) as usize;
    type Ask = fn(&mut RigCommand, f64);
    type Pick = fn(&Measurement) -> f64;
    let tests: [(&'static str, &'static str, f64, Ask, Pick); 3] = [
        (
            "tie-rod force, left",
            "N",
            0.5 * plan.force_n,
            |c, v| c.tie_rod_force_n[0] = v,
            |m| m.tie_rod_force_n[0],
        ),
        (
            "ball height, left",
            "m",
            0.5 * plan.height_m,
            |c, v| c.ball_height_m[0] = v,
            |m| m.vertical_stroke_m[0],
        ),
        (
            "steering angle",
            "rad",
            0.2 * plan.angle_rad,
            |c, v| c.steer = SteerCommand::Angle { angle_rad: v, rate_rad_s: 0.0 },
            |m| m.steering_wheel_angle_rad,
        ),
    ];
    for (name, unit, size, ask, pick) in tests {
        let record = bench.record(ticks, |n, _| {
            let mut c = still(0.0);
            let value = if n >= before { size } else { 0.0 };
            ask(&mut c, value);
            (value, c)
        })?;
        let reading = record.of(pick);
        let from = reading[..before].iter().rev().take(50).sum::<f64>() / 50.0;
        let reached = |share: f64| {
            let over = |v: &f64| (v - from) / size >= share;
            reading[before..].iter().position(over).map_or(f64::NAN, |n| n as f64 * bench.period_s)
        };
        let peak = reading[before..].iter().fold(0.0, |m: f64, v| m.max((v - from) / size));
        found.steps.push(StepTest {
            name,
            unit,
            time_s: (0..ticks).map(|n| (n as f64 - before as f64) * bench.period_s).collect(),
            command: record.reference,
            rise_s: reached(0.9) - reached(0.1),
            overshoot_percent: 100.0 * (peak - 1.0).max(0.0),
            dead_time_s: reached(0.05),
            reading,
        });
        bench.record(before, |_, _| (0.0, still(0.0)))?;
    }
    Ok(())
}

/// What is left of the total delays when the output phase and the sensors' own delay are taken off.
fn conclude(found: &mut Identified, rig: &Rig, period_s: f64, output_phase: f64) {
    // The horizontal axes': their loop needs it most, and against a vertical axis's weight delay and valve are told
    // apart less well (their sum is as good).
    let delays: Vec<f64> = found.horizontal.iter().flatten().map(|fit| fit.delay_s).collect();
    if delays.is_empty() {
        return;
    }
    let total = delays.iter().sum::<f64>() / delays.len() as f64;
    let interpolation = if rig.plant.interpolate_commands { 0.5 * period_s } else { 0.0 };
    let rest = total - output_phase * period_s - rig.control.measurement_delay_s - interpolation;
    found.command_delay_s = Some(rest.max(0.0));
    found.torque_lag_s = found.hub.map(|hub| (hub.delay_s - total).max(0.0));
}

impl Identified {
    /// The rig with what was found put into its control section. What could not be found stays.
    pub fn applied_to(&self, rig: &Rig) -> Rig {
        let mut out = rig.clone();
        let c = &mut out.control;
        let mean = |v: [Option<f64>; 2]| match v {
            [Some(a), Some(b)] => Some(0.5 * (a + b)),
            [a, b] => a.or(b),
        };
        let set = |at: &mut f64, value: Option<f64>| {
            if let Some(value) = value.filter(|v| v.is_finite() && *v > 0.0) {
                *at = value;
            }
        };
        set(&mut c.tie_rod_stiffness_n_m, mean(self.stiffness_n_m.map(|f| f.map(|f| f.value))));
        set(&mut c.command_delay_s, self.command_delay_s);
        set(&mut c.steer.torque_lag_s, self.torque_lag_s);
        for (axis, fits) in [(&mut c.horizontal, &self.horizontal), (&mut c.vertical, &self.vertical)] {
            set(&mut axis.no_load_speed_m_s, mean(fits.map(|f| f.map(|f| f.speed_m_s))));
            set(&mut axis.valve_frequency_hz, mean(fits.map(|f| f.map(|f| f.valve_frequency_hz))));
            set(&mut axis.valve_damping_ratio, mean(fits.map(|f| f.map(|f| f.valve_damping_ratio))));
            axis.lead_frequency_hz = axis.lead_frequency_hz.max(axis.valve_frequency_hz);
        }
        set(&mut c.horizontal.mass_kg, mean(self.mass_kg.map(|f| f.map(|f| f.value))));
        out
    }

    /// A rig file that extends `base` by what was found.
    pub fn to_toml(&self, rig: &Rig, base: &str) -> String {
        let c = self.applied_to(rig).control;
        let number = |v: f64| format!("{v:.6e}");
        let mut text = format!(
            "# Written by `kingpin rig identify`: what the tests found, over the rig they were made on.\n\
             extends = \"{base}\"\n\n[control]\ntie_rod_stiffness_n_m = {}\ncommand_delay_s = {}\n",
            number(c.tie_rod_stiffness_n_m),
            number(c.command_delay_s),
        );
        for (name, axis) in [("horizontal", &c.horizontal), ("vertical", &c.vertical)] {
            text += &format!(
                "\n[control.{name}]\nno_load_speed_m_s = {}\nvalve_frequency_hz = {}\nvalve_damping_ratio = {}\n\
                 lead_frequency_hz = {}\n",
                number(axis.no_load_speed_m_s),
                number(axis.valve_frequency_hz),
                number(axis.valve_damping_ratio),
                number(axis.lead_frequency_hz),
            );
            if name == "horizontal" {
                text += &format!("mass_kg = {}\n", number(axis.mass_kg));
            }
        }
        text += &format!("\n[control.steer]\ntorque_lag_s = {}\n", number(c.steer.torque_lag_s));
        text
    }
}

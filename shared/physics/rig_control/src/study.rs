//! Force-control study: virtual rig and controller under the four manoeuvres of the published comparison.
//!
//! The loop is closed through a deterministic load: a linear bicycle model with relaxation and saturating front
//! tyres, driven by the measured rack displacement, gives tie-rod forces and ball heights a tick later, so that
//! command noise and loop delay are of the real kind. The full car closes the same loop in the services.
//!
//! Measured as the specification says: error = command[n] − reading available at n, both through the same
//! zero-phase 50 Hz filter, over the window in which steering is active, in % of half the peak-to-peak of that
//! side's command. The true force is reported beside it. Not for the real-time path: it allocates.

use crate::command::{ControlDiagnostics, Fade, RigCommand, SteerCommand};
use crate::controller::RigController;
use crate::rack_estimate::RackEstimate;
use config::Broken;
use config::rig::{Rig, SteerDevice, Switches};
use config::unit::SteeringUnit;
use core::f64::consts::{PI, TAU};
use rig_plant::{Actuation, Measurement, RigEnvironment, VirtualRig};

/// Steering of a manoeuvre.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Steering {
    /// Continuous sine.
    Sine,
    /// One period of a sine: a lane change.
    SingleSine,
    /// One period with 0.5 s dwell at the second peak [ISO 19365].
    SineWithDwell,
}

/// One manoeuvre.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Manoeuvre {
    /// Name.
    pub name: &'static str,
    /// Vehicle speed. [m/s]
    pub speed_m_s: f64,
    /// Steering frequency. [Hz]
    pub frequency_hz: f64,
    /// Steering-wheel amplitude. [rad]
    pub amplitude_rad: f64,
    /// Shape.
    pub steering: Steering,
    /// Published figures in %: left max, left rms, right max, right rms.
    pub published: [f64; 4],
}

/// The four manoeuvres, with the published figures.
pub const MANOEUVRES: [Manoeuvre; 4] = [
    Manoeuvre {
        name: "on-centre 120 km/h 0.2 Hz",
        speed_m_s: 120.0 / 3.6,
        frequency_hz: 0.2,
        amplitude_rad: 0.12,
        steering: Steering::Sine,
        published: [2.44, 0.85, 2.71, 0.84],
    },
    Manoeuvre {
        name: "slalom 120 km/h 0.3 Hz",
        speed_m_s: 120.0 / 3.6,
        frequency_hz: 0.3,
        amplitude_rad: 0.30,
        steering: Steering::Sine,
        published: [5.62, 1.03, 3.51, 0.86],
    },
    Manoeuvre {
        name: "lane change 120 km/h 1 Hz",
        speed_m_s: 120.0 / 3.6,
        frequency_hz: 1.0,
        amplitude_rad: 0.40,
        steering: Steering::SingleSine,
        published: [8.76, 2.44, 7.28, 2.09],
    },
    Manoeuvre {
        name: "sine with dwell 80 km/h 0.7 Hz",
        speed_m_s: 80.0 / 3.6,
        frequency_hz: 0.7,
        amplitude_rad: 2.0,
        steering: Steering::SineWithDwell,
        published: [6.87, 1.66, 6.32, 0.99],
    },
];

impl Manoeuvre {
    const START_S: f64 = 1.5;

    /// End of active steering. [s]
    pub fn end_s(&self) -> f64 {
        Self::START_S
            + match self.steering {
                Steering::Sine => 3.0 / self.frequency_hz,
                Steering::SingleSine => 1.0 / self.frequency_hz,
                Steering::SineWithDwell => 1.0 / self.frequency_hz + 0.5,
            }
    }

    /// Steering-wheel angle and rate at `time_s`. [rad], [rad/s]
    pub fn steering(&self, time_s: f64) -> (f64, f64) {
        let t = time_s - Self::START_S;
        if t <= 0.0 || time_s >= self.end_s() {
            return (0.0, 0.0);
        }
        let (a, w) = (self.amplitude_rad, TAU * self.frequency_hz);
        let sine = |t: f64| (a * (w * t).sin(), a * w * (w * t).cos());
        match self.steering {
            Steering::Sine => {
                // Quarter-period ramps at both ends.
                let ramp_s = 0.25 / self.frequency_hz;
                let left = self.end_s() - time_s;
                let edge = |x: f64| {
                    (0.5 - 0.5 * (PI * x / ramp_s).cos(), 0.5 * PI / ramp_s * (PI * x / ramp_s).sin())
                };
                let (gain, gain_rate) = if t < ramp_s {
                    edge(t)
                } else if left < ramp_s {
                    let (gain, rate) = edge(left);
                    (gain, -rate)
                } else {
                    (1.0, 0.0)
                };
                let (angle, rate) = sine(t);
                (gain * angle, gain * rate + gain_rate * angle)
            }
            Steering::SingleSine => sine(t),
            Steering::SineWithDwell => {
                let peak = 0.75 / self.frequency_hz;
                if t < peak {
                    sine(t)
                } else if t < peak + 0.5 {
                    (-a, 0.0)
                } else {
                    sine(t - 0.5)
                }
            }
        }
    }
}

/// Who steers in a study.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SteerMode {
    /// The actuator follows the manoeuvre's angle.
    #[default]
    Angle,
    /// The actuator gives a torque of the manoeuvre's shape, a share of [`Study::torque_per_angle_n_m_rad`].
    Torque,
    /// The actuator is off; hands of a human hold the measuring wheel to the manoeuvre: a spring and a damper
    /// between the wanted and the true angle, 20 N·m/rad and 0.6 N·m·s/rad [Pick, Cole 2007, Vehicle System
    /// Dynamics 45(8): a tensed arm's stiffness and damping].
    MeasuringWheel,
}

/// Tie-rod load of a compact car: bicycle model, relaxation, saturating tyres.
#[derive(Debug, Clone)]
struct Load {
    speed: f64,
    lateral_velocity: f64,
    yaw_rate: f64,
    slip: [f64; 2],
    roll: f64,
    roll_rate: f64,
}

impl Load {
    const MASS: f64 = 1400.0;
    const YAW_INERTIA: f64 = 2200.0;
    const FRONT: f64 = 1.1;
    const REAR: f64 = 1.5;
    const STEERING_ARM: f64 = 0.12;

    fn new(speed: f64) -> Self {
        Self { speed, lateral_velocity: 0.0, yaw_rate: 0.0, slip: [0.0; 2], roll: 0.0, roll_rate: 0.0 }
    }

    fn tyre(slip: f64, stiffness: f64, peak: f64) -> f64 {
        // Magic-Formula shape with C = 1.4.
        let b = stiffness / (1.4 * peak);
        peak * (1.4 * (b * slip).atan()).sin()
    }

    /// Advances; returns tie-rod forces, ball heights and their rates.
    fn step(&mut self, rack_m: f64, period_s: f64) -> ([f64; 2], [f64; 2], [f64; 2]) {
        let steer = rack_m / Self::STEERING_ARM;
        let v = self.speed;
        let wanted = [
            steer - (self.lateral_velocity + Self::FRONT * self.yaw_rate) / v,
            -(self.lateral_velocity - Self::REAR * self.yaw_rate) / v,
        ];
        for (slip, wanted) in self.slip.iter_mut().zip(wanted) {
            *slip += period_s * v / 0.5 * (wanted - *slip);
        }
        let front = Self::tyre(self.slip[0], 1.0e5, 7200.0);
        let rear = Self::tyre(self.slip[1], 1.3e5, 5600.0);
        let acceleration = (front + rear) / Self::MASS;
        self.lateral_velocity += period_s * (acceleration - v * self.yaw_rate);
        self.yaw_rate += period_s * (Self::FRONT * front - Self::REAR * rear) / Self::YAW_INERTIA;
        // Roll 0.5° per m/s², 1.6 Hz, ζ 0.3; the outer ball stands 0.7 m from the centre.
        let w = TAU * 1.6;
        let target = 0.0087 * acceleration;
        self.roll_rate += period_s * (w * w * (target - self.roll) - 0.6 * w * self.roll_rate);
        self.roll += period_s * self.roll_rate;
        // Pneumatic trail falls with slip; mechanical trail stays.
        let trail = 0.025 + 0.035 * (1.0 - (self.slip[0].abs() / 0.16).min(1.0));
        let moment = front * trail;
        // The outer wheel carries more.
        let shift = (0.06 * acceleration).clamp(-0.45, 0.45);
        let by_rod = moment / Self::STEERING_ARM;
        let force = [60.0 - (0.5 - shift) * by_rod, 60.0 + (0.5 + shift) * by_rod];
        let height = 0.7 * self.roll;
        ([force[0], force[1]], [-height, height], [-0.7 * self.roll_rate, 0.7 * self.roll_rate])
    }
}

/// Result for one side of one run.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SideResult {
    /// Half the peak-to-peak of the command. [N]
    pub amplitude_n: f64,
    /// Largest error by the reading. [%]
    pub max_percent: f64,
    /// Its rms. [%]
    pub rms_percent: f64,
    /// Largest error by the true force. [%]
    pub true_max_percent: f64,
    /// Its rms. [%]
    pub true_rms_percent: f64,
    /// Lag of the reading behind the command by the peak of their cross-correlation. [s]
    pub force_lag_s: f64,
    /// Lag of the stroke reading behind the commanded height, likewise. [s]
    pub height_lag_s: f64,
    /// Loop delay as the controller estimates it at the end of steering. [s]
    pub estimated_lag_s: f64,
}

/// Result of one run.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct StudyResult {
    /// Left, right.
    pub sides: [SideResult; 2],
    /// Largest steering-angle error. [rad]
    pub steer_error_rad: f64,
    /// Largest difference of torque command and cell, both below 50 Hz (torque mode). [N·m]
    pub steer_torque_error_n_m: f64,
    /// Largest steering angle. [rad]
    pub steer_angle_max_rad: f64,
    /// Largest steering torque by the cell. [N·m]
    pub steer_torque_max_n_m: f64,
    /// Energy that tracking errors fed into the steering, per second of steering. [J/s]
    pub energy_w: f64,
    /// Ticks with a saturated valve.
    pub saturated_ticks: u32,
}

impl StudyResult {
    /// Left max, left rms, right max, right rms in the order of the published table. [%]
    pub fn figures(&self) -> [f64; 4] {
        let [l, r] = &self.sides;
        [l.max_percent, l.rms_percent, r.max_percent, r.rms_percent]
    }
}

/// How a study is run.
#[derive(Debug, Clone)]
pub struct Study {
    /// The machine that is there.
    pub rig: Rig,
    /// The steering unit that is there.
    pub unit: SteeringUnit,
    /// What the controller was told.
    pub control_rig: Rig,
    /// Compensations.
    pub switches: Switches,
    /// Seed of the sensors.
    pub seed: u64,
    /// Period. [s]
    pub period_s: f64,
    /// Output phase as a fraction of the period.
    pub output_phase: f64,
    /// Who steers.
    pub mode: SteerMode,
    /// Torque mode: torque for each radian of the manoeuvre. [N·m/rad]
    pub torque_per_angle_n_m_rad: f64,
}

impl Study {
    /// The nominal study of a rig.
    pub fn new(rig: &Rig, unit: &SteeringUnit) -> Self {
        Self {
            rig: rig.clone(),
            unit: unit.clone(),
            control_rig: rig.clone(),
            switches: rig.control.switches,
            seed: 1,
            period_s: 1e-3,
            output_phase: 0.5,
            mode: SteerMode::Angle,
            torque_per_angle_n_m_rad: 8.0,
        }
    }

    /// The same with the plant's valve gain, spring and rod stiffness, and delays scaled.
    pub fn with_plant(mut self, gain: f64, stiffness: f64, delay: f64) -> Self {
        let p = &mut self.rig.plant;
        for axis in [&mut p.horizontal, &mut p.vertical] {
            axis.rated_flow_m3_s *= gain;
        }
        p.leaf_spring_stiffness_n_m *= stiffness;
        p.tie_rod_stiffness_n_m *= stiffness;
        p.command_delay_s *= delay;
        p.measurement_delay_s *= delay;
        self
    }

    /// Runs one manoeuvre.
    ///
    /// # Errors
    /// Every broken rule of rig and unit.
    pub fn run(&self, manoeuvre: &Manoeuvre) -> Result<StudyResult, Vec<Broken>> {
        Ok(self.trace(manoeuvre)?.judge(manoeuvre))
    }

    /// Runs one manoeuvre and keeps its signals.
    ///
    /// # Errors
    /// Every broken rule of rig and unit.
    pub fn trace(&self, manoeuvre: &Manoeuvre) -> Result<Trace, Vec<Broken>> {
        let period_s = self.period_s;
        let (mut rig, mut control_rig) = (self.rig.clone(), self.control_rig.clone());
        if self.mode == SteerMode::MeasuringWheel {
            rig.plant.steer.device = SteerDevice::MeasuringWheel;
            control_rig.plant.steer.device = SteerDevice::MeasuringWheel;
        }
        let mut plant = VirtualRig::new(&rig, &self.unit, self.seed, period_s)?;
        let mut estimate = RackEstimate::new(&self.unit, &control_rig.control, period_s);
        let first = self.output_phase * period_s;
        let mut control = RigController::with_phase(&control_rig, &self.unit, period_s, first)?;
        control.set_switches(self.switches);
        plant.set_environment(&RigEnvironment {
            vehicle_speed_m_s: manoeuvre.speed_m_s,
            ..Default::default()
        });
        let mut load = Load::new(manoeuvre.speed_m_s);
        let (mut m, mut act, mut diag) =
            (Measurement::default(), Actuation::default(), ControlDiagnostics::default());
        let ticks = ((manoeuvre.end_s() + 0.5) / period_s).round() as u32;
        let mut trace = Trace { period_s, ..Trace::default() };
        for n in 0..ticks {
            let time_s = f64::from(n) * period_s;
            plant.sample(&mut m);
            let truth = *plant.truth();
            let (force, height, height_rate) = load.step(estimate.step(&m), period_s);
            let (angle_rad, rate_rad_s) = manoeuvre.steering(time_s);
            let wanted_torque = self.torque_per_angle_n_m_rad * angle_rad;
            let mut environment =
                RigEnvironment { vehicle_speed_m_s: manoeuvre.speed_m_s, ..Default::default() };
            let steer = match self.mode {
                SteerMode::Angle => SteerCommand::Angle { angle_rad, rate_rad_s },
                SteerMode::Torque => SteerCommand::Torque { torque_n_m: wanted_torque },
                SteerMode::MeasuringWheel => {
                    let wheel = &truth.unit;
                    environment.hand_torque_n_m = 20.0 * (angle_rad - wheel.hand_wheel_angle_rad)
                        + 0.6 * (rate_rad_s - wheel.hand_wheel_rate_rad_s);
                    SteerCommand::Free
                }
            };
            plant.set_environment(&environment);
            let command = RigCommand {
                tie_rod_force_n: force,
                ball_height_m: height,
                ball_height_velocity_m_s: height_rate,
                steer,
                fade: Fade { force: (time_s / 1.0).min(1.0), vertical: 1.0, steer: 1.0 },
            };
            control.step(&command, &m, &mut act, &mut diag);
            plant.advance(first);
            plant.set_actuation(&act);
            plant.advance(period_s - first);
            trace.time_s.push(time_s);
            trace.steer_error_rad.push(angle_rad - truth.unit.hand_wheel_angle_rad);
            trace.steer_angle_rad.push(m.steering_wheel_angle_rad);
            trace.steer_torque_n_m.push(m.steering_wheel_torque_n_m);
            trace.steer_torque_command_n_m.push(wanted_torque);
            trace.rack_velocity_m_s.push(truth.unit.rack_velocity_m_s);
            trace.rack_velocity_ahead_m_s.push(diag.rack_velocity_ahead_m_s);
            trace.energy_j.push(diag.energy_total_j);
            trace.saturated.push(diag.flags & 0b11 != 0);
            for side in 0..2 {
                let s = &mut trace.sides[side];
                s.command_n.push(force[side] * command.fade.force);
                s.reading_n.push(m.tie_rod_force_n[side]);
                s.true_n.push(truth.tie_rod_force_n[side]);
                s.height_command_m.push(height[side]);
                s.height_reading_m.push(m.vertical_stroke_m[side]);
                s.estimated_lag_s.push(diag.loop_delay_s[side]);
            }
        }
        Ok(trace)
    }
}

/// Signals of one side.
#[derive(Debug, Clone, Default)]
pub struct SideTrace {
    /// Commanded force. [N]
    pub command_n: Vec<f64>,
    /// Reading of the tie rod's cell available at the tick. [N]
    pub reading_n: Vec<f64>,
    /// True force at the tick. [N]
    pub true_n: Vec<f64>,
    /// Commanded height. [m]
    pub height_command_m: Vec<f64>,
    /// Reading of the vertical stroke. [m]
    pub height_reading_m: Vec<f64>,
    /// Estimated loop delay. [s]
    pub estimated_lag_s: Vec<f64>,
}

/// Signals of one run.
#[derive(Debug, Clone, Default)]
pub struct Trace {
    /// Period. [s]
    pub period_s: f64,
    /// Time of each tick. [s]
    pub time_s: Vec<f64>,
    /// Steering command less true angle. [rad]
    pub steer_error_rad: Vec<f64>,
    /// Reading of the steering angle. [rad]
    pub steer_angle_rad: Vec<f64>,
    /// Reading of the torque cell. [N·m]
    pub steer_torque_n_m: Vec<f64>,
    /// Torque asked for in torque mode. [N·m]
    pub steer_torque_command_n_m: Vec<f64>,
    /// True rack velocity. [m/s]
    pub rack_velocity_m_s: Vec<f64>,
    /// Rack velocity fed forward. [m/s]
    pub rack_velocity_ahead_m_s: Vec<f64>,
    /// Energy account since the start. [J]
    pub energy_j: Vec<f64>,
    /// A horizontal valve was saturated.
    pub saturated: Vec<bool>,
    /// Left, right.
    pub sides: [SideTrace; 2],
}

impl Trace {
    /// Judges the window of active steering.
    pub fn judge(&self, manoeuvre: &Manoeuvre) -> StudyResult {
        let from = (Manoeuvre::START_S / self.period_s).round() as usize;
        let to = ((manoeuvre.end_s() / self.period_s).round() as usize).min(self.time_s.len());
        let mut result = StudyResult::default();
        for (out, s) in result.sides.iter_mut().zip(&self.sides) {
            let command = zero_phase(&s.command_n, 50.0, self.period_s);
            let reading = zero_phase(&s.reading_n, 50.0, self.period_s);
            let truth = zero_phase(&s.true_n, 50.0, self.period_s);
            let window = &command[from..to];
            let (low, high) =
                window.iter().fold((f64::MAX, f64::MIN), |(low, high), v| (low.min(*v), high.max(*v)));
            let amplitude = 0.5 * (high - low);
            out.amplitude_n = amplitude;
            let judge = |signal: &[f64]| {
                let (mut max, mut square) = (0.0_f64, 0.0);
                for (c, s) in window.iter().zip(&signal[from..to]) {
                    max = max.max((c - s).abs());
                    square += (c - s) * (c - s);
                }
                (100.0 * max / amplitude, 100.0 * (square / window.len() as f64).sqrt() / amplitude)
            };
            (out.max_percent, out.rms_percent) = judge(&reading);
            (out.true_max_percent, out.true_rms_percent) = judge(&truth);
            out.force_lag_s = lag(window, &reading[from..to], self.period_s);
            let height = zero_phase(&s.height_command_m, 50.0, self.period_s);
            let stroke = zero_phase(&s.height_reading_m, 50.0, self.period_s);
            out.height_lag_s = lag(&height[from..to], &stroke[from..to], self.period_s);
            out.estimated_lag_s = s.estimated_lag_s[to - 1];
        }
        result.steer_error_rad = self.steer_error_rad[from..to].iter().fold(0.0, |m: f64, e| m.max(e.abs()));
        let largest = |v: &[f64]| v[from..to].iter().fold(0.0, |m: f64, e| m.max(e.abs()));
        let asked = zero_phase(&self.steer_torque_command_n_m, 50.0, self.period_s);
        let given = zero_phase(&self.steer_torque_n_m, 50.0, self.period_s);
        let torque_error: Vec<f64> = asked.iter().zip(&given).map(|(a, b)| a - b).collect();
        result.steer_torque_error_n_m = largest(&torque_error);
        result.steer_angle_max_rad = largest(&self.steer_angle_rad);
        result.steer_torque_max_n_m = largest(&self.steer_torque_n_m);
        let span = (to - from) as f64 * self.period_s;
        result.energy_w = (self.energy_j[to - 1] - self.energy_j[from]) / span;
        result.saturated_ticks = self.saturated[from..to].iter().filter(|s| **s).count() as u32;
        result
    }
}

/// Second-order Butterworth low-pass, run forwards and backwards (no phase, −6 dB at the corner).
pub fn zero_phase(signal: &[f64], corner_hz: f64, period_s: f64) -> Vec<f64> {
    let k = (PI * corner_hz * period_s).tan();
    let norm = 1.0 / (1.0 + core::f64::consts::SQRT_2 * k + k * k);
    let b = k * k * norm;
    let (a1, a2) = (2.0 * (k * k - 1.0) * norm, (1.0 - core::f64::consts::SQRT_2 * k + k * k) * norm);
    let mut out = signal.to_vec();
    for _ in 0..2 {
        let start = out.first().copied().unwrap_or(0.0);
        let (mut x1, mut x2, mut y1, mut y2) = (start, start, start, start);
        for value in &mut out {
            let x = *value;
            let y = b * (x + 2.0 * x1 + x2) - a1 * y1 - a2 * y2;
            (x2, x1, y2, y1) = (x1, x, y1, y);
            *value = y;
        }
        out.reverse();
    }
    out
}

/// Lag of `signal` behind `reference` by the peak of their cross-correlation, parabola through the peak. [s]
pub fn lag(reference: &[f64], signal: &[f64], period_s: f64) -> f64 {
    const REACH: usize = 60;
    let n = reference.len().min(signal.len());
    if n <= 2 * REACH + 2 {
        return 0.0;
    }
    let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
    // Normalised, so that a signal that grows over the window does not pull the peak.
    let middle = &reference[REACH..n - REACH];
    let mr = mean(middle);
    let at = |shift: isize| {
        let from = (REACH as isize + shift) as usize;
        let moved = &signal[from..from + middle.len()];
        let ms = mean(moved);
        let (mut cross, mut power) = (0.0, 0.0);
        for (r, s) in middle.iter().zip(moved) {
            cross += (r - mr) * (s - ms);
            power += (s - ms) * (s - ms);
        }
        cross / power.max(f64::MIN_POSITIVE).sqrt()
    };
    let reach = REACH as isize;
    let (mut best, mut peak) = (0, f64::MIN);
    for shift in -reach + 1..reach {
        let value = at(shift);
        if value > peak {
            (best, peak) = (shift, value);
        }
    }
    let (left, right) = (at(best - 1), at(best + 1));
    let curve = left - 2.0 * peak + right;
    let part = if curve < 0.0 { 0.5 * (left - right) / curve } else { 0.0 };
    (best as f64 + part) * period_s
}

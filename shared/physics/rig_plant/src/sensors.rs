//! Sensors: curves and offsets drawn once a run, noise once a sample, 16-bit conversion.
//!
//! Non-linearity is a smooth curve that vanishes at zero and at full scale (terminal-based), hysteresis a
//! Dahl loop of a fifth of the range, repeatability and zero balance offsets. A reading at the end of the
//! 16-bit range is marked invalid.

use crate::random::Random;
use config::rig::Sensor;

const COUNTS: f64 = 32767.0;

/// How errors of a sensor combine.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ErrorRule {
    /// Non-linearity, hysteresis and gain add up.
    Sum,
    /// One error: the larger of `gain` of the reading and `nonlinearity` of full scale.
    Larger,
}

/// One sensor in one run.
#[derive(Debug, Clone)]
pub struct SensorModel {
    range: f64,
    count: f64,
    odd: f64,
    even: f64,
    gain: f64,
    floor: f64,
    hysteresis: f64,
    offset: f64,
    noise: f64,
    /// What the tare subtracts.
    pub tare: f64,
    /// Position in the hysteresis loop, [-1, 1].
    pub loop_position: f64,
    /// Last input.
    pub last: f64,
}

impl SensorModel {
    /// Values of its flat state.
    pub const STATE: usize = 3;

    /// Draws the run's errors.
    pub fn new(sensor: impl Into<Sensor>, rule: ErrorRule, random: &mut Random) -> Self {
        let sensor = sensor.into();
        let full = sensor.range;
        // Drawn in a fixed order, whatever is zero, so that one sensor's setting does not move another's draw.
        let (size, mix) = (random.symmetric(), random.unit());
        let [hysteresis, offset, zero, gain] = core::array::from_fn(|_| random.symmetric());
        let sum = rule == ErrorRule::Sum;
        let curve = if sum { sensor.nonlinearity * full * size } else { 0.0 };
        Self {
            range: full,
            count: full / COUNTS,
            odd: curve * mix,
            even: curve * (1.0 - mix),
            gain: gain * sensor.gain,
            floor: if sum { 0.0 } else { sensor.nonlinearity * full * gain },
            hysteresis: sensor.hysteresis * full * hysteresis,
            offset: full * (sensor.repeatability * offset + sensor.zero_balance * zero),
            noise: sensor.noise,
            tare: 0.0,
            loop_position: 0.0,
            last: 0.0,
        }
    }

    /// Converts one true value; `normal` is a standard normal number. Returns the reading and its validity.
    pub fn convert(&mut self, value: f64, normal: f64) -> (f64, bool) {
        let change = value - self.last;
        self.last = value;
        let scale = 0.2 * self.range;
        self.loop_position =
            ((self.loop_position + change / scale) / (1.0 + change.abs() / scale)).clamp(-1.0, 1.0);
        let x = (value / self.range).clamp(-1.0, 1.0);
        let rest = 1.0 - x * x;
        // Peaks of x(1-x²) and x²(1-x²) are 0.3849 and 0.25.
        let curve = self.odd * x * rest / 0.384_900_179_459_750_5 + self.even * x * x * rest * 4.0;
        let larger =
            if self.floor.abs() > (self.gain * value).abs() { self.floor } else { self.gain * value.abs() };
        let proportional = if self.floor == 0.0 { self.gain * value } else { larger };
        let analogue = value
            + curve
            + proportional
            + self.hysteresis * self.loop_position
            + self.offset
            + self.noise * normal;
        let counts = (analogue / self.count).round();
        let valid = counts.abs() < COUNTS;
        (counts.clamp(-COUNTS, COUNTS) * self.count - self.tare, valid)
    }
}

/// An incremental encoder: quantised, with an error once a turn.
#[derive(Debug, Clone)]
pub struct Encoder {
    resolution: f64,
    error: f64,
    phase: f64,
}

impl Encoder {
    /// Draws the run's error.
    pub fn new(resolution_rad: f64, error_rad: f64, random: &mut Random) -> Self {
        Self {
            resolution: resolution_rad,
            error: error_rad * random.unit(),
            phase: core::f64::consts::TAU * random.unit(),
        }
    }

    /// Converts one true angle.
    pub fn convert(&self, angle_rad: f64) -> f64 {
        let error = self.error * ((angle_rad + self.phase).sin() - self.phase.sin());
        ((angle_rad + error) / self.resolution).round() * self.resolution
    }
}

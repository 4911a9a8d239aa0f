//! Lead compensation of a servo-valve: its second-order lag is replaced by a faster one.
//!
//! ```text
//! u = v · (s²/ω² + 2ζ s/ω + 1)/(s²/Ω² + 2ζ s/Ω + 1)
//! ```
//!
//! ω, ζ: the valve; Ω: the faster lag. Bilinear transform. What is left counts as delay 2ζ/Ω.

use config::rig::AxisModel;
use rig_plant::state::{StateReader, StateWriter};

/// The compensating filter.
#[derive(Debug, Clone)]
pub struct ValveLead {
    b: [f64; 3],
    a: [f64; 2],
    state: [f64; 2],
    lag_with_s: f64,
    lag_without_s: f64,
}

impl ValveLead {
    /// Values of its flat state.
    pub const STATE: usize = 2;

    /// The filter at rest.
    pub fn new(axis: &AxisModel, period_s: f64) -> Self {
        let z = axis.valve_damping_ratio;
        let (slow, fast) = (
            core::f64::consts::TAU * axis.valve_frequency_hz,
            core::f64::consts::TAU * axis.lead_frequency_hz,
        );
        let k = 2.0 / period_s;
        let poly = |w: f64| {
            let (second, first) = (k * k / (w * w), 2.0 * z * k / w);
            [second + first + 1.0, 2.0 * (1.0 - second), second - first + 1.0]
        };
        let (top, bottom) = (poly(slow), poly(fast));
        Self {
            b: top.map(|v| v / bottom[0]),
            a: [bottom[1] / bottom[0], bottom[2] / bottom[0]],
            state: [0.0; 2],
            lag_with_s: 2.0 * z / fast,
            lag_without_s: 2.0 * z / slow,
        }
    }

    /// Lag that is left, as a delay. [s]
    pub fn lag_s(&self) -> f64 {
        self.lag_with_s
    }

    /// Lag of the bare valve, as a delay. [s]
    pub fn bare_lag_s(&self) -> f64 {
        self.lag_without_s
    }

    /// One sample (transposed direct form II).
    pub fn step(&mut self, x: f64) -> f64 {
        let y = self.b[0] * x + self.state[0];
        self.state[0] = self.b[1] * x - self.a[0] * y + self.state[1];
        self.state[1] = self.b[2] * x - self.a[1] * y;
        y
    }

    /// Writes the state.
    pub fn save(&self, w: &mut StateWriter) {
        w.put_all(&self.state);
    }

    /// Reads the state.
    pub fn load(&mut self, r: &mut StateReader) {
        self.state = r.take_array();
    }
}

/// The valve with its lead, as the faster lag that both together are; its output is velocity, its rate acceleration.
#[derive(Debug, Clone)]
pub struct LedValve {
    omega: f64,
    damping_ratio: f64,
    sub_step_s: f64,
    value: f64,
    rate: f64,
}

impl LedValve {
    /// Values of its flat state.
    pub const STATE: usize = 2;
    const SUB_STEPS: usize = 8;

    /// At rest.
    pub fn new(axis: &AxisModel, period_s: f64) -> Self {
        Self {
            omega: core::f64::consts::TAU * axis.lead_frequency_hz,
            damping_ratio: axis.valve_damping_ratio,
            sub_step_s: period_s / Self::SUB_STEPS as f64,
            value: 0.0,
            rate: 0.0,
        }
    }

    /// One period under a constant input.
    pub fn step(&mut self, input: f64) {
        let (w, h) = (self.omega, self.sub_step_s);
        for _ in 0..Self::SUB_STEPS {
            let pull = self.rate + h * w * w * (input - self.value);
            self.rate = pull / (1.0 + 2.0 * h * self.damping_ratio * w + h * h * w * w);
            self.value += h * self.rate;
        }
    }

    /// Rate of the output at the end of the period, in the input's unit per second.
    pub fn rate(&self) -> f64 {
        self.rate
    }

    /// Writes the state.
    pub fn save(&self, w: &mut StateWriter) {
        w.put_all(&[self.value, self.rate]);
    }

    /// Reads the state.
    pub fn load(&mut self, r: &mut StateReader) {
        [self.value, self.rate] = r.take_array();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn filter_and_valve_together_are_the_faster_valve() {
        let axis = AxisModel {
            no_load_speed_m_s: 0.5,
            stall_force_n: 1.0,
            valve_frequency_hz: 60.0,
            valve_damping_ratio: 0.7,
            lead_frequency_hz: 150.0,
            mass_kg: 1.0,
            valve_rate_limit_1_s: 1.0,
        };
        let mut lead = ValveLead::new(&axis, 1e-3);
        let (mut x, mut rate) = (0.0, 0.0);
        let w = core::f64::consts::TAU * 60.0;
        // Ramp of 1/s: behind a second-order lag by 2ζ/Ω, plus half a sample by the hold.
        let mut behind = 0.0;
        for i in 0..400 {
            let now = f64::from(i) * 1e-3;
            let u = lead.step(now);
            behind = now - x;
            for _ in 0..100 {
                rate += 1e-5 * (w * w * (u - x) - 1.4 * w * rate);
                x += 1e-5 * rate;
            }
        }
        assert!((behind - lead.lag_s() - 0.5e-3).abs() < 0.1e-3, "{behind}");
    }
}

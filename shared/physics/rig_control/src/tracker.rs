//! Trackers that give a sampled signal's rate (and acceleration) without lag on ramps (and parabolas):
//! fading-memory polynomial filters [Brookner 1998, Tracking and Kalman Filtering Made Easy, §1.2.6, 1.3].
//! One multiple pole at e^{−ωT}.

use rig_plant::state::{StateReader, StateWriter};

/// Value and rate; no lag on a ramp.
#[derive(Debug, Clone, PartialEq)]
pub struct RampTracker {
    gains: [f64; 2],
    period_s: f64,
    /// Value.
    pub value: f64,
    /// Rate. [1/s]
    pub rate: f64,
}

impl RampTracker {
    /// A tracker at rest at zero.
    pub fn new(bandwidth_rad_s: f64, period_s: f64) -> Self {
        let p = (-bandwidth_rad_s * period_s).exp();
        Self { gains: [1.0 - p * p, (1.0 - p) * (1.0 - p)], period_s, value: 0.0, rate: 0.0 }
    }

    /// Takes in the next sample; `known_rate` is the part of its rate that is known from elsewhere.
    pub fn step(&mut self, sample: f64, known_rate: f64) {
        let predicted = self.value + self.period_s * (self.rate + known_rate);
        let residual = sample - predicted;
        self.value = predicted + self.gains[0] * residual;
        self.rate += self.gains[1] / self.period_s * residual;
    }

    /// Jumps to a value at rest.
    pub fn reset(&mut self, value: f64) {
        self.value = value;
        self.rate = 0.0;
    }

    /// Writes the state (2 values).
    pub fn save(&self, w: &mut StateWriter) {
        w.put_all(&[self.value, self.rate]);
    }

    /// Reads the state.
    pub fn load(&mut self, r: &mut StateReader) {
        [self.value, self.rate] = r.take_array();
    }
}

/// Value, rate and acceleration; no lag on a parabola.
#[derive(Debug, Clone, PartialEq)]
pub struct ParabolaTracker {
    gains: [f64; 3],
    period_s: f64,
    /// Value.
    pub value: f64,
    /// Rate. [1/s]
    pub rate: f64,
    /// Acceleration. [1/s²]
    pub acceleration: f64,
}

impl ParabolaTracker {
    /// A tracker at rest at zero.
    pub fn new(bandwidth_rad_s: f64, period_s: f64) -> Self {
        let p = (-bandwidth_rad_s * period_s).exp();
        let q = 1.0 - p;
        Self {
            gains: [1.0 - p * p * p, 1.5 * q * q * (1.0 + p), q * q * q],
            period_s,
            value: 0.0,
            rate: 0.0,
            acceleration: 0.0,
        }
    }

    /// Takes in the next sample.
    pub fn step(&mut self, sample: f64) {
        let t = self.period_s;
        let predicted = self.value + t * (self.rate + 0.5 * t * self.acceleration);
        let residual = sample - predicted;
        self.value = predicted + self.gains[0] * residual;
        self.rate += t * self.acceleration + self.gains[1] / t * residual;
        self.acceleration += self.gains[2] / (t * t) * residual;
    }

    /// The value `lead_s` from now.
    pub fn ahead(&self, lead_s: f64) -> f64 {
        self.value + lead_s * (self.rate + 0.5 * lead_s * self.acceleration)
    }

    /// The rate `lead_s` from now.
    pub fn rate_ahead(&self, lead_s: f64) -> f64 {
        self.rate + lead_s * self.acceleration
    }

    /// Jumps to a value at rest.
    pub fn reset(&mut self, value: f64) {
        self.value = value;
        self.rate = 0.0;
        self.acceleration = 0.0;
    }

    /// Writes the state (3 values).
    pub fn save(&self, w: &mut StateWriter) {
        w.put_all(&[self.value, self.rate, self.acceleration]);
    }

    /// Reads the state.
    pub fn load(&mut self, r: &mut StateReader) {
        [self.value, self.rate, self.acceleration] = r.take_array();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_parabola_is_tracked_without_lag() {
        let (mut three, mut two) = (ParabolaTracker::new(100.0, 1e-3), RampTracker::new(100.0, 1e-3));
        let at = |t: f64| 3.0 + 2.0 * t - 7.0 * t * t;
        for i in 0..1000 {
            three.step(at(f64::from(i) * 1e-3));
            two.step(3.0 + 2.0 * f64::from(i) * 1e-3, 0.0);
        }
        let t = 0.999;
        assert!((three.ahead(0.005) - at(t + 0.005)).abs() < 1e-9);
        assert!((three.rate_ahead(0.005) - (2.0 - 14.0 * (t + 0.005))).abs() < 1e-6);
        assert!((two.rate - 2.0).abs() < 1e-9 && (two.value - 3.0 - 2.0 * t).abs() < 1e-9);
    }
}

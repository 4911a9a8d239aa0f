//! Lag of the force loop, estimated while it runs.
//!
//! For a lag τ the error e = F_command − F_reading is τ Ḟ_command + noise; least squares with exponential
//! forgetting gives τ̂ = Σ e Ḟ / Σ Ḟ². Valid while τ is short against the command's period, and only where the
//! command moves: below 200 N/s rms the estimate is kept but not "known".

use rig_plant::state::{StateReader, StateWriter};

/// Estimator of one side.
#[derive(Debug, Clone)]
pub struct DelayEstimate {
    forget: f64,
    cross: f64,
    power: f64,
    weight: f64,
    /// Estimate. [s]
    pub delay_s: f64,
}

impl DelayEstimate {
    /// Values of its flat state.
    pub const STATE: usize = 4;
    const RATE_RMS_N_S: f64 = 200.0;

    /// Forgets over two seconds.
    pub fn new(period_s: f64) -> Self {
        Self { forget: (-period_s / 2.0).exp(), cross: 0.0, power: 0.0, weight: 0.0, delay_s: 0.0 }
    }

    /// Takes in the error and the command's rate.
    pub fn step(&mut self, error_n: f64, rate_n_s: f64) {
        self.cross = self.forget * self.cross + error_n * rate_n_s;
        self.power = self.forget * self.power + rate_n_s * rate_n_s;
        self.weight = self.forget * self.weight + 1.0;
        if self.known() {
            self.delay_s = self.cross / self.power;
        }
    }

    /// Whether the command moves enough.
    pub fn known(&self) -> bool {
        self.power > self.weight * Self::RATE_RMS_N_S * Self::RATE_RMS_N_S
    }

    /// Writes the state.
    pub fn save(&self, w: &mut StateWriter) {
        w.put_all(&[self.cross, self.power, self.weight, self.delay_s]);
    }

    /// Reads the state.
    pub fn load(&mut self, r: &mut StateReader) {
        [self.cross, self.power, self.weight, self.delay_s] = r.take_array();
    }
}

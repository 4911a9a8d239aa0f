//! Energy account at the tie-rod ports.
//!
//! A force that lags or overshoots its command does work on the rack that the simulated tyres never did:
//! P = Σ_sides (F − F_command) u·ẋ_rack. Positive: the rig feeds energy into the steering, which a driver feels
//! as lost damping. Kept per steering cycle (between upward zero crossings of the rack's velocity), over the
//! last second, and since the start. All signals are of the same (measurement) instant.

use rig_plant::state::{StateReader, StateWriter};

const BINS: usize = 100;
/// Rack speed that must be passed both ways for a cycle to count. [m/s]
const CYCLE_SPEED_M_S: f64 = 0.001;

/// Running account.
#[derive(Debug, Clone)]
pub struct EnergyAccount {
    period_s: f64,
    per_bin: u32,
    bins: [f64; BINS],
    bin: usize,
    ticks_in_bin: u32,
    current: f64,
    went_negative: bool,
    in_cycle: f64,
    /// Last full cycle. [J]
    pub cycle_j: f64,
    /// Last second, to 10 ms. [J]
    pub second_j: f64,
    /// Since the start. [J]
    pub total_j: f64,
}

impl EnergyAccount {
    /// Values of its flat state.
    pub const STATE: usize = BINS + 8;

    /// An empty account.
    pub fn new(period_s: f64) -> Self {
        Self {
            period_s,
            per_bin: (0.01 / period_s).round().max(1.0) as u32,
            bins: [0.0; BINS],
            bin: 0,
            ticks_in_bin: 0,
            current: 0.0,
            went_negative: false,
            in_cycle: 0.0,
            cycle_j: 0.0,
            second_j: 0.0,
            total_j: 0.0,
        }
    }

    /// Books one tick.
    pub fn step(&mut self, force_error_on_rack_n: f64, rack_velocity_m_s: f64) {
        let energy = force_error_on_rack_n * rack_velocity_m_s * self.period_s;
        self.total_j += energy;
        self.in_cycle += energy;
        if rack_velocity_m_s < -CYCLE_SPEED_M_S {
            self.went_negative = true;
        } else if rack_velocity_m_s > CYCLE_SPEED_M_S && self.went_negative {
            self.went_negative = false;
            self.cycle_j = self.in_cycle;
            self.in_cycle = 0.0;
        }
        self.current += energy;
        self.ticks_in_bin += 1;
        if self.ticks_in_bin >= self.per_bin {
            self.bins[self.bin] = self.current;
            self.bin = (self.bin + 1) % BINS;
            self.current = 0.0;
            self.ticks_in_bin = 0;
            self.second_j = self.bins.iter().sum();
        }
    }

    /// Writes the state.
    pub fn save(&self, w: &mut StateWriter) {
        w.put_all(&self.bins);
        w.put_all(&[
            self.bin as f64,
            f64::from(self.ticks_in_bin),
            self.current,
            f64::from(u8::from(self.went_negative)),
            self.in_cycle,
            self.cycle_j,
            self.second_j,
            self.total_j,
        ]);
    }

    /// Reads the state.
    pub fn load(&mut self, r: &mut StateReader) {
        r.take_all(&mut self.bins);
        self.bin = (r.take() as usize).min(BINS - 1);
        self.ticks_in_bin = r.take() as u32;
        self.current = r.take();
        self.went_negative = r.take() != 0.0;
        [self.in_cycle, self.cycle_j, self.second_j, self.total_j] = r.take_array();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lagging_force_feeds_what_the_closed_form_says() {
        // Spring-like command −k x, delayed by τ: energy per cycle π k a² sin ωτ.
        let (k, a, w, lag) = (1e5, 0.01, core::f64::consts::TAU * 0.5, 0.006);
        let mut account = EnergyAccount::new(1e-3);
        for i in 0..8000 {
            let t = f64::from(i) * 1e-3;
            let (x_late, x, v) = (a * (w * (t - lag)).sin(), a * (w * t).sin(), a * w * (w * t).cos());
            account.step(-k * x_late + k * x, v);
        }
        let expected = core::f64::consts::PI * k * a * a * (w * lag).sin();
        assert!((account.cycle_j / expected - 1.0).abs() < 0.01, "{} {expected}", account.cycle_j);
        assert!(account.total_j > 3.5 * expected);
    }
}

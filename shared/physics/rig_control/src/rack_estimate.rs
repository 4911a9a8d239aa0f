//! Rack displacement for the models: string potentiometer and pinion joined.
//!
//! The car turns rack displacement into tie-rod force with hundreds of newtons a millimetre (standing tyres most),
//! so a potentiometer's noise of 0.02 mm would shake the rig. The pinion's angle, by encoder and torsion-bar twist,
//! x_p = i (θ − T_tb/k), has a hundredth of that noise but no true zero, and knows neither play nor compliance of the
//! gear. Joined without lag: x̂ = x_p + F (x − x_p), F a first-order low-pass at the crossover, so that below it the
//! potentiometer counts and above it the pinion (complementary filter [Higgins 1975, IEEE Trans. AES 11(3)]).

use config::rig::Control;
use config::unit::SteeringUnit;
use core::f64::consts::TAU;
use rig_plant::Measurement;
use rig_plant::state::{StateReader, StateWriter};

/// The estimate.
#[derive(Debug, Clone)]
pub struct RackEstimate {
    ratio: f64,
    bar: f64,
    gain: f64,
    difference_m: f64,
    last_m: f64,
    started: bool,
}

impl RackEstimate {
    /// Values of its flat state.
    pub const STATE: usize = 3;

    /// An estimate that has seen nothing.
    pub fn new(unit: &SteeringUnit, control: &Control, period_s: f64) -> Self {
        let step = period_s * control.rack_crossover_rad_s;
        Self {
            ratio: unit.rack_travel_m_per_rev / TAU,
            bar: unit.torsion_bar_stiffness_n_m_rad,
            gain: step / (1.0 + step),
            difference_m: 0.0,
            last_m: 0.0,
            started: false,
        }
    }

    /// Takes in a measurement; the displacement. [m] What is not finite leaves the last estimate.
    pub fn step(&mut self, m: &Measurement) -> f64 {
        let pinion = self.ratio * (m.steering_wheel_angle_rad - m.torsion_bar_torque_n_m / self.bar);
        let difference = m.rack_displacement_m - pinion;
        if !difference.is_finite() {
            return self.last_m;
        }
        if !self.started {
            self.difference_m = difference;
            self.started = true;
        }
        self.difference_m += self.gain * (difference - self.difference_m);
        self.last_m = pinion + self.difference_m;
        self.last_m
    }

    /// Writes the state.
    pub fn save(&self, w: &mut StateWriter) {
        w.put_all(&[self.difference_m, self.last_m, f64::from(u8::from(self.started))]);
    }

    /// Reads the state.
    pub fn load(&mut self, r: &mut StateReader) {
        [self.difference_m, self.last_m] = r.take_array();
        self.started = r.take() != 0.0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_falls_tenfold_and_a_moving_rack_is_followed_without_lag() {
        let rig: config::rig::Rig =
            toml::from_str(include_str!("../../../../schemas/rigs/virtual.toml")).unwrap();
        let unit: SteeringUnit =
            toml::from_str(include_str!("../../../../schemas/units/column_eps.toml")).unwrap();
        let mut estimate = RackEstimate::new(&unit, &rig.control, 1e-3);
        let (ratio, bar) = (unit.rack_travel_m_per_rev / TAU, unit.torsion_bar_stiffness_n_m_rad);
        let (mut square, mut seed) = (0.0, 1_u64);
        for n in 0..20_000 {
            let t = f64::from(n) * 1e-3;
            let (rack, torque) = (0.02 * (6.0 * t).sin(), 3.0 * (5.0 * t).cos());
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            // Uniform with the standard deviation of the potentiometer.
            let noise = 2e-5 * 3_f64.sqrt() * ((seed >> 40) as f64 / 8_388_608.0 - 1.0);
            let m = Measurement {
                // The encoder's zero is elsewhere, and the bar a tenth softer than told.
                steering_wheel_angle_rad: rack / ratio + 1.1 * torque / bar + 0.3,
                torsion_bar_torque_n_m: torque,
                rack_displacement_m: rack + noise,
                ..Measurement::default()
            };
            let error = estimate.step(&m) - rack;
            if n > 2000 {
                square += error * error / 18_000.0;
            }
        }
        assert!(square.sqrt() < 6e-6, "{}", square.sqrt());
        let held = estimate.step(&Measurement { rack_displacement_m: f64::NAN, ..Measurement::default() });
        assert!(held.is_finite());
    }
}

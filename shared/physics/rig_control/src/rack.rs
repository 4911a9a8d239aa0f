//! Rack motion from string potentiometer and steering angle, now and ahead.
//!
//! The encoder gives the fast part (ratio × rate, without noise to speak of), the potentiometer the slow
//! part (torsion-bar twist, ratio errors): x̂ follows i·θ̇ + d, and d is corrected by the potentiometer.
//! Both sensors are equally old, so estimate and delay belong together; the prediction adds the delay.

use crate::tracker::{ParabolaTracker, RampTracker};
use rig_plant::state::{StateReader, StateWriter};

/// Observer of the rack.
#[derive(Debug, Clone)]
pub struct RackObserver {
    ratio: f64,
    angle: ParabolaTracker,
    rack: RampTracker,
    started: bool,
}

impl RackObserver {
    /// Values of its flat state.
    pub const STATE: usize = 6;

    /// `ratio_m_rad`: rack travel per radian, signed.
    pub fn new(ratio_m_rad: f64, bandwidth_rad_s: f64, period_s: f64) -> Self {
        Self {
            ratio: ratio_m_rad,
            angle: ParabolaTracker::new(150.0, period_s),
            rack: RampTracker::new(bandwidth_rad_s, period_s),
            started: false,
        }
    }

    /// Takes in a reading of angle and rack.
    pub fn step(&mut self, angle_rad: f64, rack_m: f64) {
        if !self.started {
            self.angle.reset(angle_rad);
            self.rack.reset(rack_m);
            self.started = true;
        }
        self.angle.step(angle_rad);
        self.rack.step(rack_m, self.ratio * self.angle.rate);
    }

    /// Steering angle, rate, acceleration when measured.
    pub fn angle(&self) -> &ParabolaTracker {
        &self.angle
    }

    /// Displacement when measured. [m]
    pub fn displacement_m(&self) -> f64 {
        self.rack.value
    }

    /// Velocity when measured. [m/s]
    pub fn velocity_m_s(&self) -> f64 {
        self.ratio * self.angle.rate + self.rack.rate
    }

    /// Velocity expected with a steering rate ahead of time. [m/s]
    pub fn velocity_ahead_m_s(&self, rate_ahead_rad_s: f64) -> f64 {
        self.ratio * rate_ahead_rad_s + self.rack.rate
    }

    /// Writes the state.
    pub fn save(&self, w: &mut StateWriter) {
        self.angle.save(w);
        self.rack.save(w);
        w.put(f64::from(u8::from(self.started)));
    }

    /// Reads the state.
    pub fn load(&mut self, r: &mut StateReader) {
        self.angle.load(r);
        self.rack.load(r);
        self.started = r.take() != 0.0;
    }
}

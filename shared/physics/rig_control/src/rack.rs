//! Rack motion from string potentiometer and steering angle, now and ahead.
//!
//! The hub's rate gives the fast part (ratio × rate, without noise to speak of), the potentiometer the slow
//! part (torsion-bar twist, ratio errors): x̂ follows i·θ̇ + d, and d is corrected by the potentiometer.
//! Both sensors are equally old, so estimate and delay belong together; the prediction adds the delay.

use crate::tracker::RampTracker;
use rig_plant::state::{StateReader, StateWriter};

/// Observer of the rack.
#[derive(Debug, Clone)]
pub struct RackObserver {
    ratio: f64,
    angle_rate: f64,
    rack: RampTracker,
    started: bool,
}

impl RackObserver {
    /// Values of its flat state.
    pub const STATE: usize = 4;

    /// `ratio_m_rad`: rack travel per radian, signed.
    pub fn new(ratio_m_rad: f64, bandwidth_rad_s: f64, period_s: f64) -> Self {
        Self {
            ratio: ratio_m_rad,
            angle_rate: 0.0,
            rack: RampTracker::new(bandwidth_rad_s, period_s),
            started: false,
        }
    }

    /// Takes in the hub's rate and a reading of the rack.
    pub fn step(&mut self, angle_rate_rad_s: f64, rack_m: f64) {
        if !self.started {
            self.rack.reset(rack_m);
            self.started = true;
        }
        self.angle_rate = angle_rate_rad_s;
        self.rack.step(rack_m, self.ratio * angle_rate_rad_s);
    }

    /// Displacement when measured. [m]
    pub fn displacement_m(&self) -> f64 {
        self.rack.value
    }

    /// Velocity when measured. [m/s]
    pub fn velocity_m_s(&self) -> f64 {
        self.ratio * self.angle_rate + self.rack.rate
    }

    /// Velocity expected with a steering rate ahead of time. [m/s]
    pub fn velocity_ahead_m_s(&self, rate_ahead_rad_s: f64) -> f64 {
        self.ratio * rate_ahead_rad_s + self.rack.rate
    }

    /// Writes the state.
    pub fn save(&self, w: &mut StateWriter) {
        w.put(self.angle_rate);
        self.rack.save(w);
        w.put(f64::from(u8::from(self.started)));
    }

    /// Reads the state.
    pub fn load(&mut self, r: &mut StateReader) {
        self.angle_rate = r.take();
        self.rack.load(r);
        self.started = r.take() != 0.0;
    }
}

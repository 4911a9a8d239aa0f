//! Steer axis: angle, torque, or none.
//!
//! Angle mode: J θ̈ = T − T_cell. State feedback (bandwidth, damping) on the hub's state when the torque will act,
//! the commanded acceleration, the cell's torque fed forward through a filter, and an integral part.
//! Torque mode: the command, a proportional correction by the cell, damping.

use crate::command::SteerCommand;
use crate::hub::HubObserver;
use crate::tracker::RampTracker;
use config::rig::{Control, Switches};
use rig_plant::state::{StateReader, StateWriter};

/// Steer loop.
#[derive(Debug, Clone)]
pub struct SteerLoop {
    control: Control,
    inertia: f64,
    limit: f64,
    period_s: f64,
    rate: RampTracker,
    load_n_m: f64,
    integral_n_m: f64,
    was_angle: bool,
    last_n_m: f64,
    /// Cut at the torque limit.
    pub saturated: bool,
}

impl SteerLoop {
    /// Values of its flat state.
    pub const STATE: usize = 7;

    /// A loop at rest for an actuator of this inertia and torque.
    pub fn new(control: &Control, inertia_kg_m2: f64, limit_n_m: f64, period_s: f64) -> Self {
        Self {
            control: control.clone(),
            inertia: inertia_kg_m2,
            limit: limit_n_m,
            period_s,
            rate: RampTracker::new(150.0, period_s),
            load_n_m: 0.0,
            integral_n_m: 0.0,
            was_angle: false,
            last_n_m: 0.0,
            saturated: false,
        }
    }

    /// Takes over the tuning.
    pub fn tune(&mut self, control: &Control) {
        self.control.steer = control.steer.clone();
    }

    /// One tick: the actuator's torque. `gain` fades the torque mode; angle commands come faded.
    pub fn step(
        &mut self,
        command: &SteerCommand,
        gain: f64,
        hub: &HubObserver,
        cell_n_m: f64,
        switches: &Switches,
    ) -> f64 {
        let (c, t) = (&self.control, self.period_s);
        let load = t * c.steer.load_torque_rad_s;
        self.load_n_m += load / (1.0 + load) * (cell_n_m - self.load_n_m);
        let measured = hub.measured();
        let (state, lead) = if switches.delay_compensation {
            let lead = c.command_delay_s + c.steer.torque_lag_s;
            (hub.ahead(lead + c.measurement_delay_s), lead)
        } else {
            (measured, 0.0)
        };
        let mut torque = 0.0;
        let angle_mode = matches!(command, SteerCommand::Angle { .. }) && gain > 0.0;
        match *command {
            SteerCommand::Angle { angle_rad, rate_rad_s } if angle_mode => {
                if !self.was_angle {
                    self.rate.reset(rate_rad_s);
                    self.integral_n_m = 0.0;
                }
                self.rate.step(rate_rad_s, 0.0);
                let w = c.steer.bandwidth_rad_s;
                let target = angle_rad + lead * (rate_rad_s + 0.5 * lead * self.rate.rate);
                let target_rate = rate_rad_s + lead * self.rate.rate;
                let error = target - state.angle_rad;
                let error_rate = target_rate - state.rate_rad_s;
                if !self.saturated {
                    let present = angle_rad - c.measurement_delay_s * rate_rad_s - measured.angle_rad;
                    self.integral_n_m += t * c.steer.integral_rad_s * self.inertia * w * w * present;
                    self.integral_n_m = self.integral_n_m.clamp(-self.limit, self.limit);
                }
                torque = self.inertia
                    * (self.rate.rate + w * w * error + 2.0 * c.steer.damping_ratio * w * error_rate)
                    + self.load_n_m
                    + self.integral_n_m;
            }
            SteerCommand::Torque { torque_n_m } => {
                let error = torque_n_m - cell_n_m;
                torque = torque_n_m + c.steer.torque_gain * error
                    - c.steer.torque_damping_n_m_s_rad * measured.rate_rad_s;
                torque *= gain;
            }
            SteerCommand::Angle { .. } | SteerCommand::Free => {}
        }
        self.was_angle = angle_mode;
        self.saturated = torque.abs() > self.limit;
        self.last_n_m = torque.clamp(-self.limit, self.limit);
        self.last_n_m
    }

    /// Writes the state.
    pub fn save(&self, w: &mut StateWriter) {
        self.rate.save(w);
        w.put_all(&[
            self.load_n_m,
            self.integral_n_m,
            self.last_n_m,
            f64::from(u8::from(self.was_angle)),
            f64::from(u8::from(self.saturated)),
        ]);
    }

    /// Reads the state.
    pub fn load(&mut self, r: &mut StateReader) {
        self.rate.load(r);
        [self.load_n_m, self.integral_n_m, self.last_n_m] = r.take_array();
        self.was_angle = r.take() != 0.0;
        self.saturated = r.take() != 0.0;
    }
}

//! Rack motion, now and ahead.
//!
//! Now, by kinematics: v = i (θ̇ − Ṫ_tb/k), from hub observer and torsion-bar torque, whatever friction does;
//! the string potentiometer corrects displacement and a slow velocity error. All readings are equally old.
//!
//! Ahead, by a short simulation over the delays (steering angle → rack, thesis 5.1.1-2): the hub goes on as its
//! loop makes it follow the known steering, the torsion bar winds, and the rack obeys
//! m v̇ = (T_tb + T_assist)/i + F_rods − d v + m a_d with T_assist growing with T_tb at its present gain, and a_d an
//! observed acceleration that stands for friction and all else that the model does not know.

use crate::hub::{HubObserver, HubState};
use crate::tracker::RampTracker;
use config::rig::Control;
use config::unit::SteeringUnit;
use core::f64::consts::TAU;
use rig_plant::state::{StateReader, StateWriter};

/// Observer of the rack.
#[derive(Debug, Clone)]
pub struct RackObserver {
    ratio: f64,
    bar: f64,
    mass: f64,
    damping: f64,
    hub_bandwidth: f64,
    hub_damping: f64,
    hub_age_s: f64,
    rack: RampTracker,
    torque: RampTracker,
    assist: RampTracker,
    motion: RampTracker,
    velocity: f64,
    started: bool,
}

/// Steering that is asked for: now and a lead ahead.
#[derive(Debug, Clone, Copy, Default)]
pub struct SteerReference {
    /// Now.
    pub now: HubState,
    /// At the lead.
    pub then: HubState,
}

impl RackObserver {
    /// Values of its flat state.
    pub const STATE: usize = 10;
    const STEPS: usize = 8;

    /// An observer that has seen nothing.
    pub fn new(unit: &SteeringUnit, control: &Control, period_s: f64) -> Self {
        Self {
            ratio: unit.rack_travel_m_per_rev / TAU,
            bar: unit.torsion_bar_stiffness_n_m_rad,
            mass: unit.rack_mass_kg + unit.assist_inertia_at_rack_kg,
            damping: unit.rack_damping_n_s_m,
            hub_bandwidth: control.steer.bandwidth_rad_s,
            hub_damping: control.steer.damping_ratio,
            hub_age_s: control.command_delay_s + control.steer.torque_lag_s + control.measurement_delay_s,
            rack: RampTracker::new(control.force.rack_observer_rad_s, period_s),
            torque: RampTracker::new(400.0, period_s),
            assist: RampTracker::new(400.0, period_s),
            motion: RampTracker::new(100.0, period_s),
            velocity: 0.0,
            started: false,
        }
    }

    /// Takes over the steer loop's tuning, by which the hub follows.
    pub fn tune(&mut self, control: &Control) {
        self.hub_bandwidth = control.steer.bandwidth_rad_s;
        self.hub_damping = control.steer.damping_ratio;
    }

    /// Takes in the hub's rate and the readings of a tick. `rods_n`: force of both rods on the rack.
    pub fn step(&mut self, hub_rate_rad_s: f64, rack_m: f64, torque_n_m: f64, assist_n_m: f64, rods_n: f64) {
        if !self.started {
            self.rack.reset(rack_m);
            self.torque.reset(torque_n_m);
            self.assist.reset(assist_n_m);
            self.started = true;
        }
        self.torque.step(torque_n_m, 0.0);
        self.assist.step(assist_n_m, 0.0);
        let kinematic = self.ratio * (hub_rate_rad_s - self.torque.rate / self.bar);
        self.rack.step(rack_m, kinematic);
        self.velocity = kinematic + self.rack.rate;
        let known = self.acceleration(torque_n_m, assist_n_m, rods_n, self.velocity);
        self.motion.step(self.velocity, known);
    }

    fn acceleration(&self, torque_n_m: f64, assist_n_m: f64, rods_n: f64, velocity_m_s: f64) -> f64 {
        ((torque_n_m + assist_n_m) / self.ratio + rods_n - self.damping * velocity_m_s) / self.mass
    }

    /// Displacement when measured. [m]
    pub fn displacement_m(&self) -> f64 {
        self.rack.value
    }

    /// Velocity when measured. [m/s]
    pub fn velocity_m_s(&self) -> f64 {
        self.velocity
    }

    /// Velocity `horizon_s` after the measurement. [m/s]
    pub fn velocity_ahead_m_s(
        &self,
        hub: &HubObserver,
        reference: Option<&SteerReference>,
        rods_n: f64,
        horizon_s: f64,
    ) -> f64 {
        let h = horizon_s / Self::STEPS as f64;
        let start = hub.measured();
        let known = hub.ahead(self.hub_age_s);
        let slope = (known.rate_rad_s - start.rate_rad_s) / self.hub_age_s.max(h);
        let (torque_0, assist_0) = (self.torque.value, self.assist.value);
        // Present gain of the assist, from its share of the torque.
        let gain = if torque_0.abs() > 0.3 { (1.3 * assist_0 / torque_0).clamp(0.0, 30.0) } else { 1.0 };
        let (mut torque, mut velocity) = (torque_0, self.velocity);
        let mut hub_state = start;
        let (w, z) = (self.hub_bandwidth, self.hub_damping);
        for k in 0..Self::STEPS {
            let s = (k as f64 + 0.5) * h;
            let hub_acceleration = match reference {
                Some(r) if s > self.hub_age_s => {
                    let part = s / horizon_s;
                    let rate = r.now.rate_rad_s + part * (r.then.rate_rad_s - r.now.rate_rad_s);
                    let angle = r.now.angle_rad + part * (r.then.angle_rad - r.now.angle_rad);
                    let wanted = (r.then.rate_rad_s - r.now.rate_rad_s) / horizon_s;
                    wanted
                        + w * w * (angle - hub_state.angle_rad)
                        + 2.0 * z * w * (rate - hub_state.rate_rad_s)
                }
                _ => slope,
            };
            hub_state.rate_rad_s += h * hub_acceleration;
            hub_state.angle_rad += h * hub_state.rate_rad_s;
            torque += h * self.bar * (hub_state.rate_rad_s - velocity / self.ratio);
            let assist = assist_0 + gain * (torque - torque_0);
            velocity += h * (self.acceleration(torque, assist, rods_n, velocity) + self.motion.rate);
        }
        velocity
    }

    /// Writes the state.
    pub fn save(&self, w: &mut StateWriter) {
        self.rack.save(w);
        self.torque.save(w);
        self.assist.save(w);
        self.motion.save(w);
        w.put_all(&[self.velocity, f64::from(u8::from(self.started))]);
    }

    /// Reads the state.
    pub fn load(&mut self, r: &mut StateReader) {
        self.rack.load(r);
        self.torque.load(r);
        self.assist.load(r);
        self.motion.load(r);
        self.velocity = r.take();
        self.started = r.take() != 0.0;
    }
}

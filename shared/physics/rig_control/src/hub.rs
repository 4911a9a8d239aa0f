//! Angle, rate and acceleration of the hand-wheel hub, when measured and ahead.
//!
//! With an actuator: J θ̈ = T_sent(t − delay) − T_cell, corrected by the encoder; so the rate has no lag, and the
//! torque still on its way gives the state ahead. With a measuring wheel the hand's torque is unknown: a tracker
//! on the encoder alone.

use crate::history::History;
use crate::tracker::{ParabolaTracker, RampTracker};
use rig_plant::state::{StateReader, StateWriter};

/// State of the hub at some instant.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct HubState {
    /// Angle. [rad]
    pub angle_rad: f64,
    /// Rate. [rad/s]
    pub rate_rad_s: f64,
}

/// Observer of the hub.
#[derive(Debug, Clone)]
pub struct HubObserver {
    inertia: Option<f64>,
    delay_s: f64,
    period_s: f64,
    sent: History,
    driven: RampTracker,
    free: ParabolaTracker,
    torque_cell: RampTracker,
    started: bool,
}

impl HubObserver {
    /// `inertia_kg_m2`: on the motor's side of the cell, if there is a motor. `delay_s`: torque command to measurement.
    pub fn new(inertia_kg_m2: Option<f64>, delay_s: f64, period_s: f64) -> Self {
        Self {
            inertia: inertia_kg_m2,
            delay_s,
            period_s,
            sent: History::new(delay_s, period_s),
            driven: RampTracker::new(200.0, period_s),
            free: ParabolaTracker::new(150.0, period_s),
            torque_cell: RampTracker::new(300.0, period_s),
            started: false,
        }
    }

    /// Takes in the readings of a tick.
    pub fn step(&mut self, angle_rad: f64, cell_n_m: f64) {
        if !self.started {
            self.free.reset(angle_rad);
            self.driven.reset(angle_rad);
            self.torque_cell.reset(cell_n_m);
            self.started = true;
        }
        self.torque_cell.step(cell_n_m, 0.0);
        match self.inertia {
            Some(inertia) => {
                let acceleration = (self.sent.arrived() - cell_n_m) / inertia;
                self.driven.value += 0.5 * self.period_s * self.period_s * acceleration;
                self.driven.rate += self.period_s * acceleration;
                // The step of the tracker moves the angle by the new rate: take half a step back.
                self.driven.value -= self.period_s * self.period_s * acceleration;
                self.driven.step(angle_rad, 0.0);
            }
            None => self.free.step(angle_rad),
        }
    }

    /// The state when measured.
    pub fn measured(&self) -> HubState {
        match self.inertia {
            Some(_) => HubState { angle_rad: self.driven.value, rate_rad_s: self.driven.rate },
            None => HubState { angle_rad: self.free.value, rate_rad_s: self.free.rate },
        }
    }

    /// The state when the next torque acts (with an actuator) or `lead_s` after the measurement (without).
    pub fn ahead(&self, lead_s: f64) -> HubState {
        match self.inertia {
            Some(inertia) => {
                let d = self.delay_s;
                let load = self.torque_cell.value + 0.5 * d * self.torque_cell.rate;
                let gain = (self.sent.pending() - d * load) / inertia;
                HubState {
                    angle_rad: self.driven.value + d * (self.driven.rate + 0.5 * gain),
                    rate_rad_s: self.driven.rate + gain,
                }
            }
            None => HubState { angle_rad: self.free.ahead(lead_s), rate_rad_s: self.free.rate_ahead(lead_s) },
        }
    }

    /// Torque of the cell, filtered. [N·m]
    pub fn cell_n_m(&self) -> f64 {
        self.torque_cell.value
    }

    /// Notes the torque sent in this tick.
    pub fn sent(&mut self, torque_n_m: f64) {
        self.sent.push(torque_n_m);
    }

    /// Length of the flat state.
    pub fn state_len(&self) -> usize {
        self.sent.state_len() + 2 + 3 + 2 + 1
    }

    /// Writes the state.
    pub fn save(&self, w: &mut StateWriter) {
        self.sent.save(w);
        self.driven.save(w);
        self.free.save(w);
        self.torque_cell.save(w);
        w.put(f64::from(u8::from(self.started)));
    }

    /// Reads the state.
    pub fn load(&mut self, r: &mut StateReader) {
        self.sent.load(r);
        self.driven.load(r);
        self.free.load(r);
        self.torque_cell.load(r);
        self.started = r.take() != 0.0;
    }
}

//! Height of one outer ball by its vertical cylinder: the force loop's structure on a position.
//!
//! The valve is a velocity source and the stroke its integral: bandwidth × predicted position error, the
//! commanded velocity fed forward to the instant at which the valve reacts, and an integral part on the
//! present error.

use crate::history::History;
use crate::tracker::RampTracker;
use crate::valve::ValveLead;
use config::rig::{Control, Switches};
use rig_plant::state::{StateReader, StateWriter};

/// Height loop of one side.
#[derive(Debug, Clone)]
pub struct HeightLoop {
    control: Control,
    period_s: f64,
    input_delay_s: f64,
    velocity: RampTracker,
    sent: History,
    integral_m_s: f64,
    lead: ValveLead,
    valve: f64,
    /// Velocity that was asked for last. [m/s]
    pub velocity_m_s: f64,
    /// Cut at full opening.
    pub saturated: bool,
    /// Slowed to the rate limit.
    pub rate_limited: bool,
}

impl HeightLoop {
    /// A loop at rest.
    pub fn new(control: &Control, period_s: f64) -> Self {
        let lead = ValveLead::new(&control.vertical, period_s);
        let input_delay_s = control.command_delay_s + lead.lag_s();
        Self {
            period_s,
            input_delay_s,
            velocity: RampTracker::new(120.0, period_s),
            sent: History::new(input_delay_s + control.measurement_delay_s, period_s),
            integral_m_s: 0.0,
            lead,
            valve: 0.0,
            velocity_m_s: 0.0,
            saturated: false,
            rate_limited: false,
            control: control.clone(),
        }
    }

    /// Takes over the tuning.
    pub fn tune(&mut self, control: &Control) {
        self.control.height = control.height.clone();
    }

    /// Commanded velocity `lead_s` from now. [m/s]
    pub fn velocity_ahead_m_s(&self, lead_s: f64) -> f64 {
        self.velocity.value + lead_s * self.velocity.rate
    }

    /// One tick: the valve's opening.
    pub fn step(
        &mut self,
        height_m: f64,
        velocity_m_s: f64,
        stroke_m: f64,
        active: bool,
        switches: &Switches,
    ) -> f64 {
        let (c, t) = (&self.control, self.period_s);
        self.velocity.step(velocity_m_s, 0.0);
        let lead = if switches.delay_compensation { self.input_delay_s + 0.5 * t } else { 0.0 };
        let pending = if switches.delay_compensation { self.sent.pending() } else { 0.0 };
        let target = height_m + lead * (velocity_m_s + 0.5 * lead * self.velocity.rate);
        let error = target - stroke_m - pending;
        let present = height_m - c.measurement_delay_s * velocity_m_s - stroke_m;
        if active && !self.saturated {
            self.integral_m_s += t * c.height.integral_rad_s * c.height.bandwidth_rad_s * present;
            self.integral_m_s = self.integral_m_s.clamp(-0.05, 0.05);
        }
        let proportional = velocity_m_s + lead * self.velocity.rate + c.height.bandwidth_rad_s * error;
        let axis = &c.vertical;
        let wanted = if active { proportional + self.integral_m_s } else { 0.0 };
        let valve = wanted / axis.no_load_speed_m_s;
        self.saturated = valve.abs() > 1.0;
        let valve = valve.clamp(-1.0, 1.0);
        let slew = axis.valve_rate_limit_1_s * t;
        let limited = valve.clamp(self.valve - slew, self.valve + slew);
        self.rate_limited = limited != valve;
        self.valve = limited;
        self.velocity_m_s = limited * axis.no_load_speed_m_s;
        // The integral part holds the axis against leakage; it moves nothing.
        let moving = if active { self.velocity_m_s - self.integral_m_s } else { 0.0 };
        self.sent.push(moving);
        let led = self.lead.step(limited);
        if switches.delay_compensation { led.clamp(-1.0, 1.0) } else { limited }
    }

    /// Length of the flat state.
    pub fn state_len(&self) -> usize {
        2 + self.sent.state_len() + ValveLead::STATE + 5
    }

    /// Writes the state.
    pub fn save(&self, w: &mut StateWriter) {
        self.velocity.save(w);
        self.sent.save(w);
        self.lead.save(w);
        w.put_all(&[
            self.integral_m_s,
            self.valve,
            self.velocity_m_s,
            f64::from(u8::from(self.saturated)),
            f64::from(u8::from(self.rate_limited)),
        ]);
    }

    /// Reads the state.
    pub fn load(&mut self, r: &mut StateReader) {
        self.velocity.load(r);
        self.sent.load(r);
        self.lead.load(r);
        [self.integral_m_s, self.valve, self.velocity_m_s] = r.take_array();
        self.saturated = r.take() != 0.0;
        self.rate_limited = r.take() != 0.0;
    }
}

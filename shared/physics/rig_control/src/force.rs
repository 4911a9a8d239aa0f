//! Tie-rod force of one side by its horizontal cylinder.
//!
//! The valve is a velocity source and the rod a spring: Ḟ = k (a q̇ + u_z ż − σ u_o ẋ_rack), with a the
//! linkage's elongation per stroke. So the loop asks for a stroke velocity made of
//!
//! 1. what the rack and the vertical axis will do (rack feed-forward, thesis 5.1.1-2),
//! 2. what the commanded force's rate needs (Ḟ/k),
//! 3. bandwidth × predicted force error / k (proportional), less the observed disturbance (integral action),
//!
//! all for the instant at which the valve will have reacted. The predictor (finite spectrum assignment
//! [Manitius & Olbrot 1979], here for an integrator) adds to the observed force what is still on its way; the
//! valve is led, and what lag is left counts as delay (thesis 5.1.1-3). With delay compensation off the loop is a plain PID on
//! the present error. Feedback: the cylinder's cell converted by the geometry, less the force that accelerates
//! arm and column, above the crossover frequency; the tie rod's own cell below it (thesis 5.1.1-1).

use crate::history::History;
use crate::tracker::ParabolaTracker;
use crate::valve::{LedValve, ValveLead};
use config::rig::{Control, Switches};
use rig_plant::state::{StateReader, StateWriter};

/// What the loop of one side needs of a tick.
#[derive(Debug, Clone, Copy, Default)]
pub struct ForceInput {
    /// Commanded force. [N]
    pub command_n: f64,
    /// Reading of the tie rod's cell. [N]
    pub tie_rod_n: f64,
    /// Reading of the cylinder's cell. [N]
    pub actuator_n: f64,
    /// Reading of the cylinder's stroke. [m]
    pub stroke_m: f64,
    /// Elongation per stroke. [-]
    pub elongation_per_stroke: f64,
    /// Elongation per metre of the upper arm's tip. [-]
    pub per_tip: f64,
    /// Elongation rate that rack and vertical axis will cause when the valve reacts; + lengthens. [m/s]
    pub outer_motion_m_s: f64,
    /// Whether loop and integrators act (hydraulics on).
    pub active: bool,
}

/// Force loop of one side.
#[derive(Debug, Clone)]
pub struct ForceLoop {
    control: Control,
    period_s: f64,
    input_delay_s: f64,
    command: ParabolaTracker,
    trim_n: f64,
    net: History,
    stroke: History,
    gain_fit: GainFit,
    reaching: History,
    valve_model: LedValve,
    observed_n: f64,
    disturbance_m_s: f64,
    integral_m_s: f64,
    lead: ValveLead,
    valve: f64,
    last_feedback_n: f64,
    rate_filtered: f64,
    /// Cut at full opening.
    pub saturated: bool,
    /// Slowed to the rate limit.
    pub rate_limited: bool,
}

impl ForceLoop {
    /// A loop at rest.
    pub fn new(control: &Control, period_s: f64) -> Self {
        let lead = ValveLead::new(&control.horizontal, period_s);
        let input_delay_s = control.command_delay_s + lead.lag_s();
        let total = input_delay_s + control.measurement_delay_s;
        Self {
            period_s,
            input_delay_s,
            command: ParabolaTracker::new(control.force.command_tracker_rad_s, period_s),
            trim_n: 0.0,
            net: History::new(total, period_s),
            stroke: History::new(total, period_s),
            gain_fit: GainFit::new(period_s),
            reaching: History::new(control.command_delay_s + control.measurement_delay_s, period_s),
            valve_model: LedValve::new(&control.horizontal, period_s),
            observed_n: 0.0,
            disturbance_m_s: 0.0,
            integral_m_s: 0.0,
            lead,
            valve: 0.0,
            last_feedback_n: 0.0,
            rate_filtered: 0.0,
            saturated: false,
            rate_limited: false,
            control: control.clone(),
        }
    }

    /// Takes over the tuning; delays and the command's tracker stay as they were built.
    pub fn tune(&mut self, control: &Control) {
        self.control.force = control.force.clone();
    }

    /// Time from a command to the middle of its effect. [s]
    pub fn lead_s(&self) -> f64 {
        self.input_delay_s + 0.5 * self.period_s
    }

    /// Rate of the commanded force. [N/s]
    pub fn command_rate_n_s(&self) -> f64 {
        self.command.rate
    }

    /// Commanded force as it was when the sensors were read. [N]
    pub fn command_when_measured_n(&self) -> f64 {
        self.command.ahead(-self.control.measurement_delay_s)
    }

    /// Velocity that nothing explains. [m/s]
    pub fn disturbance_m_s(&self) -> f64 {
        self.disturbance_m_s + self.integral_m_s
    }

    /// Force the loop works on. [N]
    pub fn feedback_n(&self) -> f64 {
        self.last_feedback_n
    }

    /// One tick: the valve's opening.
    pub fn step(&mut self, i: &ForceInput, switches: &Switches) -> f64 {
        let (c, t) = (&self.control, self.period_s);
        let (k, w_c) = (c.tie_rod_stiffness_n_m, c.force.bandwidth_rad_s);
        self.command.step(i.command_n);

        // Feedback.
        let arrived_stroke = self.stroke.arrived();
        self.gain_fit.step(i.stroke_m, arrived_stroke * t);
        // The valve as led answers like a faster one: the acceleration of arm and column is known from what was
        // sent, at the instant of the measurement, without differentiating a reading.
        self.valve_model.step(self.reaching.arrived());
        let stroke_acceleration = self.gain_fit.gain() * self.valve_model.rate();
        let tip_acceleration = stroke_acceleration * i.elongation_per_stroke / i.per_tip;
        let inertia = if switches.inertia_feed_forward {
            c.horizontal.mass_kg * tip_acceleration / i.per_tip
        } else {
            0.0
        };
        let converted = i.actuator_n / i.elongation_per_stroke - inertia;
        let trim = t * c.force.cell_crossover_rad_s;
        self.trim_n += trim / (1.0 + trim) * (i.tie_rod_n - converted - self.trim_n);
        let feedback = converted + self.trim_n;

        // Observer of force and unexplained velocity, at the instant of the measurement.
        let arrived = self.net.arrived();
        let p = (-c.force.observer_rad_s * t).exp();
        let predicted = self.observed_n + t * k * (arrived + self.disturbance_m_s);
        let residual = feedback - predicted;
        self.observed_n = predicted + (1.0 - p * p) * residual;
        if !self.saturated && i.active {
            self.disturbance_m_s += (1.0 - p) * (1.0 - p) / (t * k) * residual;
        }

        let rate_feedback = (feedback - self.last_feedback_n) / t;
        self.last_feedback_n = feedback;
        self.rate_filtered += t * 300.0 / (1.0 + t * 300.0) * (rate_feedback - self.rate_filtered);

        // What is wanted of the tie rod.
        let (lead, total) = if switches.delay_compensation {
            (self.lead_s(), self.input_delay_s + c.measurement_delay_s)
        } else {
            (0.0, 0.0)
        };
        let target = i.command_n + lead * (self.command.rate + 0.5 * lead * self.command.acceleration);
        let feed = if switches.force_rate_feed_forward { self.command.rate_ahead(lead) / k } else { 0.0 };
        let mut net = feed;
        if switches.delay_compensation {
            let ahead = self.observed_n + k * (self.net.pending() + self.disturbance_m_s * total);
            net += w_c / k * (target - ahead) - self.disturbance_m_s;
            self.integral_m_s = 0.0;
        } else {
            // A PID has the whole delay in its loop: no faster than leaves it a phase margin of about 60 degrees.
            let delay = c.command_delay_s + self.lead.bare_lag_s() + c.measurement_delay_s + 0.5 * t;
            let w_c = w_c.min(0.4 / delay);
            let error = i.command_n - feedback;
            if !self.saturated && i.active {
                self.integral_m_s += t * c.force.integral_rad_s * w_c / k * error;
            }
            net += w_c / k * (error - c.force.derivative_s * self.rate_filtered) + self.integral_m_s;
        }

        // Stroke velocity and valve.
        let stroke_velocity = (net - i.outer_motion_m_s) / i.elongation_per_stroke;
        let axis = &c.horizontal;
        let load = (i.actuator_n / axis.stall_force_n * stroke_velocity.signum()).clamp(-0.9, 0.9);
        let flow = if switches.pressure_compensation { (1.0 - load).sqrt() } else { 1.0 };
        let learnt = if switches.gain_adaptation { self.gain_fit.gain() } else { 1.0 };
        let full_speed = axis.no_load_speed_m_s * flow * learnt;
        let mut opening = if i.active { stroke_velocity / full_speed } else { 0.0 };
        self.saturated = opening.abs() > 1.0;
        opening = opening.clamp(-1.0, 1.0);
        let slew = axis.valve_rate_limit_1_s * t;
        let limited = opening.clamp(self.valve - slew, self.valve + slew);
        self.rate_limited = limited != opening;
        self.valve = limited;
        let led = self.lead.step(limited);
        let command = if switches.delay_compensation { led.clamp(-1.0, 1.0) } else { limited };

        // What was really asked for, for predictor and observer (anti-windup).
        let got = limited * full_speed;
        let net_got = got * i.elongation_per_stroke + i.outer_motion_m_s;
        self.net.push(if i.active { net_got } else { 0.0 });
        // The fit compares with what the unlearnt model promises.
        self.stroke.push(got / learnt);
        self.reaching.push(got / learnt);
        if !i.active {
            self.disturbance_m_s = 0.0;
            self.integral_m_s = 0.0;
            self.observed_n = feedback;
        }
        command
    }

    /// Length of the flat state.
    pub fn state_len(&self) -> usize {
        let histories = self.net.state_len() + self.stroke.state_len() + self.reaching.state_len();
        3 + histories + GainFit::STATE + ValveLead::STATE + LedValve::STATE + 9
    }

    /// Writes the state.
    pub fn save(&self, w: &mut StateWriter) {
        self.command.save(w);
        self.net.save(w);
        self.stroke.save(w);
        self.gain_fit.save(w);
        self.reaching.save(w);
        self.valve_model.save(w);
        self.lead.save(w);
        w.put_all(&[
            self.trim_n,
            self.observed_n,
            self.disturbance_m_s,
            self.integral_m_s,
            self.valve,
            self.last_feedback_n,
            self.rate_filtered,
            f64::from(u8::from(self.saturated)),
            f64::from(u8::from(self.rate_limited)),
        ]);
    }

    /// Reads the state.
    pub fn load(&mut self, r: &mut StateReader) {
        self.command.load(r);
        self.net.load(r);
        self.stroke.load(r);
        self.gain_fit.load(r);
        self.reaching.load(r);
        self.valve_model.load(r);
        self.lead.load(r);
        [
            self.trim_n,
            self.observed_n,
            self.disturbance_m_s,
            self.integral_m_s,
            self.valve,
            self.last_feedback_n,
            self.rate_filtered,
        ] = r.take_array();
        self.saturated = r.take() != 0.0;
        self.rate_limited = r.take() != 0.0;
    }
}

/// Least squares of measured stroke steps on promised ones, both low-passed (the valve does not follow the loop's
/// noise), with exponential forgetting and a belief.
#[derive(Debug, Clone)]
struct Fit {
    forget: f64,
    low: f64,
    belief_m2: f64,
    cross: f64,
    power: f64,
    /// Step and promise, low-passed. [m]
    slow: [f64; 2],
}

impl Fit {
    const STATE: usize = 4;

    /// `low_rad_s`: corner of the low-pass; `belief_m2`: weight of the belief as squared stroke steps.
    fn new(low_rad_s: f64, forget_s: f64, belief_m2: f64, period_s: f64) -> Self {
        let low = 1.0 - (-low_rad_s * period_s).exp();
        // Squared steps of a tick grow with its square, their number falls with it: the belief is for 1 ms.
        let belief_m2 = belief_m2 * period_s / 1e-3;
        Self { forget: (-period_s / forget_s).exp(), low, belief_m2, cross: 0.0, power: 0.0, slow: [0.0; 2] }
    }

    fn step(&mut self, step_m: f64, promised_m: f64) {
        for (slow, now) in self.slow.iter_mut().zip([step_m, promised_m]) {
            *slow += self.low * (now - *slow);
        }
        let [step, promised] = self.slow;
        self.cross = self.forget * self.cross + step * promised;
        self.power = self.forget * self.power + promised * promised;
    }

    fn gain(&self, believed: f64) -> f64 {
        ((self.cross + self.belief_m2 * believed) / (self.power + self.belief_m2)).clamp(0.5, 2.0)
    }

    fn save(&self, w: &mut StateWriter) {
        w.put_all(&[self.cross, self.power, self.slow[0], self.slow[1]]);
    }

    fn load(&mut self, r: &mut StateReader) {
        [self.cross, self.power, self.slow[0], self.slow[1]] = r.take_array();
    }
}

/// Valve gain over the believed one, learnt in two stages: over seconds from all that moves, and within the first
/// tens of milliseconds of a fast motion (a rack that breaks away) from that motion, the slow stage being its belief.
#[derive(Debug, Clone)]
struct GainFit {
    slow: Fit,
    fast: Fit,
    last_stroke: f64,
    started: bool,
}

impl GainFit {
    const STATE: usize = 2 * Fit::STATE + 2;

    fn new(period_s: f64) -> Self {
        Self {
            slow: Fit::new(30.0, 5.0, 1e-8, period_s),
            fast: Fit::new(150.0, 0.1, 3e-9, period_s),
            last_stroke: 0.0,
            started: false,
        }
    }

    fn step(&mut self, stroke_m: f64, promised_m: f64) {
        if self.started {
            let step = stroke_m - self.last_stroke;
            self.slow.step(step, promised_m);
            self.fast.step(step, promised_m);
        }
        self.last_stroke = stroke_m;
        self.started = true;
    }

    fn gain(&self) -> f64 {
        self.fast.gain(self.slow.gain(1.0))
    }

    fn save(&self, w: &mut StateWriter) {
        self.slow.save(w);
        self.fast.save(w);
        w.put_all(&[self.last_stroke, f64::from(u8::from(self.started))]);
    }

    fn load(&mut self, r: &mut StateReader) {
        self.slow.load(r);
        self.fast.load(r);
        self.last_stroke = r.take();
        self.started = r.take() != 0.0;
    }
}

//! One tick of the rig's control: measurement and command in, actuation and diagnostics out.
//!
//! Order: hold what is not finite → fades → rack observer → geometry → vertical loops → force loops (fed with
//! what rack and vertical axes will do) → steer loop → account. Nothing allocates after the constructor.

use crate::command::{ControlDiagnostics, Fade, RigCommand, SteerCommand, flags};
use crate::delay::DelayEstimate;
use crate::energy::EnergyAccount;
use crate::force::{ForceInput, ForceLoop};
use crate::height::HeightLoop;
use crate::hub::{HubObserver, HubState};
use crate::rack::{RackObserver, SteerReference};
use crate::steer::SteerLoop;
use config::Broken;
use config::rig::{Control, Rig, SteerDevice, Switches, check_rig};
use config::unit::SteeringUnit;
use rig_plant::linkage::{ArmPose, RodPose};
use rig_plant::state::{StateReader, StateWriter};
use rig_plant::{Actuation, Channel, Linkage, Measurement};

/// Controller of all five axes.
#[derive(Debug, Clone)]
pub struct RigController {
    linkage: Linkage,
    measurement_delay_s: f64,
    lead_s: f64,
    period_s: f64,
    has_actuator: bool,
    switches: Switches,
    force: [ForceLoop; 2],
    height: [HeightLoop; 2],
    steer: SteerLoop,
    hub: HubObserver,
    rack: RackObserver,
    energy: EnergyAccount,
    delay: [DelayEstimate; 2],
    readings: [f64; Channel::COUNT],
    held: RigCommand,
    hold: Hold,
}

/// Where axes stood when their fade was last 0.
#[derive(Debug, Clone, Copy, Default)]
struct Hold {
    started: bool,
    height_m: [f64; 2],
    steer_rad: f64,
    vertical: f64,
    steer: f64,
}

impl RigController {
    /// A controller at rest whose actuation acts in the middle of a tick.
    ///
    /// # Errors
    /// As [`Self::with_phase`].
    pub fn new(rig: &Rig, unit: &SteeringUnit, period_s: f64) -> Result<Self, Vec<Broken>> {
        Self::with_phase(rig, unit, period_s, 0.5 * period_s)
    }

    /// A controller at rest. `output_phase_s`: from the start of a tick to when its actuation leaves.
    ///
    /// # Errors
    /// Every broken rule of rig and unit, and of `period_s` (0.1 ms to 10 ms).
    pub fn with_phase(
        rig: &Rig,
        unit: &SteeringUnit,
        period_s: f64,
        output_phase_s: f64,
    ) -> Result<Self, Vec<Broken>> {
        check_rig(rig, unit, period_s)?;
        // What the loops see as delay: transport, output phase, and half a period where commands are interpolated.
        let mut control = rig.control.clone();
        control.command_delay_s += output_phase_s;
        if rig.plant.interpolate_commands {
            control.command_delay_s += 0.5 * period_s;
        }
        let c = &control;
        let force = ForceLoop::new(c, period_s);
        let steer = &rig.plant.steer;
        Ok(Self {
            linkage: Linkage::new(&rig.geometry),
            measurement_delay_s: c.measurement_delay_s,
            lead_s: force.lead_s(),
            period_s,
            has_actuator: steer.device == SteerDevice::Actuator,
            switches: c.switches,
            force: [force.clone(), force],
            height: [HeightLoop::new(c, period_s), HeightLoop::new(c, period_s)],
            steer: SteerLoop::new(c, steer.inertia_kg_m2, rig.limits.command_steer_torque_n_m, period_s),
            hub: HubObserver::new(
                (steer.device == SteerDevice::Actuator).then_some(steer.inertia_kg_m2),
                c.command_delay_s + c.steer.torque_lag_s + c.measurement_delay_s,
                period_s,
            ),
            rack: RackObserver::new(unit, c, period_s),
            energy: EnergyAccount::new(period_s),
            delay: [DelayEstimate::new(period_s), DelayEstimate::new(period_s)],
            readings: [0.0; Channel::COUNT],
            held: RigCommand::default(),
            hold: Hold::default(),
        })
    }

    /// Compensations in force.
    pub fn switches(&self) -> Switches {
        self.switches
    }

    /// Switches compensations from the next tick on.
    pub fn set_switches(&mut self, switches: Switches) {
        self.switches = switches;
    }

    /// Takes over the tuning of all loops from the next tick on: gains and rates. What sizes delays and
    /// observers (delays, axis models, command tracker, rack observer) stays as it was built.
    pub fn tune(&mut self, control: &Control) {
        for side in 0..2 {
            self.force[side].tune(control);
            self.height[side].tune(control);
        }
        self.steer.tune(control);
        self.rack.tune(control);
    }

    /// One tick.
    pub fn step(
        &mut self,
        command: &RigCommand,
        measurement: &Measurement,
        out: &mut Actuation,
        diag: &mut ControlDiagnostics,
    ) {
        let mut bits = self.take_in(command, measurement);
        let m = Measurement::from_channels(&self.readings, measurement.validity);
        let command = self.held;
        let fade = command.fade;
        let (height, height_rate) = self.faded_heights(&command, &m);
        let steer = self.faded_steer(&command, &m);

        self.hub.step(m.steering_wheel_angle_rad, m.steering_wheel_torque_n_m);
        let poses = self.poses(&m);
        let rods: f64 =
            (0..2).map(|side| [1.0, -1.0][side] * poses[side].1.direction[1] * m.tie_rod_force_n[side]).sum();
        let hub_rate = self.hub.measured().rate_rad_s;
        let (torque, assist) = (m.torsion_bar_torque_n_m, m.assist_torque_n_m);
        self.rack.step(hub_rate, m.rack_displacement_m, torque, assist, rods);
        let rack_ahead = self.rack_velocity_ahead(&command, &steer, rods);

        let mut error_on_rack = 0.0;
        for side in 0..2 {
            let sign = [1.0, -1.0][side];
            let (arm, rod) = poses[side];

            let active = true;
            out.vertical_valve[side] = self.height[side].step(
                height[side],
                height_rate[side],
                m.vertical_stroke_m[side],
                active,
                &self.switches,
            );

            let lead = if self.switches.delay_compensation { self.lead_s } else { 0.0 };
            let lift_rate = self.height[side].velocity_ahead_m_s(lead);
            let reach = rod.direction[1] * sign;
            let input = ForceInput {
                command_n: command.tie_rod_force_n[side] * fade.force,
                tie_rod_n: m.tie_rod_force_n[side],
                actuator_n: m.actuator_force_n[side],
                stroke_m: m.horizontal_stroke_m[side],
                elongation_per_stroke: self.linkage.elongation_per_stroke(&arm, &rod),
                per_tip: rod.per_tip,
                outer_motion_m_s: rod.direction[2] * lift_rate - reach * rack_ahead,
                active,
            };
            out.horizontal_valve[side] = self.force[side].step(&input, &self.switches);

            let force = &self.force[side];
            let error = input.command_n - input.tie_rod_n;
            self.delay[side].step(error, force.command_rate_n_s());
            error_on_rack += reach * (input.tie_rod_n - force.command_when_measured_n());
            diag.force_error_n[side] = error;
            diag.force_feedback_n[side] = force.feedback_n();
            diag.height_error_m[side] = height[side] - m.vertical_stroke_m[side];
            diag.disturbance_m_s[side] = force.disturbance_m_s();
            diag.loop_delay_s[side] = self.delay[side].delay_s;
            let known = u64::from(self.delay[side].known()) << side;
            diag.loop_delay_known = (diag.loop_delay_known & !(1 << side)) | known;
            let saturated = |on: bool, bit: u64| if on { bit << side } else { 0 };
            bits |= saturated(force.saturated, flags::HORIZONTAL_SATURATED);
            bits |= saturated(self.height[side].saturated, flags::VERTICAL_SATURATED);
            if force.rate_limited || self.height[side].rate_limited {
                bits |= flags::RATE_LIMITED;
            }
        }

        out.steer_torque_n_m = if self.has_actuator {
            let cell = m.steering_wheel_torque_n_m;
            self.steer.step(&steer, fade.steer, &self.hub, cell, &self.switches)
        } else {
            0.0
        };
        self.hub.sent(out.steer_torque_n_m);
        if self.steer.saturated {
            bits |= flags::STEER_SATURATED;
        }

        self.energy.step(error_on_rack, self.rack.velocity_m_s());
        diag.rack_velocity_m_s = self.rack.velocity_m_s();
        diag.rack_velocity_ahead_m_s = rack_ahead;
        diag.energy_cycle_j = self.energy.cycle_j;
        diag.energy_second_j = self.energy.second_j;
        diag.energy_total_j = self.energy.total_j;
        diag.flags = bits;
    }

    /// Replaces what is not finite by its last good value.
    fn take_in(&mut self, command: &RigCommand, measurement: &Measurement) -> u64 {
        let mut bits = 0;
        for (last, new) in self.readings.iter_mut().zip(measurement.channels()) {
            if new.is_finite() {
                *last = new;
            } else {
                bits |= flags::MEASUREMENT_HELD;
            }
        }
        let mut keep = |last: &mut f64, new: f64| {
            if new.is_finite() {
                *last = new;
            } else {
                bits |= flags::COMMAND_HELD;
            }
        };
        let h = &mut self.held;
        for side in 0..2 {
            keep(&mut h.tie_rod_force_n[side], command.tie_rod_force_n[side]);
            keep(&mut h.ball_height_m[side], command.ball_height_m[side]);
            keep(&mut h.ball_height_velocity_m_s[side], command.ball_height_velocity_m_s[side]);
        }
        keep(&mut h.fade.force, command.fade.force);
        keep(&mut h.fade.vertical, command.fade.vertical);
        keep(&mut h.fade.steer, command.fade.steer);
        let finite = match command.steer {
            SteerCommand::Free => true,
            SteerCommand::Angle { angle_rad, rate_rad_s } => angle_rad.is_finite() && rate_rad_s.is_finite(),
            SteerCommand::Torque { torque_n_m } => torque_n_m.is_finite(),
        };
        if finite {
            h.steer = command.steer;
        } else {
            bits |= flags::COMMAND_HELD;
        }
        let unit = |gain: f64| gain.clamp(0.0, 1.0);
        h.fade =
            Fade { force: unit(h.fade.force), vertical: unit(h.fade.vertical), steer: unit(h.fade.steer) };
        bits
    }

    /// Heights between where the axes were frozen and the command, and their rates.
    fn faded_heights(&mut self, command: &RigCommand, m: &Measurement) -> ([f64; 2], [f64; 2]) {
        let gain = command.fade.vertical;
        let gain_rate = if self.hold.started { (gain - self.hold.vertical) / self.period_s } else { 0.0 };
        let mut height = [0.0; 2];
        let mut rate = [0.0; 2];
        for side in 0..2 {
            if !self.hold.started {
                self.hold.height_m[side] = m.vertical_stroke_m[side];
            } else if gain == 0.0 && self.hold.vertical > 0.0 {
                // Frozen at what was last asked for: the axis stops without a step.
                let held = self.hold.height_m[side];
                self.hold.height_m[side] = held + self.hold.vertical * (command.ball_height_m[side] - held);
            }
            let away = command.ball_height_m[side] - self.hold.height_m[side];
            height[side] = self.hold.height_m[side] + gain * away;
            let fading = if gain > 0.0 { gain_rate * away } else { 0.0 };
            rate[side] = gain * command.ball_height_velocity_m_s[side] + fading;
        }
        self.hold.vertical = gain;
        (height, rate)
    }

    /// Steering angle between where the wheel stood when torque came on and the command.
    fn faded_steer(&mut self, command: &RigCommand, m: &Measurement) -> SteerCommand {
        let gain = command.fade.steer;
        let gain_rate = if self.hold.started { (gain - self.hold.steer) / self.period_s } else { 0.0 };
        if gain == 0.0 || !self.hold.started {
            self.hold.steer_rad = m.steering_wheel_angle_rad;
        }
        self.hold.steer = gain;
        self.hold.started = true;
        match command.steer {
            SteerCommand::Angle { angle_rad, rate_rad_s } => {
                let away = angle_rad - self.hold.steer_rad;
                let fading = if gain > 0.0 { gain_rate * away } else { 0.0 };
                SteerCommand::Angle {
                    angle_rad: self.hold.steer_rad + gain * away,
                    rate_rad_s: gain * rate_rad_s + fading,
                }
            }
            other => other,
        }
    }

    /// Arms and rods as measured, or at rest without force conversion.
    fn poses(&self, m: &Measurement) -> [(ArmPose, RodPose); 2] {
        core::array::from_fn(|side| {
            let (stroke, lift, rack) = if self.switches.force_conversion {
                (m.horizontal_stroke_m[side], m.vertical_stroke_m[side], self.rack.displacement_m())
            } else {
                (0.0, 0.0, 0.0)
            };
            let arm = self.linkage.arm_at_stroke(stroke);
            let rod = self.linkage.rod(&arm, lift, [1.0, -1.0][side] * rack);
            (arm, rod)
        })
    }

    fn rack_velocity_ahead(&self, command: &RigCommand, steer: &SteerCommand, rods_n: f64) -> f64 {
        if !self.switches.rack_feed_forward {
            return 0.0;
        }
        if !self.switches.delay_compensation {
            return self.rack.velocity_m_s();
        }
        let reference = match *steer {
            SteerCommand::Angle { angle_rad, rate_rad_s }
                if self.has_actuator && command.fade.steer >= 1.0 =>
            {
                let now = HubState { angle_rad, rate_rad_s };
                let then = HubState { angle_rad: angle_rad + self.lead_s * rate_rad_s, rate_rad_s };
                Some(SteerReference { now, then })
            }
            _ => None,
        };
        let horizon = self.lead_s + self.measurement_delay_s;
        self.rack.velocity_ahead_m_s(&self.hub, reference.as_ref(), rods_n, horizon)
    }

    /// Length of the flat state.
    pub fn state_len(&self) -> usize {
        let loops: usize = self
            .force
            .iter()
            .map(ForceLoop::state_len)
            .chain(self.height.iter().map(HeightLoop::state_len))
            .sum();
        loops
            + SteerLoop::STATE
            + self.hub.state_len()
            + RackObserver::STATE
            + EnergyAccount::STATE
            + 2 * DelayEstimate::STATE
            + Channel::COUNT
            + 7
            + 9
            + 3
            + 6
    }

    /// Writes the complete state into the front of `out`.
    pub fn save_state(&self, out: &mut [f64]) {
        let mut w = StateWriter::new(out);
        for side in 0..2 {
            self.force[side].save(&mut w);
            self.height[side].save(&mut w);
            self.delay[side].save(&mut w);
        }
        self.steer.save(&mut w);
        self.hub.save(&mut w);
        self.rack.save(&mut w);
        self.energy.save(&mut w);
        w.put_all(&self.readings);
        let s = &self.switches;
        for on in [
            s.force_conversion,
            s.rack_feed_forward,
            s.inertia_feed_forward,
            s.delay_compensation,
            s.force_rate_feed_forward,
            s.pressure_compensation,
            s.gain_adaptation,
        ] {
            w.put(f64::from(u8::from(on)));
        }
        let h = &self.held;
        w.put_all(&h.tie_rod_force_n);
        w.put_all(&h.ball_height_m);
        w.put_all(&h.ball_height_velocity_m_s);
        w.put_all(&[h.fade.force, h.fade.vertical, h.fade.steer]);
        let steer = match h.steer {
            SteerCommand::Free => [0.0, 0.0, 0.0],
            SteerCommand::Angle { angle_rad, rate_rad_s } => [1.0, angle_rad, rate_rad_s],
            SteerCommand::Torque { torque_n_m } => [2.0, torque_n_m, 0.0],
        };
        w.put_all(&steer);
        let k = &self.hold;
        w.put(f64::from(u8::from(k.started)));
        w.put_all(&k.height_m);
        w.put_all(&[k.steer_rad, k.vertical, k.steer]);
        debug_assert_eq!(w.written(), self.state_len());
    }

    /// Takes over a state written by a controller of the same configuration; the continuation is bit-exact.
    pub fn load_state(&mut self, from: &[f64]) {
        let mut r = StateReader::new(from);
        for side in 0..2 {
            self.force[side].load(&mut r);
            self.height[side].load(&mut r);
            self.delay[side].load(&mut r);
        }
        self.steer.load(&mut r);
        self.hub.load(&mut r);
        self.rack.load(&mut r);
        self.energy.load(&mut r);
        r.take_all(&mut self.readings);
        let on: [f64; 7] = r.take_array();
        self.switches = Switches {
            force_conversion: on[0] != 0.0,
            rack_feed_forward: on[1] != 0.0,
            inertia_feed_forward: on[2] != 0.0,
            delay_compensation: on[3] != 0.0,
            force_rate_feed_forward: on[4] != 0.0,
            pressure_compensation: on[5] != 0.0,
            gain_adaptation: on[6] != 0.0,
        };
        let h = &mut self.held;
        r.take_all(&mut h.tie_rod_force_n);
        r.take_all(&mut h.ball_height_m);
        r.take_all(&mut h.ball_height_velocity_m_s);
        [h.fade.force, h.fade.vertical, h.fade.steer] = r.take_array();
        let [mode, a, b] = r.take_array();
        h.steer = match mode as u8 {
            1 => SteerCommand::Angle { angle_rad: a, rate_rad_s: b },
            2 => SteerCommand::Torque { torque_n_m: a },
            _ => SteerCommand::Free,
        };
        let k = &mut self.hold;
        k.started = r.take() != 0.0;
        r.take_all(&mut k.height_m);
        [k.steer_rad, k.vertical, k.steer] = r.take_array();
    }
}

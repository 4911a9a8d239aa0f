//! The bench's state machine and its one step.
//!
//! Order of a step: judge inputs → first broken rule trips → staleness → operator's request → fades → clamp.
//! A trip acts in the step that sees its cause: that step's output already is the first command of the ramp.
//! Safe state: vertical axes frozen, axial force ramped to zero, steer torque off.

use crate::clamp;
use crate::ecu::EcuGate;
use crate::input::{OperatorRequest, SafetyInput, SafetyOutput};
use crate::state::BenchState;
use crate::trip::{Trip, TripCode};
use crate::watch::{Finding, Watch};
use config::Broken;
use config::rig::{Limits, Rig, check_rig};
use config::unit::SteeringUnit;
use rig_control::{Fade, RigCommand, SteerCommand};
use rig_plant::Actuation;
use rig_plant::state::{StateReader, StateWriter};

/// Safety monitor of one bench.
#[derive(Debug, Clone)]
pub struct Safety {
    limits: Limits,
    period_s: f64,
    virtual_rig: bool,
    watch: Watch,
    ecu: EcuGate,
    state: BenchState,
    trip: Option<Trip>,
    fade: Fade,
    ticks_in_state: u64,
    fresh_ticks: u32,
    ticks_since_fresh: u32,
    /// Last command as the simulation gave it (finite parts).
    raw: RigCommand,
    /// Last command that was let through, before fades.
    passed: RigCommand,
}

impl Safety {
    /// A bench that is off.
    ///
    /// # Errors
    /// Every broken rule of rig and unit.
    pub fn new(
        rig: &Rig,
        unit: &SteeringUnit,
        period_s: f64,
        virtual_rig: bool,
    ) -> Result<Self, Vec<Broken>> {
        check_rig(rig, unit, period_s)?;
        Ok(Self {
            limits: rig.limits.clone(),
            period_s,
            virtual_rig,
            watch: Watch::new(rig, unit, period_s),
            ecu: EcuGate::default(),
            state: BenchState::Off,
            trip: None,
            fade: Fade::OFF,
            ticks_in_state: 0,
            fresh_ticks: 0,
            ticks_since_fresh: 0,
            raw: RigCommand::default(),
            passed: RigCommand::default(),
        })
    }

    /// State of the bench.
    pub fn state(&self) -> BenchState {
        self.state
    }

    /// The latched trip.
    pub fn trip(&self) -> Option<Trip> {
        self.trip
    }

    /// One tick.
    pub fn step(&mut self, i: &SafetyInput) -> SafetyOutput {
        let before = self.state;
        let stale = i.inputs_stale_ticks >= self.limits.stale_ticks;
        let fresh = i.inputs_stale_ticks == 0;
        self.fresh_ticks = if fresh { self.fresh_ticks.saturating_add(1) } else { 0 };

        let mut bits = 0;
        let new = clamp::finite(&i.command, &self.raw, &mut bits);
        // A command that is not finite is no command: it counts as stale from the first such tick on.
        let broken_command = bits != 0 && fresh;

        let (finding, sensor_faults) = self.watch.step(&i.measurement);
        let (ecu, ecu_bits) = match &i.ecu {
            Some(word) => {
                self.ecu.step(word, i.measurement.torsion_bar_torque_n_m, &self.limits, self.period_s)
            }
            None => (None, 0),
        };
        let cause = self.cause(i, finding, ecu, &new, fresh);
        let unsafe_now = cause.is_some() || ecu.is_some() || i.emergency_stop || i.interlock_open;
        if let Some((code, channel, limit, value)) = cause
            && !matches!(self.state, BenchState::Off | BenchState::Tripped)
        {
            self.enter_trip(Trip { code, channel, limit, value, tick: i.tick });
        }
        self.judge_staleness(i, stale || broken_command);
        let request_refused = !self.serve(i.request, unsafe_now, fresh && !broken_command);

        self.ticks_in_state = if self.state == before { self.ticks_in_state.saturating_add(1) } else { 0 };
        self.advance_fades();
        let clamped = bits | ecu_bits | self.pass(&new, fresh && !broken_command, before);
        if fresh {
            self.raw = new;
            self.ticks_since_fresh = 0;
        } else {
            self.ticks_since_fresh = self.ticks_since_fresh.saturating_add(1);
        }

        let mut command = self.passed;
        command.fade = self.fade;
        if self.fade.steer == 0.0 {
            command.steer = SteerCommand::Free;
        }
        SafetyOutput {
            state: self.state,
            trip: self.trip,
            tripped_now: self.state == BenchState::Tripped && before != BenchState::Tripped,
            fade: self.fade,
            command,
            assist_request_n_m: i.ecu.map(|_| self.fade.force * self.ecu.request_n_m()),
            clamped,
            request_refused,
            sensor_faults,
        }
    }

    /// The last gate: no actuation leaves without it.
    pub fn clamp_actuation(&self, out: &mut Actuation) -> u64 {
        clamp::actuation(out, &self.limits, self.fade.steer > 0.0)
    }

    /// The first reason to trip, if any.
    fn cause(
        &self,
        i: &SafetyInput,
        finding: Option<Finding>,
        ecu: Option<Finding>,
        new: &RigCommand,
        fresh: bool,
    ) -> Option<Finding> {
        let l = &self.limits;
        if i.emergency_stop {
            return Some((TripCode::EmergencyStop, 0, 0.0, 1.0));
        }
        if i.interlock_open {
            return Some((TripCode::InterlockOpen, 0, 0.0, 1.0));
        }
        if i.missed_ticks > l.stall_ticks {
            return Some((TripCode::RigStall, 0, f64::from(l.stall_ticks), f64::from(i.missed_ticks)));
        }
        if finding.is_some() {
            return finding;
        }
        // An ECU that is not there yet keeps the bench from starting; it trips only what runs.
        if !self.state.follows_commands() {
            return None;
        }
        if ecu.is_some() {
            return ecu;
        }
        for (code, limit, value) in [
            (TripCode::EnergyPerCycle, l.energy_per_cycle_j, i.energy_cycle_j),
            (TripCode::EnergyPerSecond, l.energy_per_second_j, i.energy_second_j),
        ] {
            let within = value <= limit;
            if !within {
                return Some((code, 0, limit, value));
            }
        }
        // A step counts from one fresh command to the next; holding breaks the sequence.
        let sequence =
            matches!(self.state, BenchState::Starting | BenchState::Running | BenchState::Resuming);
        if sequence && fresh && self.ticks_since_fresh < l.stale_ticks && self.ticks_in_state > 0 {
            let gap = f64::from(self.ticks_since_fresh + 1);
            for side in 0..2 {
                let step = (new.tie_rod_force_n[side] - self.raw.tie_rod_force_n[side]) / gap;
                if step.abs() > l.command_force_step_n {
                    return Some((TripCode::CommandForceStep, side as u8, l.command_force_step_n, step));
                }
                let step = (new.ball_height_m[side] - self.raw.ball_height_m[side]) / gap;
                if step.abs() > l.command_height_step_m {
                    return Some((TripCode::CommandHeightStep, side as u8, l.command_height_step_m, step));
                }
            }
        }
        None
    }

    fn enter_trip(&mut self, trip: Trip) {
        self.state = BenchState::Tripped;
        self.trip = Some(trip);
    }

    fn judge_staleness(&mut self, i: &SafetyInput, stale: bool) {
        let following =
            matches!(self.state, BenchState::Starting | BenchState::Running | BenchState::Resuming);
        if following && stale {
            if self.virtual_rig {
                self.state = BenchState::Holding;
                self.fresh_ticks = 0;
            } else {
                self.enter_trip(Trip {
                    code: TripCode::StaleInputs,
                    channel: 0,
                    limit: f64::from(self.limits.stale_ticks),
                    value: f64::from(i.inputs_stale_ticks),
                    tick: i.tick,
                });
            }
            return;
        }
        match self.state {
            BenchState::Starting if self.fade.force >= 1.0 => self.state = BenchState::Running,
            BenchState::Resuming if self.fade.force >= 1.0 && self.fade.vertical >= 1.0 => {
                self.state = BenchState::Running;
            }
            BenchState::Stopping if self.fade == Fade::OFF => self.state = BenchState::Idle,
            BenchState::Holding if stale => {
                self.fresh_ticks = 0;
                self.judge_holding_time(i);
            }
            BenchState::Holding if self.fresh_ticks >= self.limits.resume_fresh_ticks => {
                self.state = BenchState::Resuming;
            }
            BenchState::Holding => self.judge_holding_time(i),
            _ => {}
        }
    }

    fn judge_holding_time(&mut self, i: &SafetyInput) {
        let held_s = (self.ticks_in_state + 1) as f64 * self.period_s;
        if held_s > self.limits.holding_max_s {
            self.enter_trip(Trip {
                code: TripCode::HoldingTooLong,
                channel: 0,
                limit: self.limits.holding_max_s,
                value: held_s,
                tick: i.tick,
            });
        }
    }

    /// Serves the operator's request; false if the state does not allow it.
    fn serve(&mut self, request: OperatorRequest, unsafe_now: bool, fresh: bool) -> bool {
        use BenchState as S;
        use OperatorRequest as R;
        let next = match (request, self.state) {
            (R::None, _) => return true,
            (R::SwitchOn, S::Off) => S::Idle,
            (R::Arm, S::Idle) if !unsafe_now => S::Armed,
            (R::Start, S::Armed) if fresh && !unsafe_now => S::Starting,
            (R::Stop, S::Armed) => S::Idle,
            (R::Stop, S::Starting | S::Running | S::Holding | S::Resuming) => S::Stopping,
            (R::Acknowledge, S::Tripped) if !unsafe_now && self.fade == Fade::OFF => {
                self.trip = None;
                S::Idle
            }
            (R::SwitchOff, S::Idle) => S::Off,
            _ => return false,
        };
        self.state = next;
        true
    }

    fn advance_fades(&mut self) {
        let l = &self.limits;
        let toward = |gain: f64, goal: f64, time_s: f64| {
            let step = self.period_s / time_s;
            // Sums of steps must end exactly: a last sliver is no command.
            let next = gain + (goal - gain).clamp(-step, step);
            if (next - goal).abs() < 1e-9 { goal } else { next }
        };
        let f = self.fade;
        let all = |goal: f64, time_s: f64| Fade {
            force: toward(f.force, goal, time_s),
            vertical: toward(f.vertical, goal, time_s),
            steer: toward(f.steer, goal, time_s),
        };
        self.fade = match self.state {
            BenchState::Off | BenchState::Idle | BenchState::Armed => Fade::OFF,
            BenchState::Starting => all(1.0, l.start_fade_s),
            BenchState::Running => Fade::FULL,
            BenchState::Resuming => all(1.0, l.resume_fade_s),
            BenchState::Stopping => all(0.0, l.stop_fade_s),
            BenchState::Holding | BenchState::Tripped => {
                Fade { force: toward(f.force, 0.0, l.safe_ramp_s), vertical: 0.0, steer: 0.0 }
            }
        };
    }

    /// Moves the passed command towards the new one within limits, or freezes it.
    fn pass(&mut self, new: &RigCommand, usable: bool, before: BenchState) -> u64 {
        match self.state {
            BenchState::Starting | BenchState::Running | BenchState::Resuming | BenchState::Stopping
                if usable =>
            {
                // Where nothing acted in the tick before, the command may stand anywhere.
                let entered =
                    self.state != before && matches!(self.state, BenchState::Starting | BenchState::Resuming);
                let mut command = *new;
                let last = self.passed;
                let mut bits = clamp::command(&mut command, &last, &self.limits, self.period_s, !entered);
                if entered && before == BenchState::Holding {
                    // The force's ramp may not have ended: it moves at its rate.
                    let step = self.limits.command_force_rate_n_s * self.period_s;
                    for side in 0..2 {
                        let from = last.tie_rod_force_n[side];
                        let to = command.tie_rod_force_n[side];
                        if (to - from).abs() > step {
                            command.tie_rod_force_n[side] = from + (to - from).clamp(-step, step);
                            bits |= clamp::flags::FORCE_RATE << side;
                        }
                    }
                }
                self.passed = command;
                bits
            }
            BenchState::Off | BenchState::Idle | BenchState::Armed => {
                self.passed = RigCommand::default();
                0
            }
            _ => {
                // Frozen: last values, no velocities.
                self.passed.ball_height_velocity_m_s = [0.0; 2];
                if let SteerCommand::Angle { rate_rad_s, .. } = &mut self.passed.steer {
                    *rate_rad_s = 0.0;
                }
                0
            }
        }
    }

    /// Length of the flat state.
    pub fn state_len(&self) -> usize {
        self.watch.state_len() + EcuGate::STATE + 1 + 6 + 3 + 2 + 1 + 1 + 2 * COMMAND
    }

    /// Writes the complete state into the front of `out`.
    pub fn save_state(&self, out: &mut [f64]) {
        let mut w = StateWriter::new(out);
        self.watch.save(&mut w);
        self.ecu.save(&mut w);
        w.put(f64::from(self.state as u8));
        match self.trip {
            Some(t) => {
                w.put_all(&[f64::from(t.code as u8), f64::from(t.channel), t.limit, t.value]);
                w.put_u64(t.tick);
            }
            None => w.put_all(&[0.0; 6]),
        }
        w.put_all(&[self.fade.force, self.fade.vertical, self.fade.steer]);
        w.put_u64(self.ticks_in_state);
        w.put(f64::from(self.fresh_ticks));
        w.put(f64::from(self.ticks_since_fresh));
        put_command(&mut w, &self.raw);
        put_command(&mut w, &self.passed);
        debug_assert_eq!(w.written(), self.state_len());
    }

    /// Takes over a state written by a monitor of the same configuration. An unknown state number is off.
    pub fn load_state(&mut self, from: &[f64]) {
        let mut r = StateReader::new(from);
        self.watch.load(&mut r);
        self.ecu.load(&mut r);
        self.state = BenchState::from_number(r.take() as u8).unwrap_or_default();
        let [code, channel, limit, value] = r.take_array();
        let tick = r.take_u64();
        self.trip = TripCode::from_number(code as u8).map(|code| Trip {
            code,
            channel: channel as u8,
            limit,
            value,
            tick,
        });
        [self.fade.force, self.fade.vertical, self.fade.steer] = r.take_array();
        self.ticks_in_state = r.take_u64();
        self.fresh_ticks = r.take() as u32;
        self.ticks_since_fresh = r.take() as u32;
        self.raw = take_command(&mut r);
        self.passed = take_command(&mut r);
    }
}

const COMMAND: usize = 9;

fn put_command(w: &mut StateWriter, c: &RigCommand) {
    w.put_all(&c.tie_rod_force_n);
    w.put_all(&c.ball_height_m);
    w.put_all(&c.ball_height_velocity_m_s);
    w.put_all(&match c.steer {
        SteerCommand::Free => [0.0, 0.0, 0.0],
        SteerCommand::Angle { angle_rad, rate_rad_s } => [1.0, angle_rad, rate_rad_s],
        SteerCommand::Torque { torque_n_m } => [2.0, torque_n_m, 0.0],
    });
}

fn take_command(r: &mut StateReader) -> RigCommand {
    let tie_rod_force_n = r.take_array();
    let ball_height_m = r.take_array();
    let ball_height_velocity_m_s = r.take_array();
    let [mode, a, b] = r.take_array();
    let steer = match mode as u8 {
        1 => SteerCommand::Angle { angle_rad: a, rate_rad_s: b },
        2 => SteerCommand::Torque { torque_n_m: a },
        _ => SteerCommand::Free,
    };
    RigCommand { tie_rod_force_n, ball_height_m, ball_height_velocity_m_s, steer, fade: Fade::OFF }
}

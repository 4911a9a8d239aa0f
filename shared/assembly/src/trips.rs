//! Every trip of the safety monitor, provoked on the virtual rig while it runs.
//!
//! Plant, sensors, safety, controller and the last gate in the order and with the timing of the rig node. For each
//! code the bench starts, follows swinging forces, heights and steering, and then meets the cause: a reading, a
//! command, an input or the ECU's word that breaks exactly that rule. A disturbed reading is disturbed for safety alone,
//! so that the controller's answer to it does not break another rule first. Counted is from the first tick in which the
//! rule's condition stands to the tick whose output is the first command of the safe state.

use crate::AssemblyError;
use config::rig::Rig;
use config::unit::SteeringUnit;
use rig_control::{ControlDiagnostics, Fade, RigCommand, RigController, SteerCommand};
use rig_plant::{Actuation, Channel, Measurement, RigEnvironment, Truth, VirtualRig};
use safety::{BenchState, EcuWord, OperatorRequest, Safety, SafetyInput, SafetyOutput, Trip, TripCode};

/// Rig, safety and controller in one thread, tick by tick, with a hand on what safety sees.
pub struct RigLoop {
    plant: VirtualRig,
    safety: Safety,
    controller: RigController,
    period_s: f64,
    first_s: f64,
    tick: u64,
    actuation: Actuation,
    diagnostics: ControlDiagnostics,
}

/// What one tick did.
#[derive(Debug, Clone, Copy)]
pub struct Done {
    /// Safety's verdict.
    pub verdict: SafetyOutput,
    /// What reached the plant.
    pub actuation: Actuation,
    /// The machine behind the tick.
    pub truth: Truth,
}

fn faults(part: &'static str) -> impl Fn(Vec<config::Broken>) -> AssemblyError {
    move |broken| AssemblyError::new(part, broken.into_iter().map(|b| format!("{}: {}", b.key, b.rule)))
}

impl RigLoop {
    /// A rig that is off. `virtual_rig` false: stale inputs trip, as on hardware.
    ///
    /// # Errors
    /// Every broken rule of rig and unit.
    pub fn new(
        rig: &Rig,
        unit: &SteeringUnit,
        seed: u64,
        period_s: f64,
        virtual_rig: bool,
    ) -> Result<Self, AssemblyError> {
        let first_s = 0.5 * period_s;
        Ok(Self {
            plant: VirtualRig::new(rig, unit, seed, period_s).map_err(faults("rig"))?,
            safety: Safety::new(rig, unit, period_s, virtual_rig).map_err(faults("rig"))?,
            controller: RigController::with_phase(rig, unit, period_s, first_s).map_err(faults("rig"))?,
            period_s,
            first_s,
            tick: 0,
            actuation: Actuation::default(),
            diagnostics: ControlDiagnostics::default(),
        })
    }

    /// One tick; `meddle` may change what safety sees.
    pub fn step(
        &mut self,
        command: &RigCommand,
        request: OperatorRequest,
        meddle: impl FnOnce(&mut SafetyInput),
    ) -> Done {
        let mut measurement = Measurement::default();
        self.plant.sample(&mut measurement);
        let mut input = SafetyInput {
            tick: self.tick,
            request,
            emergency_stop: false,
            interlock_open: false,
            inputs_stale_ticks: 0,
            missed_ticks: 0,
            measurement,
            command: *command,
            energy_cycle_j: self.diagnostics.energy_cycle_j,
            energy_second_j: self.diagnostics.energy_second_j,
            ecu: None,
        };
        meddle(&mut input);
        let verdict = self.safety.step(&input);
        self.tick += 1;
        let environment = RigEnvironment {
            vehicle_speed_m_s: 20.0,
            assist_request_n_m: verdict.assist_request_n_m,
            ..RigEnvironment::default()
        };
        self.plant.set_environment(&environment);
        self.plant.advance(self.first_s);
        self.controller.step(&verdict.command, &measurement, &mut self.actuation, &mut self.diagnostics);
        self.safety.clamp_actuation(&mut self.actuation);
        self.plant.set_actuation(&self.actuation);
        self.plant.advance(self.period_s - self.first_s);
        Done { verdict, actuation: self.actuation, truth: *self.plant.truth() }
    }

    /// Switches on, arms, starts and waits for the soft start's end.
    ///
    /// # Errors
    /// A bench that trips or does not start.
    pub fn start(&mut self, mut meddle: impl FnMut(&mut SafetyInput)) -> Result<(), AssemblyError> {
        let requests = [OperatorRequest::SwitchOn, OperatorRequest::Arm, OperatorRequest::Start];
        for n in 0..(5.0 / self.period_s) as usize {
            let request = requests.get(n).copied().unwrap_or_default();
            let done = self.step(&swing(self.tick as f64 * self.period_s), request, &mut meddle);
            match (done.verdict.state, done.verdict.trip) {
                (BenchState::Running, _) => return Ok(()),
                (_, Some(trip)) => {
                    let (name, _) = trip.code.describe();
                    return Err(AssemblyError::new("trips", [format!("tripped while starting: {name}")]));
                }
                _ => {}
            }
        }
        Err(AssemblyError::new("trips", ["the bench did not start"]))
    }
}

/// Forces, heights and steering of an ordinary drive at `t`.
pub fn swing(t: f64) -> RigCommand {
    RigCommand {
        tie_rod_force_n: [600.0 * (3.0 * t).sin(), -500.0 * (3.0 * t).sin()],
        ball_height_m: [0.008 * (4.0 * t).sin(), -0.008 * (4.0 * t).sin()],
        ball_height_velocity_m_s: [0.032 * (4.0 * t).cos(), -0.032 * (4.0 * t).cos()],
        steer: SteerCommand::Angle { angle_rad: 0.4 * (3.0 * t).sin(), rate_rad_s: 1.2 * (3.0 * t).cos() },
        fade: Fade::FULL,
    }
}

/// One trip as it happened.
#[derive(Debug, Clone, Copy)]
pub struct Demonstrated {
    /// Code that was to trip.
    pub wanted: TripCode,
    /// What was done to provoke it.
    pub cause: &'static str,
    /// The trip, if there was one.
    pub trip: Option<Trip>,
    /// Time that the rule itself asks for before it counts as broken. [ticks]
    pub rule_ticks: u64,
    /// From the first tick of the cause to the tripping tick, the cause's own included. [ticks]
    pub ticks: u64,
    /// Fades of the tripping tick's own output: force ramping, vertical frozen, steer off.
    pub fade: Fade,
    /// Steer torque that left in the tripping tick. [N·m]
    pub steer_torque_n_m: f64,
    /// Larger true tie-rod force before, and 0.2 s after the trip. [N]
    pub force_n: [f64; 2],
}

impl Demonstrated {
    /// Ticks beyond those that the rule itself takes: 1 is at once.
    pub fn reaction_ticks(&self) -> u64 {
        self.ticks.saturating_sub(self.rule_ticks)
    }

    /// The right code, within one tick, with the first command of the safe state in that tick.
    pub fn kept(&self) -> bool {
        self.trip.is_some_and(|trip| trip.code == self.wanted)
            && self.reaction_ticks() <= 1
            && self.fade.force < 1.0
            && self.fade.vertical == 0.0
            && self.fade.steer == 0.0
            && self.steer_torque_n_m == 0.0
    }
}

/// How a code is provoked: what is done to safety's input in the tick `k` ticks after the cause began, and the time
/// that the rule takes by itself.
struct Case {
    code: TripCode,
    cause: &'static str,
    rule_s: f64,
    meddle: fn(&mut SafetyInput, u64, &Rig),
}

const fn case(code: TripCode, cause: &'static str, meddle: fn(&mut SafetyInput, u64, &Rig)) -> Case {
    Case { code, cause, rule_s: 0.0, meddle }
}

/// A little beyond a limit.
const BEYOND: f64 = 1.001;

fn cases(rig: &Rig) -> Vec<Case> {
    use TripCode as C;
    let l = &rig.limits;
    let lasting = |code, cause, rule_s, meddle| Case { code, cause, rule_s, meddle };
    vec![
        case(C::EmergencyStop, "emergency stop pressed", |i, _, _| i.emergency_stop = true),
        case(C::InterlockOpen, "interlock chain opened", |i, _, _| i.interlock_open = true),
        case(C::RigStall, "the rig's process missed ticks", |i, k, rig| {
            i.missed_ticks = if k == 0 { rig.limits.stall_ticks + 1 } else { 0 };
        }),
        case(C::TieRodForce, "tie-rod cell beyond its limit", |i, _, rig| {
            let f = BEYOND * rig.limits.tie_rod_force_n;
            (i.measurement.tie_rod_force_n[1], i.measurement.actuator_force_n[1]) = (-f, -f);
        }),
        case(C::ActuatorForce, "cylinder's cell beyond its limit", |i, _, rig| {
            i.measurement.actuator_force_n[0] = BEYOND * rig.limits.actuator_force_n;
        }),
        case(C::HorizontalStroke, "horizontal stroke beyond its limit", |i, _, rig| {
            i.measurement.horizontal_stroke_m[0] = BEYOND * rig.limits.horizontal_stroke_m;
        }),
        case(C::VerticalStroke, "vertical stroke beyond its limit", |i, _, rig| {
            i.measurement.vertical_stroke_m[1] = -BEYOND * rig.limits.vertical_stroke_m;
        }),
        case(C::HorizontalSpeed, "horizontal stroke jumps", |i, _, rig| {
            i.measurement.horizontal_stroke_m[0] +=
                1.5 * rig.limits.horizontal_speed_m_s * rig.limits.speed_window_s;
        }),
        case(C::VerticalSpeed, "vertical stroke jumps", |i, _, rig| {
            i.measurement.vertical_stroke_m[0] +=
                1.5 * rig.limits.vertical_speed_m_s * rig.limits.speed_window_s;
        }),
        case(C::RackDisplacement, "rack beyond its limit", |i, _, rig| {
            i.measurement.rack_displacement_m = BEYOND * rig.limits.rack_displacement_m;
        }),
        case(C::SteerAngle, "steering angle beyond its limit", |i, _, rig| {
            i.measurement.steering_wheel_angle_rad = BEYOND * rig.limits.steer_angle_rad;
        }),
        case(C::SteerRate, "steering angle jumps", |i, _, rig| {
            i.measurement.steering_wheel_angle_rad +=
                1.5 * rig.limits.steer_rate_rad_s * rig.limits.speed_window_s;
        }),
        case(C::SteerTorque, "steering torque beyond its limit", |i, _, rig| {
            i.measurement.steering_wheel_torque_n_m = BEYOND * rig.limits.steer_torque_n_m;
        }),
        case(C::CommandForceStep, "commanded force steps", |i, _, rig| {
            i.command.tie_rod_force_n[0] += BEYOND * rig.limits.command_force_step_n + 50.0;
        }),
        case(C::CommandHeightStep, "commanded height steps", |i, _, rig| {
            i.command.ball_height_m[1] += BEYOND * rig.limits.command_height_step_m + 1e-3;
        }),
        case(C::SensorRange, "a sensor reports itself invalid", |i, _, _| {
            i.measurement.validity &= !(1 << Channel::RackDisplacement as u8);
        }),
        lasting(C::SensorFrozen, "a reading stands still", l.frozen_s + 1e-3, |i, _, _| {
            i.measurement.actuator_force_n[0] = 123.4;
        }),
        lasting(C::ForceCellsDisagree, "an offset on one force cell", l.disagreement_s, |i, _, rig| {
            i.measurement.tie_rod_force_n[0] += 2.0 * rig.limits.force_disagreement_n;
        }),
        lasting(C::RackSensorsDisagree, "an offset on the potentiometer", l.disagreement_s, |i, _, rig| {
            i.measurement.rack_displacement_m += 2.0 * rig.limits.rack_disagreement_m;
        }),
        case(C::EnergyPerCycle, "energy account of a cycle beyond its limit", |i, _, rig| {
            i.energy_cycle_j = BEYOND * rig.limits.energy_per_cycle_j;
        }),
        case(C::EnergyPerSecond, "energy account of a second beyond its limit", |i, _, rig| {
            i.energy_second_j = BEYOND * rig.limits.energy_per_second_j;
        }),
        lasting(C::EcuAbsent, "the ECU on the bus falls silent", l.ecu_absent_max_s, |i, _, _| {
            i.ecu = Some(EcuWord { assist_torque_n_m: f64::NAN, age_ticks: 0 });
        }),
        // The request has to pass its rate limit first.
        lasting(
            C::EcuAgainstDriver,
            "the ECU on the bus pushes against the driver",
            l.disagreement_s + (l.ecu_against_n_m / l.ecu_assist_rate_n_m_s / 1e-3).floor() * 1e-3,
            |i, _, rig| {
                // The driver's torque is held, so that it does not turn within the rule's time.
                i.measurement.torsion_bar_torque_n_m = 2.0 + 1e-4 * (i.tick % 7) as f64;
                i.measurement.validity |= 1 << Channel::TorsionBarTorque as u8;
                let push = -1.1 * rig.limits.ecu_against_n_m;
                i.ecu = Some(EcuWord { assist_torque_n_m: push, age_ticks: 0 });
            },
        ),
        lasting(
            C::HoldingTooLong,
            "no fresh command (virtual rig: holds first)",
            f64::from(l.stale_ticks) * 1e-3 + l.holding_max_s,
            |i, k, _| i.inputs_stale_ticks = k as u32 + 1,
        ),
        lasting(
            C::StaleInputs,
            "no fresh command (hardware: latches)",
            f64::from(l.stale_ticks - 1) * 1e-3,
            |i, k, _| i.inputs_stale_ticks = k as u32 + 1,
        ),
    ]
}

/// Provokes every code of the safety monitor at 1 kHz.
///
/// # Errors
/// A rig or unit that breaks its rules, or a bench that does not start.
pub fn demonstrate(rig: &Rig, unit: &SteeringUnit, seed: u64) -> Result<Vec<Demonstrated>, AssemblyError> {
    const PERIOD_S: f64 = 1e-3;
    let mut list = Vec::new();
    for case in cases(rig) {
        let hardware = case.code == TripCode::StaleInputs;
        let mut bench = RigLoop::new(rig, unit, seed, PERIOD_S, !hardware)?;
        let with_ecu = matches!(case.code, TripCode::EcuAbsent | TripCode::EcuAgainstDriver);
        let healthy = |i: &mut SafetyInput| {
            if with_ecu {
                // Asks for nothing, so that what it asks for next starts from there.
                i.ecu = Some(EcuWord { assist_torque_n_m: 0.0, age_ticks: 1 });
            }
        };
        bench.start(healthy)?;
        let at = |bench: &RigLoop| bench.tick as f64 * PERIOD_S;
        for _ in 0..400 {
            bench.step(&swing(at(&bench)), OperatorRequest::None, healthy);
        }
        let most = |t: &Truth| t.tie_rod_force_n[0].abs().max(t.tie_rod_force_n[1].abs());
        let rule_ticks = (case.rule_s / PERIOD_S).round() as u64;
        let mut entry = Demonstrated {
            wanted: case.code,
            cause: case.cause,
            trip: None,
            rule_ticks,
            ticks: 0,
            fade: Fade::FULL,
            steer_torque_n_m: f64::NAN,
            force_n: [f64::NAN; 2],
        };
        let mut since = None;
        for k in 0..rule_ticks + 300 {
            let before = most(bench.plant.truth());
            let done = bench.step(&swing(at(&bench)), OperatorRequest::None, |i| {
                healthy(i);
                if since.is_none() {
                    (case.meddle)(i, k, rig);
                }
            });
            if done.verdict.tripped_now {
                entry.trip = done.verdict.trip;
                entry.ticks = k + 1;
                entry.fade = done.verdict.fade;
                entry.steer_torque_n_m = done.actuation.steer_torque_n_m;
                entry.force_n[0] = before;
                since = Some(k);
            }
            if since.is_some_and(|from| k == from + 200) {
                entry.force_n[1] = most(&done.truth);
                break;
            }
        }
        list.push(entry);
    }
    Ok(list)
}

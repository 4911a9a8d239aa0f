//! Every trip, with its reaction in ticks; holding and resuming; what never reaches the plant.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout, missing_docs)]

use config::rig::Rig;
use config::unit::SteeringUnit;
use proptest::prelude::*;
use rig_control::{Fade, RigCommand, SteerCommand};
use rig_plant::{Actuation, Channel, Measurement};
use safety::{BenchState, EcuWord, OperatorRequest, Safety, SafetyInput, SafetyOutput, TripCode};

const PERIOD_S: f64 = 1e-3;

fn rig() -> Rig {
    toml::from_str(include_str!("../../../schemas/rigs/virtual.toml")).unwrap()
}

fn unit() -> SteeringUnit {
    toml::from_str(include_str!("../../../schemas/units/column_eps.toml")).unwrap()
}

/// A bench with healthy, slightly noisy sensors, driven tick by tick.
struct Bench {
    safety: Safety,
    input: SafetyInput,
    /// Added to the healthy readings.
    disturb: fn(&mut SafetyInput),
}

impl Bench {
    fn new(virtual_rig: bool) -> Self {
        let input = SafetyInput {
            tick: 0,
            request: OperatorRequest::None,
            emergency_stop: false,
            interlock_open: false,
            inputs_stale_ticks: 0,
            missed_ticks: 0,
            measurement: Measurement { validity: Measurement::ALL_VALID, ..Measurement::default() },
            command: command(1000.0, 0.01),
            energy_cycle_j: 0.0,
            energy_second_j: 0.0,
            ecu: None,
        };
        let safety = Safety::new(&rig(), &unit(), PERIOD_S, virtual_rig).unwrap();
        Self { safety, input, disturb: |_| {} }
    }

    fn tick(&mut self) -> SafetyOutput {
        // Small deterministic noise, so that nothing looks frozen.
        let n = self.input.tick;
        let noise = ((n * 7919 % 101) as f64 - 50.0) / 50.0;
        let m = &mut self.input.measurement;
        *m = Measurement {
            steering_wheel_torque_n_m: 0.003 * noise,
            torsion_bar_torque_n_m: 0.01 * noise,
            rack_displacement_m: 2e-5 * noise,
            tie_rod_force_n: [noise, -noise],
            actuator_force_n: [2.0 * noise, -2.0 * noise],
            horizontal_stroke_m: [5e-6 * noise; 2],
            vertical_stroke_m: [5e-6 * noise; 2],
            validity: Measurement::ALL_VALID,
            ..Measurement::default()
        };
        let mut input = self.input;
        (self.disturb)(&mut input);
        let out = self.safety.step(&input);
        self.input.request = OperatorRequest::None;
        self.input.tick += 1;
        out
    }

    fn request(&mut self, request: OperatorRequest) -> SafetyOutput {
        self.input.request = request;
        self.tick()
    }

    /// Switches on, arms, starts and waits for the soft start.
    fn run(virtual_rig: bool) -> Self {
        let mut bench = Self::new(virtual_rig);
        for request in [OperatorRequest::SwitchOn, OperatorRequest::Arm, OperatorRequest::Start] {
            assert!(!bench.request(request).request_refused);
        }
        for _ in 0..1100 {
            bench.tick();
        }
        assert_eq!(bench.safety.state(), BenchState::Running);
        bench
    }
}

fn command(force_n: f64, height_m: f64) -> RigCommand {
    RigCommand {
        tie_rod_force_n: [force_n, -force_n],
        ball_height_m: [height_m, -height_m],
        ball_height_velocity_m_s: [0.0; 2],
        steer: SteerCommand::Angle { angle_rad: 0.2, rate_rad_s: 0.0 },
        fade: Fade::OFF,
    }
}

/// Disturbs a running bench; it must trip with `code` in exactly `ticks` ticks, and ramp from that tick on.
fn check_trip(code: TripCode, ticks: u32, disturb: fn(&mut SafetyInput)) {
    let mut bench = Bench::run(true);
    bench.disturb = disturb;
    let mut out = bench.tick();
    let mut taken = 1;
    while out.state != BenchState::Tripped && taken < 10_000 {
        out = bench.tick();
        taken += 1;
    }
    let trip = out.trip.unwrap();
    println!("{:?}: {taken} tick(s), limit {}, value {}", trip.code, trip.limit, trip.value);
    assert_eq!(trip.code, code);
    assert_eq!(taken, ticks, "{code:?}");
    assert_eq!(trip.tick, bench.input.tick - 1);
    assert!(out.tripped_now);
    // The output of the tripping tick already is the safe state's first command.
    assert!((out.fade.force - (1.0 - PERIOD_S / 0.1)).abs() < 1e-12, "{}", out.fade.force);
    assert_eq!((out.fade.vertical, out.fade.steer), (0.0, 0.0));
    assert_eq!(out.command.steer, SteerCommand::Free);
    let mut actuation = Actuation { steer_torque_n_m: 5.0, ..Actuation::default() };
    bench.safety.clamp_actuation(&mut actuation);
    assert_eq!(actuation.steer_torque_n_m, 0.0);
    // Force is gone after 100 ms, and the trip stays latched whatever comes.
    for _ in 0..100 {
        out = bench.tick();
    }
    assert_eq!(out.fade, Fade::OFF);
    bench.disturb = |_| {};
    for request in [OperatorRequest::Start, OperatorRequest::Arm, OperatorRequest::Stop] {
        out = bench.request(request);
        assert!(out.request_refused && out.state == BenchState::Tripped);
    }
    assert_eq!(out.trip, Some(trip));
    // A window of old speeds must pass before the cause is gone.
    for _ in 0..20 {
        bench.tick();
    }
    out = bench.request(OperatorRequest::Acknowledge);
    assert_eq!((out.state, out.trip), (BenchState::Idle, None), "{code:?}");
}

#[test]
fn every_code_trips_in_the_stated_ticks() {
    use TripCode as C;
    check_trip(C::EmergencyStop, 1, |i| i.emergency_stop = true);
    check_trip(C::InterlockOpen, 1, |i| i.interlock_open = true);
    check_trip(C::RigStall, 1, |i| i.missed_ticks = 51);
    check_trip(C::TieRodForce, 1, |i| {
        i.measurement.tie_rod_force_n[1] = -9501.0;
        i.measurement.actuator_force_n[1] = -9501.0;
    });
    check_trip(C::ActuatorForce, 1, |i| i.measurement.actuator_force_n[0] = 12_001.0);
    check_trip(C::HorizontalStroke, 1, |i| i.measurement.horizontal_stroke_m[0] = 0.1201);
    check_trip(C::VerticalStroke, 1, |i| i.measurement.vertical_stroke_m[1] = -0.1201);
    check_trip(C::HorizontalSpeed, 1, |i| i.measurement.horizontal_stroke_m[0] = 0.0062);
    check_trip(C::VerticalSpeed, 1, |i| i.measurement.vertical_stroke_m[0] = -0.0062);
    check_trip(C::RackDisplacement, 1, |i| i.measurement.rack_displacement_m = 0.0901);
    check_trip(C::SteerAngle, 1, |i| i.measurement.steering_wheel_angle_rad = 18.96);
    check_trip(C::SteerRate, 1, |i| i.measurement.steering_wheel_angle_rad = 0.25);
    check_trip(C::SteerTorque, 1, |i| i.measurement.steering_wheel_torque_n_m = 29.1);
    check_trip(C::CommandForceStep, 1, |i| i.command = command(3001.0, 0.01));
    check_trip(C::CommandHeightStep, 1, |i| i.command = command(1000.0, 0.021));
    check_trip(C::SensorRange, 1, |i| i.measurement.validity &= !(1 << Channel::RackDisplacement as u8));
    // 0.2 s of exactly one value, the first reading being the one that starts the count.
    check_trip(C::SensorFrozen, 202, |i| i.measurement.rack_displacement_m = 1.1e-5);
    // 50 ms of disagreement.
    check_trip(C::ForceCellsDisagree, 51, |i| i.measurement.tie_rod_force_n[0] += 1600.0);
    check_trip(C::RackSensorsDisagree, 51, |i| i.measurement.rack_displacement_m += 0.011);
    check_trip(C::EnergyPerCycle, 1, |i| i.energy_cycle_j = 20.1);
    check_trip(C::EnergyPerSecond, 1, |i| i.energy_second_j = 40.1);
    // Half a second of silence.
    check_trip(C::EcuAbsent, 501, |i| i.ecu = Some(EcuWord { assist_torque_n_m: f64::NAN, age_ticks: 0 }));
    // Fading in over 200 ms it is beyond 8 N·m in the 54th tick, and 50 ms of it.
    check_trip(C::EcuAgainstDriver, 104, |i| {
        i.measurement.torsion_bar_torque_n_m = 2.0;
        i.ecu = Some(EcuWord { assist_torque_n_m: -30.0, age_ticks: 0 });
    });
    // The third tick without a fresh command holds; two seconds later it trips.
    check_holding_too_long();
    check_stale_on_real_hardware();
}

#[test]
fn the_list_of_tested_codes_is_complete() {
    // 23 above by `check_trip`, and the two of staleness.
    assert_eq!(TripCode::ALL.len(), 25);
    let mut numbers: Vec<u8> = TripCode::ALL.iter().map(|c| *c as u8).collect();
    numbers.dedup();
    assert_eq!(numbers.len(), 25);
}

fn check_holding_too_long() {
    let mut bench = Bench::run(true);
    let mut ticks = 0;
    let trip = loop {
        bench.input.inputs_stale_ticks += 1;
        let out = bench.tick();
        ticks += 1;
        if let Some(trip) = out.trip {
            break trip;
        }
        assert!(ticks < 5000);
    };
    assert_eq!(trip.code, TripCode::HoldingTooLong);
    // Two ticks tolerated, the third holds, 2000 more are allowed, one is beyond.
    assert_eq!(ticks, 2004);
}

fn check_stale_on_real_hardware() {
    let mut bench = Bench::run(false);
    for stale in 1..=2 {
        bench.input.inputs_stale_ticks = stale;
        assert_eq!(bench.tick().state, BenchState::Running);
    }
    bench.input.inputs_stale_ticks = 3;
    let out = bench.tick();
    assert_eq!(out.trip.unwrap().code, TripCode::StaleInputs);
    // Fresh inputs do not bring it back.
    bench.input.inputs_stale_ticks = 0;
    for _ in 0..500 {
        assert_eq!(bench.tick().state, BenchState::Tripped);
    }
}

#[test]
fn what_the_ecu_asks_for_is_cut_slowed_faded_and_ramps_out_when_it_is_silent() {
    use safety::clamp::flags::{ECU_ABSENT, ECU_ASSIST, ECU_ASSIST_RATE};
    let mut bench = Bench::run(true);
    assert_eq!(bench.tick().assist_request_n_m, None, "no ECU drives the motor");
    let limits = rig().limits;
    let most = limits.ecu_assist_torque_n_m;
    let word = |torque: f64, age_ticks: u32| Some(EcuWord { assist_torque_n_m: torque, age_ticks });
    let mut last = 0.0;
    // Its first words fade in.
    for _ in 0..250 {
        bench.input.ecu = word(5.0, 1);
        let now = bench.tick().assist_request_n_m.unwrap();
        assert!(now - last <= 5.0 * PERIOD_S / limits.resume_fade_s + 1e-9);
        last = now;
    }
    assert_eq!(last, 5.0);
    for n in 0..100 {
        bench.input.ecu = word(1000.0, 1);
        let out = bench.tick();
        let now = out.assist_request_n_m.unwrap();
        assert!((now - last) <= limits.ecu_assist_rate_n_m_s * PERIOD_S + 1e-9 && now <= most);
        assert!(out.clamped & ECU_ASSIST != 0 && (n > 30 || out.clamped & ECU_ASSIST_RATE != 0));
        last = now;
    }
    assert_eq!(last, most);
    // Silent by its own word, or because nobody brings it: the same ramp, which the safe state's time bounds.
    for silent in [word(f64::NAN, 0), word(20.0, (limits.ecu_stale_s / PERIOD_S) as u32 + 1)] {
        for _ in 0..250 {
            bench.input.ecu = word(20.0, 1);
            last = bench.tick().assist_request_n_m.unwrap();
        }
        assert_eq!(last, 20.0);
        for _ in 0..(limits.safe_ramp_s / PERIOD_S) as u32 + 1 {
            bench.input.ecu = silent;
            let out = bench.tick();
            let now = out.assist_request_n_m.unwrap();
            assert!(now <= last && out.clamped & ECU_ABSENT != 0 && out.trip.is_none());
            last = now;
        }
        assert_eq!(last, 0.0);
    }
    // A bench that trips takes the assist off with the forces.
    for _ in 0..250 {
        bench.input.ecu = word(20.0, 1);
        bench.tick();
    }
    bench.input.emergency_stop = true;
    let out = bench.tick();
    assert!((out.assist_request_n_m.unwrap() - 20.0 * out.fade.force).abs() < 1e-9 && out.fade.force < 1.0);
    for _ in 0..100 {
        bench.tick();
    }
    assert_eq!(bench.tick().assist_request_n_m, Some(0.0));
}

#[test]
fn a_silent_ecu_keeps_the_bench_from_starting() {
    let mut bench = Bench::new(true);
    bench.request(OperatorRequest::SwitchOn);
    for _ in 0..600 {
        bench.input.ecu = Some(EcuWord { assist_torque_n_m: f64::NAN, age_ticks: u32::MAX });
        assert_eq!(bench.tick().state, BenchState::Idle);
    }
    assert!(bench.request(OperatorRequest::Arm).request_refused);
    bench.input.ecu = Some(EcuWord { assist_torque_n_m: 0.0, age_ticks: 1 });
    bench.tick();
    assert!(!bench.request(OperatorRequest::Arm).request_refused);
}

#[test]
fn holding_freezes_ramps_and_resumes_without_a_step() {
    let mut bench = Bench::run(true);
    let before = bench.tick();
    for stale in 1..=40 {
        bench.input.inputs_stale_ticks = stale;
        let out = bench.tick();
        if stale < 3 {
            assert_eq!((out.state, out.fade), (BenchState::Running, Fade::FULL));
        } else {
            assert_eq!(out.state, BenchState::Holding);
            assert_eq!(out.command.ball_height_m, before.command.ball_height_m);
            let expected = 1.0 - f64::from(stale - 2) * PERIOD_S / 0.1;
            assert!((out.fade.force - expected).abs() < 1e-9);
            assert_eq!(out.command.steer, SteerCommand::Free);
        }
    }
    // Meanwhile the car moved on: the command comes back elsewhere.
    bench.input.inputs_stale_ticks = 0;
    bench.input.command = command(-2500.0, 0.03);
    let mut last = bench.tick();
    let (mut fresh, mut resumed_at, mut running_at) = (1, 0, 0);
    while running_at == 0 {
        let out = bench.tick();
        fresh += 1;
        if out.state == BenchState::Resuming && resumed_at == 0 {
            resumed_at = fresh;
        }
        if out.state == BenchState::Running {
            running_at = fresh;
        }
        let force = |o: &SafetyOutput| o.fade.force * o.command.tie_rod_force_n[0];
        assert!((force(&out) - force(&last)).abs() <= 200.0 + 50.0, "no step of force: {fresh}");
        assert!(fresh < 1000 && out.trip.is_none());
        last = out;
    }
    assert_eq!(resumed_at, 10, "ten fresh ticks");
    assert!((195..=205).contains(&(running_at - resumed_at)), "200 ms of fade: {}", running_at - resumed_at);
    assert_eq!(last.command.tie_rod_force_n, [-2500.0, 2500.0]);
}

#[test]
fn stopping_fades_out_and_ends_idle() {
    let mut bench = Bench::run(true);
    bench.request(OperatorRequest::Stop);
    for _ in 0..998 {
        assert_eq!(bench.tick().state, BenchState::Stopping);
    }
    for _ in 0..3 {
        bench.tick();
    }
    assert_eq!(bench.safety.state(), BenchState::Idle);
}

#[test]
fn nothing_starts_unsafe_or_stale_or_out_of_order() {
    let mut bench = Bench::new(true);
    assert!(bench.request(OperatorRequest::Start).request_refused);
    bench.request(OperatorRequest::SwitchOn);
    assert!(bench.request(OperatorRequest::Start).request_refused);
    bench.disturb = |i| i.measurement.tie_rod_force_n[0] = 9900.0;
    assert_eq!(bench.tick().state, BenchState::Tripped);
    assert!(bench.request(OperatorRequest::Acknowledge).request_refused, "the cause is still there");
    bench.disturb = |_| {};
    assert!(!bench.request(OperatorRequest::Acknowledge).request_refused);
    bench.request(OperatorRequest::Arm);
    bench.input.inputs_stale_ticks = 1;
    assert!(bench.request(OperatorRequest::Start).request_refused);
}

#[test]
fn a_command_that_is_not_a_number_holds() {
    let mut bench = Bench::run(true);
    bench.input.command.tie_rod_force_n[0] = f64::NAN;
    let out = bench.tick();
    assert_eq!(out.state, BenchState::Holding);
    assert!(out.command.tie_rod_force_n.iter().all(|f| f.is_finite()));
    assert!(out.clamped & safety::clamp::flags::NOT_FINITE != 0);
}

#[test]
fn state_continues_exactly() {
    let mut a = Bench::run(true);
    a.input.inputs_stale_ticks = 5;
    a.tick();
    let mut state = vec![f64::NAN; a.safety.state_len()];
    a.safety.save_state(&mut state);
    assert!(state.iter().all(|v| v.is_finite()));
    let mut b = Bench::new(true);
    b.safety.load_state(&state);
    b.input = a.input;
    for i in 0..400 {
        let stale = if i < 20 { 6 + i } else { 0 };
        a.input.inputs_stale_ticks = stale;
        b.input.inputs_stale_ticks = stale;
        assert_eq!(a.tick(), b.tick());
    }
}

fn any_number() -> impl Strategy<Value = f64> {
    prop_oneof![
        8 => -2.0_f64..2.0,
        3 => -1e5_f64..1e5,
        1 => proptest::num::f64::ANY,
    ]
}

fn any_command() -> impl Strategy<Value = RigCommand> {
    (proptest::array::uniform8(any_number()), 0..3u8).prop_map(|(v, mode)| RigCommand {
        tie_rod_force_n: [v[0] * 3000.0, v[1] * 3000.0],
        ball_height_m: [v[2] * 0.05, v[3] * 0.05],
        ball_height_velocity_m_s: [v[4], v[5]],
        steer: match mode {
            0 => SteerCommand::Free,
            1 => SteerCommand::Angle { angle_rad: v[6] * 8.0, rate_rad_s: v[7] * 8.0 },
            _ => SteerCommand::Torque { torque_n_m: v[6] * 20.0 },
        },
        fade: Fade::FULL,
    })
}

fn request(number: u8) -> OperatorRequest {
    [
        OperatorRequest::None,
        OperatorRequest::SwitchOn,
        OperatorRequest::Arm,
        OperatorRequest::Start,
        OperatorRequest::Stop,
        OperatorRequest::Acknowledge,
        OperatorRequest::SwitchOff,
    ][usize::from(number % 7)]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, ..ProptestConfig::default() })]

    #[test]
    fn no_command_outside_limits_ever_passes(
        ticks in proptest::collection::vec((any_command(), 0..6u32, any::<u8>(), any::<bool>()), 1..60),
        actuations in proptest::collection::vec(proptest::array::uniform5(any_number()), 8),
    ) {
        let limits = rig().limits;
        let mut bench = Bench::new(true);
        let mut last: Option<SafetyOutput> = None;
        for (n, (command, stale, asked, noisy)) in ticks.into_iter().enumerate() {
            // Random requests seldom start a bench: walk there first, and back after a trip.
            let wanted = if noisy { asked } else { [1, 2, 3, 5][n % 4] };
            bench.input.request = request(wanted);
            bench.input.ecu = noisy.then_some(EcuWord { assist_torque_n_m: command.tie_rod_force_n[0], age_ticks: stale });
            bench.input.command = command;
            bench.input.inputs_stale_ticks = stale;
            let out = bench.tick();
            let c = &out.command;
            prop_assert!(out.assist_request_n_m.is_none_or(|t| t.abs() <= limits.ecu_assist_torque_n_m));
            for side in 0..2 {
                prop_assert!(c.tie_rod_force_n[side].abs() <= limits.command_force_n);
                prop_assert!(c.ball_height_m[side].abs() <= limits.command_height_m);
                prop_assert!(c.ball_height_velocity_m_s[side].abs() <= limits.command_height_speed_m_s);
            }
            match c.steer {
                SteerCommand::Free => {}
                SteerCommand::Angle { angle_rad, rate_rad_s } => {
                    prop_assert!(angle_rad.abs() <= limits.command_steer_angle_rad);
                    prop_assert!(rate_rad_s.abs() <= limits.command_steer_rate_rad_s);
                }
                SteerCommand::Torque { torque_n_m } => {
                    prop_assert!(torque_n_m.abs() <= limits.command_steer_torque_n_m);
                }
            }
            for gain in [out.fade.force, out.fade.vertical, out.fade.steer] {
                prop_assert!((0.0..=1.0).contains(&gain));
            }
            if let Some(before) = last
                && before.state == BenchState::Running && out.state == BenchState::Running {
                for side in 0..2 {
                    let step = c.tie_rod_force_n[side] - before.command.tie_rod_force_n[side];
                    prop_assert!(step.abs() <= limits.command_force_rate_n_s * PERIOD_S + 1e-9);
                }
            }
            last = Some(out);
            let v = actuations[n % 8];
            let mut actuation = Actuation {
                horizontal_valve: [v[0], v[1]],
                vertical_valve: [v[2], v[3]],
                steer_torque_n_m: v[4] * 100.0,
            };
            bench.safety.clamp_actuation(&mut actuation);
            for valve in actuation.horizontal_valve.iter().chain(&actuation.vertical_valve) {
                prop_assert!(valve.abs() <= limits.command_valve);
            }
            prop_assert!(actuation.steer_torque_n_m.abs() <= limits.command_steer_torque_n_m);
            if out.fade.steer == 0.0 {
                prop_assert_eq!(actuation.steer_torque_n_m, 0.0);
            }
        }
    }
}

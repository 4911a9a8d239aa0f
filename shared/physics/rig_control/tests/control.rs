//! The controller on the virtual rig: the published table, lags, switches, faults, determinism.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use config::rig::{Rig, Switches};
use config::unit::SteeringUnit;
use rig_control::study::{MANOEUVRES, Study};
use rig_control::{ControlDiagnostics, Fade, RigCommand, RigController, SteerCommand};
use rig_plant::{Actuation, Measurement, RigEnvironment, VirtualRig};

fn rig() -> Rig {
    toml::from_str(include_str!("../../../../schemas/rigs/virtual.toml")).unwrap()
}

fn unit() -> SteeringUnit {
    toml::from_str(include_str!("../../../../schemas/units/column_eps.toml")).unwrap()
}

#[test]
fn nominal_errors_are_half_the_published_ones_and_lags_within_bounds() {
    let study = Study::new(&rig(), &unit());
    for m in &MANOEUVRES {
        let result = study.run(m).unwrap();
        for (k, (ours, published)) in result.figures().iter().zip(m.published).enumerate() {
            assert!(*ours <= 0.5 * published, "{}: figure {k} is {ours} %, published {published} %", m.name);
        }
        for side in &result.sides {
            assert!(side.amplitude_n > 150.0, "{}: the load must be real", m.name);
            assert!(side.force_lag_s.abs() <= 0.005, "{}: force lag {}", m.name, side.force_lag_s);
            assert!(side.height_lag_s.abs() <= 0.010, "{}: height lag {}", m.name, side.height_lag_s);
        }
    }
}

#[test]
fn a_plant_that_differs_by_a_fifth_stays_within_the_published_figures() {
    let alone = [
        (1.2, 1.0, 1.0),
        (0.8, 1.0, 1.0),
        (1.0, 1.2, 1.0),
        (1.0, 0.8, 1.0),
        (1.0, 1.0, 1.2),
        (1.0, 1.0, 0.8),
    ];
    let corners = (0..8).map(|bits| {
        let of = |k: u32| if bits >> k & 1 == 1 { 0.8 } else { 1.2 };
        (of(0), of(1), of(2))
    });
    for (gain, stiffness, delay) in alone.into_iter().chain(corners) {
        let study = Study::new(&rig(), &unit()).with_plant(gain, stiffness, delay);
        for m in &MANOEUVRES {
            let result = study.run(m).unwrap();
            for (ours, published) in result.figures().iter().zip(m.published) {
                assert!(*ours <= published, "{} {gain} {stiffness} {delay}: {ours} {published}", m.name);
            }
        }
    }
}

#[test]
fn compensations_earn_their_place() {
    let nominal = Study::new(&rig(), &unit());
    let worst = |study: &Study| {
        let figures = study.run(&MANOEUVRES[3]).unwrap().figures();
        figures[1].max(figures[3])
    };
    let base = worst(&nominal);
    let off: [fn(&mut Switches); 4] = [
        |s| s.force_conversion = false,
        |s| s.rack_feed_forward = false,
        |s| s.delay_compensation = false,
        |s| s.force_rate_feed_forward = false,
    ];
    for (k, change) in off.into_iter().enumerate() {
        let mut study = nominal.clone();
        change(&mut study.switches);
        let without = worst(&study);
        assert!(without > 1.5 * base, "switch {k}: {without} % without, {base} % with");
    }
}

/// Rig and controller together.
struct Loop {
    plant: VirtualRig,
    control: RigController,
    m: Measurement,
    act: Actuation,
    diag: ControlDiagnostics,
}

impl Loop {
    fn new() -> Self {
        let mut plant = VirtualRig::new(&rig(), &unit(), 5, 1e-3).unwrap();
        plant.set_environment(&RigEnvironment { vehicle_speed_m_s: 20.0, ..RigEnvironment::default() });
        Self {
            plant,
            control: RigController::new(&rig(), &unit(), 1e-3).unwrap(),
            m: Measurement::default(),
            act: Actuation::default(),
            diag: ControlDiagnostics::default(),
        }
    }

    fn tick(&mut self, command: &RigCommand) {
        self.plant.sample(&mut self.m);
        self.control.step(command, &self.m, &mut self.act, &mut self.diag);
        self.plant.advance(5e-4);
        self.plant.set_actuation(&self.act);
        self.plant.advance(5e-4);
    }
}

fn swing(n: u32) -> RigCommand {
    let t = f64::from(n) * 1e-3;
    let gain = (t / 0.5).min(1.0);
    RigCommand {
        tie_rod_force_n: [800.0 * (4.0 * t).sin(), -600.0 * (4.0 * t).sin()],
        ball_height_m: [0.02 * (6.0 * t).sin(), -0.015 * (5.0 * t).sin()],
        ball_height_velocity_m_s: [0.12 * (6.0 * t).cos(), -0.075 * (5.0 * t).cos()],
        steer: SteerCommand::Angle { angle_rad: 0.8 * (4.0 * t).sin(), rate_rad_s: 3.2 * (4.0 * t).cos() },
        fade: Fade { force: gain, vertical: gain, steer: gain },
    }
}

#[test]
fn state_continues_bit_exactly() {
    let mut a = Loop::new();
    for n in 0..700 {
        a.tick(&swing(n));
    }
    let mut state = vec![f64::NAN; a.control.state_len()];
    a.control.save_state(&mut state);
    assert!(state.iter().all(|v| v.is_finite()), "state_len must be exact");
    let mut b = RigController::new(&rig(), &unit(), 1e-3).unwrap();
    b.load_state(&state);
    let (mut act, mut diag) = (Actuation::default(), ControlDiagnostics::default());
    for n in 700..1200 {
        a.tick(&swing(n));
        b.step(&swing(n), &a.m, &mut act, &mut diag);
        assert_eq!(act, a.act, "tick {n}");
        assert_eq!(diag, a.diag, "tick {n}");
    }
}

#[test]
fn readings_and_commands_that_are_not_finite_are_held() {
    use rig_control::command::flags::{COMMAND_HELD, MEASUREMENT_HELD};
    let mut a = Loop::new();
    for n in 0..500 {
        a.tick(&swing(n));
    }
    let mut bad = swing(500);
    bad.tie_rod_force_n = [f64::NAN, f64::INFINITY];
    bad.steer = SteerCommand::Angle { angle_rad: f64::NAN, rate_rad_s: 0.0 };
    let mut m = a.m;
    m.tie_rod_force_n[0] = f64::NAN;
    m.rack_displacement_m = f64::NAN;
    for _ in 0..5 {
        a.control.step(&bad, &m, &mut a.act, &mut a.diag);
        assert!(a.act.horizontal_valve.iter().all(|v| v.is_finite()) && a.act.steer_torque_n_m.is_finite());
        assert!(a.diag.force_error_n.iter().all(|v| v.is_finite()));
        assert_eq!(a.diag.flags & (COMMAND_HELD | MEASUREMENT_HELD), COMMAND_HELD | MEASUREMENT_HELD);
    }
}

#[test]
fn frozen_vertical_axes_stay_and_force_follows_its_fade() {
    let mut a = Loop::new();
    for n in 0..1400 {
        a.tick(&swing(n));
    }
    let at = a.plant.truth().vertical_stroke_m;
    let mut command = swing(1400);
    for n in 0..300 {
        command.fade = Fade { force: (1.0 - f64::from(n) * 0.01).max(0.0), vertical: 0.0, steer: 0.0 };
        a.tick(&command);
    }
    let t = a.plant.truth();
    for side in 0..2 {
        assert!((t.vertical_stroke_m[side] - at[side]).abs() < 2e-3, "{:?} {at:?}", t.vertical_stroke_m);
        assert!(t.vertical_speed_m_s[side].abs() < 2e-3);
        assert!(t.tie_rod_force_n[side].abs() < 60.0, "{:?}", t.tie_rod_force_n);
    }
    assert_eq!(a.act.steer_torque_n_m, 0.0);
}

#[test]
fn torque_mode_gives_the_torque() {
    let mut a = Loop::new();
    let mut command = RigCommand { fade: Fade::FULL, ..RigCommand::default() };
    command.steer = SteerCommand::Torque { torque_n_m: 1.5 };
    for _ in 0..3000 {
        // A load that centres, so that the wheel comes to rest.
        let x = a.plant.truth().unit.rack_displacement_m;
        command.tie_rod_force_n = [-1e5 * x, 1e5 * x];
        a.tick(&command);
    }
    let torque = a.plant.truth().steering_wheel_torque_n_m;
    assert!((torque - 1.5).abs() < 0.08, "{torque}");
    assert!(a.plant.truth().unit.hand_wheel_rate_rad_s.abs() < 0.05);
}

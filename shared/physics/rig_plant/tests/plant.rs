//! The virtual rig against closed forms and its own finer steps.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout, missing_docs)]

use config::rig::{Rig, SteerDevice};
use config::unit::{Assist, SteeringUnit};
use rig_plant::{Actuation, Measurement, RigEnvironment, VirtualRig};

fn rig() -> Rig {
    toml::from_str(include_str!("../../../../schemas/rigs/virtual.toml")).unwrap()
}

fn unit() -> SteeringUnit {
    toml::from_str(include_str!("../../../../schemas/units/column_eps.toml")).unwrap()
}

fn horizontal(left: f64, right: f64) -> Actuation {
    Actuation { horizontal_valve: [left, right], ..Actuation::default() }
}

#[test]
fn at_rest_it_stays_at_rest() {
    let mut plant = VirtualRig::new(&rig(), &unit(), 1, 1e-3).unwrap();
    plant.advance(1.0);
    let t = plant.truth();
    // The vertical load pressure leaks: closed valves sink by C p/A = 1.5 mm/s until the controller acts.
    let leak = rig().plant.vertical.leakage_m3_s_pa * t.load_pressure_pa[1][0] / 2e-3;
    assert!((t.vertical_stroke_m[0] + leak).abs() < 0.3 * leak, "{} {leak}", t.vertical_stroke_m[0]);
    assert!(
        t.tie_rod_force_n[0].abs() < 30.0,
        "only the sinking ball turns the rod: {:?}",
        t.tie_rod_force_n
    );
    assert!(t.unit.rack_displacement_m.abs() < 1e-4);
}

#[test]
fn vertical_axis_runs_at_its_no_load_speed() {
    let mut rig = rig();
    rig.plant.vertical.mass_kg = 1.0;
    rig.plant.vertical.friction.sliding_n = 0.0;
    rig.plant.vertical.leakage_m3_s_pa = 0.0;
    rig.plant.sub_step_s = 1e-5;
    let mut plant = VirtualRig::new(&rig, &unit(), 1, 1e-3).unwrap();
    let up = Actuation { vertical_valve: [1.0, 1.0], ..Actuation::default() };
    plant.set_actuation(&up);
    plant.advance(0.1);
    let speed = plant.truth().vertical_speed_m_s[0];
    // The tie rod resists little at small angle; the specified top speed is 0.55 m/s.
    assert!((speed - 0.5485).abs() < 0.006, "{speed}");
}

#[test]
fn oil_column_rings_at_its_closed_form_frequency() {
    // β A²(1/V₁ + 1/V₂) on the mass; tie rod and friction taken away.
    let mut rig = rig();
    let axis = &mut rig.plant.vertical;
    axis.friction.sliding_n = 0.0;
    axis.leakage_m3_s_pa = 0.0;
    let volume = axis.piston_area_m2 * (axis.stroke_m + axis.dead_length_m);
    let stiffness = 2.0 * axis.bulk_modulus_pa * axis.piston_area_m2.powi(2) / volume;
    let expected = (stiffness / axis.mass_kg).sqrt() / core::f64::consts::TAU;
    rig.plant.leaf_spring_stiffness_n_m = 1.0;
    rig.plant.sub_step_s = 1e-5;
    let mut plant = VirtualRig::new(&rig, &unit(), 1, 1e-3).unwrap();
    let mut kick = Actuation { vertical_valve: [0.2, 0.0], ..Actuation::default() };
    plant.set_actuation(&kick);
    plant.advance(0.005);
    kick.vertical_valve[0] = 0.0;
    plant.set_actuation(&kick);
    plant.advance(0.06);
    let (mut crossings, mut last, mut first_at, mut last_at) =
        (0, plant.truth().vertical_speed_m_s[0], 0.0, 0.0);
    for i in 0..20000 {
        plant.advance(1e-5);
        let speed = plant.truth().vertical_speed_m_s[0];
        if last < 0.0 && speed >= 0.0 {
            let at = f64::from(i) * 1e-5 + speed / (speed - last) * -1e-5;
            if crossings == 0 {
                first_at = at;
            }
            last_at = at;
            crossings += 1;
        }
        last = speed;
    }
    let frequency = f64::from(crossings - 1) / (last_at - first_at);
    assert!((frequency / expected - 1.0).abs() < 0.01, "{frequency} Hz, expected {expected} Hz");
}

#[test]
fn stall_force_is_area_times_supply_pressure() {
    let mut rig = rig();
    rig.plant.horizontal.friction.sliding_n = 0.0;
    rig.plant.horizontal.leakage_m3_s_pa = 0.0;
    rig.plant.leaf_spring_stiffness_n_m = 5e6;
    // Both pull: the rack stays and the rods load the cylinders until they stall.
    let mut plant = VirtualRig::new(&rig, &unit(), 1, 1e-3).unwrap();
    plant.set_actuation(&horizontal(1.0, 1.0));
    plant.advance(1.0);
    let force = plant.truth().actuator_force_n;
    assert!((force[0] - 42_000.0).abs() < 100.0 && (force[1] - 42_000.0).abs() < 100.0, "{force:?}");
}

#[test]
fn tie_rod_force_follows_from_actuator_force_through_the_linkage() {
    let mut plant = VirtualRig::new(&rig(), &unit(), 1, 1e-3).unwrap();
    for i in 0..2000 {
        let phase = f64::from(i) * 1e-3 * 6.3;
        plant.set_actuation(&horizontal(0.05 * phase.cos(), -0.03 * phase.cos()));
        plant.advance(1e-3);
    }
    plant.set_actuation(&Actuation::default());
    plant.advance(0.5);
    let t = *plant.truth();
    for side in 0..2 {
        let sign = [1.0, -1.0][side];
        let arm = plant.linkage().arm_at_stroke(t.horizontal_stroke_m[side]);
        let rod = plant.linkage().rod(&arm, t.vertical_stroke_m[side], sign * t.unit.rack_displacement_m);
        let expected = t.actuator_force_n[side] / plant.linkage().elongation_per_stroke(&arm, &rod);
        assert!((expected - t.tie_rod_force_n[side]).abs() < 3.0, "{expected} {}", t.tie_rod_force_n[side]);
    }
}

fn drive(rig: &Rig, unit: &SteeringUnit, ticks: u32) -> Vec<[f64; 4]> {
    let mut plant = VirtualRig::new(rig, unit, 3, 1e-3).unwrap();
    plant.set_environment(&RigEnvironment { vehicle_speed_m_s: 22.0, ..RigEnvironment::default() });
    let mut out = Vec::new();
    for i in 0..ticks {
        let t = f64::from(i) * 1e-3;
        plant.set_actuation(&Actuation {
            horizontal_valve: [0.04 * (7.0 * t).sin(), -0.05 * (9.0 * t).sin()],
            vertical_valve: [0.03 * (5.0 * t).sin(), 0.02 * (4.0 * t).cos()],
            steer_torque_n_m: 4.0 * (6.0 * t).sin(),
        });
        plant.advance(1e-3);
        let t = plant.truth();
        out.push([
            t.unit.rack_displacement_m * 1e3,
            t.tie_rod_force_n[0] * 1e-3,
            t.unit.hand_wheel_angle_rad,
            t.horizontal_stroke_m[1] * 1e3,
        ]);
    }
    out
}

#[test]
fn sub_step_converges() {
    // The default step against an eightfold finer one: mm, kN, rad, mm over two seconds of motion.
    let mut fine = rig();
    fine.plant.sub_step_s = 1.25e-5;
    let coarse = drive(&rig(), &unit(), 2000);
    let fine = drive(&fine, &unit(), 2000);
    let mut worst = [0.0_f64; 4];
    for (a, b) in coarse.iter().zip(&fine) {
        for k in 0..4 {
            worst[k] = worst[k].max((a[k] - b[k]).abs());
        }
    }
    println!("0.1 ms against 12.5 µs: {worst:?}");
    let peak = fine.iter().fold(0.0_f64, |m, v| m.max(v[1].abs()));
    assert!(peak > 0.5, "the drive must load the rods: {peak} kN");
    assert!(worst[0] < 0.1 && worst[1] < 0.03 && worst[2] < 0.02 && worst[3] < 0.1, "{worst:?}");
}

#[test]
fn assist_is_stable_at_every_speed_and_lightens_steering() {
    let hold = |speed: f64, manual: bool, torque: f64| {
        let mut unit = unit();
        if manual {
            unit.assist = Assist::None {};
        }
        let mut rig = rig();
        rig.plant.steer.device = SteerDevice::MeasuringWheel;
        let mut plant = VirtualRig::new(&rig, &unit, 3, 1e-3).unwrap();
        plant.set_environment(&RigEnvironment {
            vehicle_speed_m_s: speed,
            engine_on: true,
            hand_torque_n_m: torque,
            assist_request_n_m: None,
        });
        plant.advance(3.0);
        // Ringing shows as curvature from tick to tick; the drift by leaking cylinders does not.
        let mut before = [plant.truth().unit.torsion_bar_torque_n_m; 2];
        let mut ripple = 0.0_f64;
        for i in 0..1000 {
            plant.advance(1e-3);
            let now = plant.truth().unit.torsion_bar_torque_n_m;
            if i > 1 {
                ripple = ripple.max((now - 2.0 * before[0] + before[1]).abs());
            }
            before = [now, before[0]];
        }
        (ripple, plant.truth().unit.rack_displacement_m)
    };
    for speed in [0.0, 5.0, 14.0, 22.0, 33.0, 60.0] {
        for torque in [0.5, 3.0, 7.0] {
            let (ripple, _) = hold(speed, false, torque);
            assert!(ripple < 0.001, "at {speed} m/s and {torque} N·m the assist rings: {ripple} N·m");
        }
    }
    let (_, parked) = hold(0.0, false, 3.0);
    let (_, fast) = hold(33.0, false, 3.0);
    let (_, manual) = hold(0.0, true, 3.0);
    assert!(parked > 1.5 * fast && fast > 1.2 * manual, "{parked} {fast} {manual}");
}

#[test]
fn sensors_are_delayed_by_exactly_the_transport_delay() {
    let mut rig = rig();
    let s = &mut rig.sensors;
    s.tie_rod_force.noise_n = 0.0;
    s.rack_displacement.noise_m = 0.0;
    s.horizontal_stroke.noise_m = 0.0;
    s.horizontal_stroke.nonlinearity_ratio = 0.0;
    s.horizontal_stroke.hysteresis_ratio = 0.0;
    s.horizontal_stroke.repeatability_ratio = 0.0;
    s.horizontal_stroke.zero_balance_ratio = 0.0;
    let mut plant = VirtualRig::new(&rig, &unit(), 1, 1e-3).unwrap();
    plant.set_actuation(&horizontal(0.05, -0.05));
    let mut before = 0.0;
    let mut m = Measurement::default();
    for _ in 0..200 {
        plant.sample(&mut m);
        assert!((m.horizontal_stroke_m[0] - before).abs() <= 0.125 / 32767.0);
        before = plant.truth().horizontal_stroke_m[0];
        plant.advance(1e-3);
    }
    assert!(before > 0.003);
    assert_eq!(m.validity, Measurement::ALL_VALID);
}

#[test]
fn readings_stay_within_the_stated_errors() {
    for seed in 0..20 {
        let rig = rig();
        let mut plant = VirtualRig::new(&rig, &unit(), seed, 1e-3).unwrap();
        let mut m = Measurement::default();
        for i in 0..500 {
            plant.set_actuation(&horizontal(0.2 * (f64::from(i) * 0.02).sin(), 0.0));
            plant.advance(1e-3);
            plant.advance(0.0);
            plant.sample(&mut m);
        }
        // Slow enough now that the delay is nothing.
        plant.set_actuation(&Actuation::default());
        plant.advance(0.3);
        plant.sample(&mut m);
        let t = plant.truth();
        let s = &rig.sensors;
        let near = |reading: f64, truth: f64, bound: f64, what: &str| {
            assert!((reading - truth).abs() < bound, "{what}: {reading} against {truth} (seed {seed})");
        };
        let cell = &s.tie_rod_force;
        let bound =
            cell.range_n * (cell.nonlinearity_ratio + 2.0 * cell.hysteresis_ratio) + 6.0 * cell.noise_n;
        near(m.tie_rod_force_n[0], t.tie_rod_force_n[0], bound, "tie-rod force");
        let pot = &s.rack_displacement;
        near(
            m.rack_displacement_m,
            t.unit.rack_displacement_m,
            pot.range_m * pot.nonlinearity_ratio + 2e-4,
            "rack",
        );
        near(m.horizontal_stroke_m[0], t.horizontal_stroke_m[0], 0.00125 + 5e-5, "stroke");
        let moved = 1.1e-3 * t.unit.hand_wheel_rate_rad_s.abs();
        near(m.steering_wheel_angle_rad, t.unit.hand_wheel_angle_rad, moved + 4.5e-4, "angle");
    }
}

#[test]
fn untared_cells_carry_their_zero_balance() {
    let mut rig = rig();
    rig.sensors.tare_at_start = false;
    let mut largest = 0.0_f64;
    for seed in 0..20 {
        let mut plant = VirtualRig::new(&rig, &unit(), seed, 1e-3).unwrap();
        let mut m = Measurement::default();
        plant.sample(&mut m);
        largest = largest.max(m.tie_rod_force_n[0].abs());
        plant.tare();
        plant.sample(&mut m);
        assert!(m.tie_rod_force_n[0].abs() < 5.0);
    }
    assert!(largest > 250.0 && largest < 540.0, "{largest}");
}

#[test]
fn state_continues_bit_exactly() {
    let actuation = |i: u32| {
        let t = f64::from(i) * 1e-3;
        Actuation {
            horizontal_valve: [0.06 * (17.0 * t).sin(), -0.05 * (9.0 * t).sin()],
            vertical_valve: [0.1 * (5.0 * t).sin(), 0.02],
            steer_torque_n_m: 5.0 * (11.0 * t).sin(),
        }
    };
    let mut a = VirtualRig::new(&rig(), &unit(), 11, 1e-3).unwrap();
    let mut m = Measurement::default();
    for i in 0..500 {
        a.set_actuation(&actuation(i));
        a.advance(1e-3);
        a.sample(&mut m);
    }
    let mut state = vec![f64::NAN; a.state_len()];
    a.save_state(&mut state);
    assert!(state.iter().all(|v| v.is_finite()), "state_len must be exact");
    let mut b = VirtualRig::new(&rig(), &unit(), 11, 1e-3).unwrap();
    b.load_state(&state);
    let mut n = Measurement::default();
    for i in 500..1000 {
        for (plant, out) in [(&mut a, &mut m), (&mut b, &mut n)] {
            plant.set_actuation(&actuation(i));
            plant.advance(1e-3);
            plant.sample(out);
        }
        assert_eq!(m, n, "tick {i}");
        assert_eq!(a.truth(), b.truth(), "tick {i}");
    }
}

#[test]
fn commands_that_are_not_finite_are_ignored() {
    let mut plant = VirtualRig::new(&rig(), &unit(), 11, 1e-3).unwrap();
    let nan = f64::NAN;
    plant.set_actuation(&Actuation {
        horizontal_valve: [nan, f64::INFINITY],
        vertical_valve: [nan, nan],
        steer_torque_n_m: nan,
    });
    plant.set_environment(&RigEnvironment {
        vehicle_speed_m_s: nan,
        engine_on: true,
        hand_torque_n_m: nan,
        assist_request_n_m: Some(nan),
    });
    plant.advance(0.2);
    let mut m = Measurement::default();
    plant.sample(&mut m);
    assert!(m.channels().iter().all(|v| v.is_finite()));
    assert_eq!(plant.fault_count(), 0);
}

#[test]
fn too_stiff_a_machine_is_refused_by_name() {
    let mut rig = rig();
    rig.plant.vertical.mass_kg = 0.01;
    rig.plant.tie_rod_stiffness_n_m = 1e9;
    let mut unit = unit();
    unit.assist_inertia_at_rack_kg = 0.0;
    unit.rack_mass_kg = 0.01;
    let broken = VirtualRig::new(&rig, &unit, 1, 1e-3).err().unwrap();
    let text: Vec<_> = broken.iter().map(|b| format!("{}: {}", b.key, b.rule)).collect();
    assert!(text.iter().any(|t| t.contains("vertical")), "{text:?}");
    assert!(text.iter().any(|t| t.contains("steering unit")), "{text:?}");
    assert!(VirtualRig::new(&self::rig(), &self::unit(), 1, 0.00105).is_err());
}

#[test]
fn two_universal_joints_cancel_and_one_alone_turns_unevenly_without_losing_power() {
    use config::unit::UniversalJoints;
    use rig_plant::unit::uneven;
    let straight =
        UniversalJoints { upper_angle_rad: 0.5, lower_angle_rad: 0.5, phase_rad: 0.0, yoke_rad: 0.3 };
    let single = UniversalJoints { lower_angle_rad: 0.0, ..straight };
    let (mut low, mut high) = (f64::MAX, 0.0_f64);
    for i in -720..=720 {
        let angle = f64::from(i).to_radians();
        let (out, slope) = uneven(&straight, angle);
        assert!((out - angle).abs() < 1e-12 && (slope - 1.0).abs() < 1e-12, "{angle}: {out} {slope}");
        let (out, slope) = uneven(&single, angle);
        assert!((out - angle).abs() < 0.2, "no jump over any turn");
        let step = 1e-6;
        let by_difference =
            (uneven(&single, angle + step).0 - uneven(&single, angle - step).0) / (2.0 * step);
        assert!((slope - by_difference).abs() < 1e-8, "virtual work: torque ratio is the slope");
        (low, high) = (low.min(slope), high.max(slope));
    }
    // Speed ratio of one joint between cos β and 1/cos β.
    assert!((low - 0.5_f64.cos()).abs() < 1e-3 && (high - 1.0 / 0.5_f64.cos()).abs() < 1e-3, "{low} {high}");
}

#[test]
fn interpolated_commands_arrive_in_a_straight_line_half_a_period_later() {
    let opening = |interpolate: bool| {
        let mut rig = rig();
        rig.plant.interpolate_commands = interpolate;
        rig.plant.horizontal.valve_frequency_hz = 1000.0;
        rig.plant.sub_step_s = 2e-5;
        rig.plant.command_delay_s = 0.0;
        let mut plant = VirtualRig::new(&rig, &unit(), 1, 1e-3).unwrap();
        let mut area = 0.0;
        for tick in 0..40 {
            let ramp = 0.01 * f64::from(tick);
            plant.set_actuation(&horizontal(ramp, 0.0));
            for k in 0..50 {
                plant.advance(2e-5);
                let time = f64::from(tick) + f64::from(k) / 50.0;
                if tick >= 20 {
                    area += (0.01 * time - plant.truth().valve_opening[0][0]) / (20.0 * 50.0 * 0.01);
                }
            }
        }
        area
    };
    let (held, interpolated) = (opening(false), opening(true));
    // Behind the ramp by half a tick when held, by a whole one when interpolated, and by the valve both times.
    assert!((interpolated - held - 0.5).abs() < 0.03, "{held} {interpolated}");
}

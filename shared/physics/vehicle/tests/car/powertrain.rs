//! Gearbox, converter, clutch, differentials, brakes: each does what its kind does.

use crate::support::*;
use config::car::{Car, Combustion, Coupling, Powertrain};
use vehicle::{GearMode, Vehicle, VehicleInput};

fn combustion(c: &mut Car) -> &mut Combustion {
    let Powertrain::Combustion(p) = &mut c.powertrain else { panic!("the saloon has an engine") };
    p
}

fn drive(v: &mut Vehicle, input: &mut VehicleInput, seconds: f64, mut each: impl FnMut(&Vehicle)) {
    for _ in 0..(1e3 * seconds) as usize {
        v.step(input);
        input.time_s += 1e-3;
        each(v);
    }
}

fn with_clutch(c: &mut Car) {
    combustion(c).coupling = Coupling::Clutch { torque_n_m: 400.0, launch_rpm: 1800.0 };
}

#[test]
fn automatic_gearbox_shifts_up_and_kicks_down() {
    let mut v = build(&with_constants(car("sedan")));
    let mut input = VehicleInput { throttle: 1.0, ..VehicleInput::default() };
    v.reset(0.0, &VehicleInput { brake_pressure_pa: 3e6, ..VehicleInput::default() });
    let (mut last, mut shifts, mut to_hundred, mut fastest) = (1, 0, f64::NAN, 0.0f64);
    drive(&mut v, &mut input, 20.0, |v| {
        let o = v.output();
        assert!(o.gear >= last, "shifts down under full throttle");
        shifts += o.gear - last;
        last = o.gear;
        fastest = fastest.max(o.engine_speed_rad_s);
        if to_hundred.is_nan() && o.velocity_m_s[0] > 27.78 {
            to_hundred = o.time_s;
        }
    });
    println!("0 to 100 km/h in {to_hundred:.1} s, {shifts} shifts, engine up to {:.0} rpm", fastest * 9.5493);
    assert!((7.0..14.0).contains(&to_hundred) && shifts >= 2 && fastest * 9.5493 < 6800.0);
    // Kick-down from steady 70 km/h.
    input = hold(19.4);
    v.reset(19.4, &input);
    drive(&mut v, &mut input, 1.0, |_| {});
    let before = v.output().gear;
    input = VehicleInput { throttle: 1.0, ..VehicleInput::default() };
    drive(&mut v, &mut input, 2.5, |_| {});
    assert!(v.output().gear < before, "no kick-down from {before} to {}", v.output().gear);
}

#[test]
fn converter_stalls_at_the_balance_of_its_capacity_and_creeps() {
    let c = with_constants(car("sedan"));
    let mut v = build(&c);
    let mut input = VehicleInput { throttle: 1.0, brake_pressure_pa: 1.6e7, ..VehicleInput::default() };
    v.reset(0.0, &VehicleInput { brake_pressure_pa: 1.6e7, ..VehicleInput::default() });
    drive(&mut v, &mut input, 4.0, |_| {});
    let o = *v.output();
    // The differential's friction moves a twentieth from one side to the other: the mean.
    let found = 0.5 * (o.wheels[0].drive_torque_n_m + o.wheels[1].drive_torque_n_m);
    // Stall: engine torque = K(0) omega²; turbine torque twice that, times first gear and axle, halved to each wheel.
    let pump = 0.0028 * o.engine_speed_rad_s.powi(2);
    let wheel = 2.0 * pump * 4.15 * 3.7 * 0.93 / 2.0;
    println!(
        "stall at {:.0} rpm, engine {:.1} N·m, pump {pump:.1} N·m; wheel {:.0} N·m of {wheel:.0}",
        o.engine_speed_rad_s * 9.5493,
        o.engine_torque_n_m,
        found
    );
    assert!((o.engine_torque_n_m / pump - 1.0).abs() < 0.01);
    assert!((found / wheel - 1.0).abs() < 1e-3);
    assert!(o.velocity_m_s[0].abs() < 0.02);
    // Brakes off, throttle closed: creeps.
    let mut v = build(&c);
    input = VehicleInput::default();
    v.reset(0.0, &VehicleInput { brake_pressure_pa: 3e6, ..VehicleInput::default() });
    drive(&mut v, &mut input, 15.0, |_| {});
    let creep = v.output().velocity_m_s[0];
    println!("creeps at {creep:.2} m/s");
    assert!((0.5..4.0).contains(&creep));
}

#[test]
fn manual_gearbox_starts_by_its_clutch_and_locks() {
    let mut c = with_constants(car("sedan"));
    with_clutch(&mut c);
    let mut v = build(&c);
    let mut input = VehicleInput { gear_mode: GearMode::Manual(1), throttle: 0.5, ..VehicleInput::default() };
    v.reset(
        0.0,
        &VehicleInput { brake_pressure_pa: 3e6, gear_mode: GearMode::Manual(1), ..VehicleInput::default() },
    );
    let mut slowest = f64::MAX;
    drive(&mut v, &mut input, 3.0, |v| slowest = slowest.min(v.output().engine_speed_rad_s));
    let o = v.output();
    let shaft = |o: &vehicle::VehicleOutput, ratio: f64| {
        0.5 * (o.wheels[0].spin_rad_s + o.wheels[1].spin_rad_s) * ratio * 3.7
    };
    println!(
        "clutch start: {:.1} m/s after 3 s, engine never below {:.0} rpm",
        o.velocity_m_s[0],
        slowest * 9.5493
    );
    assert!(o.velocity_m_s[0] > 4.0 && slowest * 9.5493 > 500.0);
    assert!((o.engine_speed_rad_s / shaft(o, 4.15) - 1.0).abs() < 0.01, "the clutch slips");
    // It stays in the gear it is told, and the next one brings the engine down in proportion.
    input.gear_mode = GearMode::Manual(2);
    drive(&mut v, &mut input, 1.5, |_| {});
    let o = v.output();
    assert!(o.gear == 2 && (o.engine_speed_rad_s / shaft(o, 2.37) - 1.0).abs() < 0.01);
    // Closed throttle in second: the engine brakes.
    input.throttle = 0.0;
    drive(&mut v, &mut input, 0.5, |_| {});
    assert!(v.output().longitudinal_acceleration_m_s2 < -0.3);
}

#[test]
fn differentials_share_and_lock() {
    let mut speeds = Vec::new();
    for locking in [0.0, 0.6] {
        let mut c = with_constants(car("sedan"));
        let p = combustion(&mut c);
        (p.front_differential.preload_n_m, p.front_differential.locking_ratio) = (0.0, locking);
        let mut v = build(&c);
        let mut input = VehicleInput { throttle: 0.6, ..VehicleInput::default() };
        for i in [0, 2] {
            input.road[i].friction = 0.1;
        }
        v.reset(0.0, &VehicleInput { brake_pressure_pa: 3e6, ..input });
        let mut apart = 0.0f64;
        drive(&mut v, &mut input, 2.0, |v| {
            let w = &v.output().wheels;
            apart = apart.max((w[0].drive_torque_n_m - w[1].drive_torque_n_m).abs());
        });
        let w = &v.output().wheels;
        println!(
            "locking {locking}: {:.2} m/s after 2 s, spins {:.1} and {:.1} rad/s, torques apart by at most {apart:.0} N·m",
            v.output().velocity_m_s[0],
            w[0].spin_rad_s,
            w[1].spin_rad_s
        );
        if locking == 0.0 {
            assert!(apart < 1.0, "an open differential shares evenly");
            assert!(w[0].spin_rad_s > 2.0 * w[1].spin_rad_s, "the wheel on ice does not spin");
        } else {
            assert!(apart > 100.0);
        }
        speeds.push(v.output().velocity_m_s[0]);
    }
    assert!(speeds[1] > 1.5 * speeds[0], "locking does not help: {speeds:?}");
}

#[test]
fn brake_hydraulics_lag_share_and_limit() {
    let c = with_constants(car("sedan"));
    let b = &c.brakes;
    let mut v = build(&c);
    let mut input = VehicleInput { gear_mode: GearMode::Neutral, ..VehicleInput::default() };
    v.reset(30.0, &input);
    input.brake_pressure_pa = 2e6;
    drive(&mut v, &mut input, b.lag_s, |_| {});
    let o = *v.output();
    let rise = o.wheels[0].brake_pressure_pa / 2e6;
    assert!((rise - (1.0 - (-1.0f64).exp())).abs() < 0.01, "after one time constant {rise}");
    drive(&mut v, &mut input, 0.5, |_| {});
    let o = *v.output();
    // Below the knee all four alike; torque by the gain, against the spin; wheels turn.
    for (i, gain) in [(0, b.front_torque_per_pressure_n_m_pa), (3, b.rear_torque_per_pressure_n_m_pa)] {
        assert!((o.wheels[i].brake_pressure_pa / 2e6 - 1.0).abs() < 0.01);
        assert!((o.wheels[i].brake_torque_n_m.abs() / (gain * 2e6) - 1.0).abs() < 0.01);
    }
    let total: f64 = o.wheels.iter().map(|w| w.brake_torque_n_m.abs()).sum();
    let expect = total / 0.29 / v.mass_kg();
    assert!((-o.longitudinal_acceleration_m_s2 / expect - 1.0).abs() < 0.15, "{expect}");
    // Above the knee the rear rises less, beyond the maximum nothing rises; hard braking locks wheels.
    input.brake_pressure_pa = 3e7;
    drive(&mut v, &mut input, 0.6, |_| {});
    let o = *v.output();
    let knee = b.rear_knee_pressure_pa;
    let rear = knee + b.rear_slope_above_knee * (b.max_pressure_pa - knee);
    assert!((o.wheels[0].brake_pressure_pa / b.max_pressure_pa - 1.0).abs() < 0.01);
    assert!((o.wheels[2].brake_pressure_pa / rear - 1.0).abs() < 0.01);
    assert!(o.wheels[0].spin_rad_s.abs() < 0.1 && o.velocity_m_s[0] > 5.0, "front wheels do not lock");
    // The hand brake holds the rear alone.
    input = VehicleInput { gear_mode: GearMode::Neutral, ..VehicleInput::default() };
    v.reset(20.0, &input);
    input.hand_brake = 1.0;
    drive(&mut v, &mut input, 0.3, |_| {});
    let o = *v.output();
    assert!(o.wheels[0].brake_torque_n_m == 0.0 && o.wheels[2].brake_torque_n_m.abs() > 100.0);
}

#[test]
fn park_holds_on_a_slope_and_reverse_goes_back() {
    let mut v = build(&with_constants(car("sedan")));
    let mut input = VehicleInput { gear_mode: GearMode::Park, ..VehicleInput::default() };
    for r in &mut input.road {
        r.slope_x = 0.08;
    }
    v.reset(0.0, &input);
    for _ in 0..5000 {
        for (road, w) in input.road.iter_mut().zip(&v.output().wheels) {
            road.height_m = 0.08 * w.centre_position_m[0];
        }
        v.step(&input);
    }
    assert!(v.output().velocity_m_s[0].abs() < 1e-3, "rolls in park at {}", v.output().velocity_m_s[0]);
    let mut input = VehicleInput { gear_mode: GearMode::Reverse, throttle: 0.2, ..VehicleInput::default() };
    v.reset(0.0, &VehicleInput { brake_pressure_pa: 3e6, ..input });
    drive(&mut v, &mut input, 3.0, |_| {});
    assert!(v.output().velocity_m_s[0] < -1.0 && v.output().gear == -1);
}

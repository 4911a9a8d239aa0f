//! To the limit and past it: nothing blows up, nothing creates energy (spec 3.3, Limit).

use crate::limits::tall_on_plain_tyres;
use crate::numerics::sine_with_dwell;
use crate::support::*;
use vehicle::{GearMode, RoadContact, VehicleInput, VehicleOutput};

/// A small deterministic generator (xorshift64*), so that a failure names a seed.
pub struct Random(pub u64);

impl Random {
    pub fn next(&mut self) -> f64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 11) as f64 / (1u64 << 53) as f64
    }
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.next()
    }
}

pub fn sane(o: &VehicleOutput) -> bool {
    o.position_m.iter().chain(&o.velocity_m_s).chain(&o.angular_velocity_rad_s).all(|v| v.is_finite())
        && o.velocity_m_s.iter().all(|v| v.abs() < 150.0)
        && o.wheels.iter().all(|w| {
            w.fz_n.is_finite()
                && w.fz_n < 3e5
                && w.fx_n.is_finite()
                && w.mz_n_m.is_finite()
                && w.spin_rad_s.abs() < 1e3
                && w.centre_force_n.iter().chain(&w.centre_moment_n_m).all(|v| v.is_finite())
        })
        && o.held_steps == 0
}

#[test]
fn random_inputs_never_blow_up() {
    let steps_each = 100;
    // `KINGPIN_RANDOM_INPUTS=100000` for the whole count.
    let inputs: usize =
        std::env::var("KINGPIN_RANDOM_INPUTS").ok().and_then(|v| v.parse().ok()).unwrap_or(5000);
    // A road that jumps under a rolling wheel works on the tyre by the load it throws at it, which no account of the tyre's
    // own sees: the tyres' energy is booked where shape and height of the road stay from one start to the next.
    let sedan = || build(&with_constants(car("sedan")));
    let cars = [
        ("sedan", sedan(), false),
        ("tall van", tall_on_plain_tyres(), false),
        ("sedan, jumping road", sedan(), true),
        ("tall van, jumping road", tall_on_plain_tyres(), true),
    ];
    let each = inputs / cars.len();
    for (name, mut v, jumps) in cars {
        let mut random = Random(0x5EED_0001);
        let mut input = VehicleInput::default();
        let mut peak = 0.0f64;
        let mut account = TyreAccount::new(1e-3);
        let mut taken = 0.0;
        for n in 0..each {
            if n % 50 == 0 {
                taken += account.taken_j();
                account = TyreAccount::new(1e-3);
                let speed = random.between(-10.0, 70.0);
                input = VehicleInput { target_speed_m_s: Some(speed), ..VehicleInput::default() };
                input.gear_mode = if speed < 0.0 { GearMode::Reverse } else { GearMode::Drive };
                v.reset(speed, &input);
            }
            input.steering_wheel_angle_rad = random.between(-9.0, 9.0);
            input.rack_displacement_m = (random.next() < 0.3).then(|| random.between(-0.07, 0.07));
            input.throttle = random.next();
            input.brake_pressure_pa = if random.next() < 0.4 { random.between(0.0, 1.6e7) } else { 0.0 };
            input.hand_brake = if random.next() < 0.1 { 1.0 } else { 0.0 };
            input.gear_mode = match (random.next() * 8.0) as u32 {
                0 => GearMode::Neutral,
                1 => GearMode::Manual(2),
                2 => GearMode::Reverse,
                _ => GearMode::Drive,
            };
            input.target_speed_m_s = (random.next() < 0.5).then(|| random.between(0.0, 70.0));
            for road in &mut input.road {
                let drawn = RoadContact {
                    height_m: random.between(-0.05, 0.05),
                    slope_x: random.between(-0.1, 0.1),
                    slope_y: random.between(-0.1, 0.1),
                    friction: random.between(0.05, 1.2),
                };
                *road = if jumps || n % 50 == 0 {
                    drawn
                } else {
                    RoadContact { friction: drawn.friction, ..*road }
                };
            }
            input.wind_m_s = [random.between(-20.0, 20.0), random.between(-20.0, 20.0)];
            for _ in 0..steps_each {
                v.step(&input);
                peak = peak.max(v.output().velocity_m_s[0].abs());
                if let (Err(told), false) = (account.book(v.output()), jumps) {
                    panic!("{name} input {n}: {told}; {input:?}");
                }
            }
            assert!(sane(v.output()), "{name} input {n}: {input:?} gave {:?}", v.output());
        }
        println!(
            "{name}: {} random inputs of {steps_each} steps, fastest {peak:.1} m/s, the tyres took {:.1} MJ",
            each,
            1e-6 * taken
        );
    }
}

#[test]
fn sine_with_dwell_grows_to_a_spin() {
    let c = with_constants(car("sedan"));
    let mut v = build(&c);
    let mut most = 0.0f64;
    for k in 1..=8 {
        let amplitude = 0.6 * f64::from(k);
        let mut input = hold(27.78);
        v.reset(27.78, &input);
        let mut slip = 0.0f64;
        let mut account = TyreAccount::new(1e-3);
        for n in 0..6000 {
            input.time_s = 1e-3 * f64::from(n);
            input.steering_wheel_angle_rad = sine_with_dwell(input.time_s, amplitude);
            if n > 500 {
                input.target_speed_m_s = None;
            }
            v.step(&input);
            assert!(sane(v.output()), "amplitude {amplitude} step {n}: {:?}", v.output());
            account.add(v.output());
            slip = slip.max(v.output().side_slip_angle_rad.abs());
        }
        println!(
            "sine with dwell of {:.0} deg: largest side slip {:.1} deg",
            amplitude.to_degrees(),
            slip.to_degrees()
        );
        account.close("    its tyres");
        most = most.max(slip);
    }
    assert!(most.to_degrees() > 90.0, "never spins: {most}");
}

#[test]
fn stands_on_a_slope_by_its_brakes() {
    let mut v = build(&with_constants(car("sedan")));
    let road = [RoadContact { slope_x: 0.15, ..RoadContact::default() }; 4];
    let mut input =
        VehicleInput { road, hand_brake: 1.0, gear_mode: GearMode::Neutral, ..VehicleInput::default() };
    // The road is a plane through the origin; each wheel's height follows its place.
    for _ in 0..3 {
        v.reset(0.0, &input);
        for (road, w) in input.road.iter_mut().zip(&v.output().wheels) {
            road.height_m = 0.15 * w.centre_position_m[0];
        }
    }
    let mut place = v.output().position_m;
    let mut account = TyreAccount::new(1e-3);
    for n in 0..20000 {
        input.time_s = 1e-3 * f64::from(n);
        for (road, w) in input.road.iter_mut().zip(&v.output().wheels) {
            road.height_m = 0.15 * w.centre_position_m[0];
        }
        v.step(&input);
        assert!(sane(v.output()), "step {n}");
        account.add(v.output());
        if n == 5000 {
            place = v.output().position_m;
        }
    }
    let crept = v.output().position_m[0] - place[0];
    let speed = v.output().velocity_m_s[0];
    println!("creeps {:.4} mm in 15 s on a slope of 15 %, {speed:.2e} m/s", 1e3 * crept);
    assert!(crept.abs() < 1e-3, "creeps {crept} m");
    let pull: f64 = v.output().wheels[2..].iter().map(|w| w.fx_n).sum();
    let weight = v.mass_kg() * 9.80665 * (0.15f64).atan().sin();
    assert!((pull / weight - 1.0).abs() < 0.02, "rear wheels hold {pull} N of {weight} N");
    // Released, it rolls back.
    input.hand_brake = 0.0;
    for _ in 0..2000 {
        for (road, w) in input.road.iter_mut().zip(&v.output().wheels) {
            road.height_m = 0.15 * w.centre_position_m[0];
        }
        v.step(&input);
        account.add(v.output());
    }
    account.close("slope");
    let rolled = v.output().velocity_m_s[0];
    assert!((-2.9..-2.3).contains(&rolled), "rolls back at {rolled} m/s after 2 s");
}

#[test]
fn brakes_to_standstill_on_split_friction() {
    let mut v = build(&with_constants(car("sedan")));
    let mut input = hold(27.78);
    v.reset(27.78, &input);
    input.target_speed_m_s = None;
    input.brake_pressure_pa = 6e6;
    for i in [0, 2] {
        input.road[i].friction = 0.3;
    }
    let mut account = TyreAccount::new(1e-3);
    for n in 0..9000 {
        input.time_s = 1e-3 * f64::from(n);
        v.step(&input);
        assert!(sane(v.output()), "step {n}: {:?}", v.output());
        account.add(v.output());
    }
    account.close("split friction");
    let o = v.output();
    let speed = o.velocity_m_s[0].hypot(o.velocity_m_s[1]);
    println!(
        "split friction: stands after {:.1} m, yaw {:.1} deg, {speed:.1e} m/s",
        o.position_m[0],
        o.yaw_rad.to_degrees()
    );
    assert!(speed < 0.01, "still moving at {speed} m/s");
    assert!(o.wheels.iter().all(|w| w.spin_rad_s.abs() < 0.05));
    assert!(o.yaw_rad < -0.2, "the grip is on the right: turns right, not {}", o.yaw_rad);
}

#[test]
fn parks_jumps_and_reverses() {
    let mut v = build(&with_constants(car("sedan")));
    // Parking steer, standing.
    let mut input = VehicleInput { hand_brake: 1.0, gear_mode: GearMode::Neutral, ..VehicleInput::default() };
    v.reset(0.0, &input);
    let mut torque = 0.0f64;
    let mut account = TyreAccount::new(1e-3);
    for n in 0..8000 {
        input.time_s = 1e-3 * f64::from(n);
        input.steering_wheel_angle_rad = 7.0 * (std::f64::consts::TAU * 0.2 * input.time_s).sin();
        v.step(&input);
        assert!(sane(v.output()), "parking step {n}");
        torque = torque.max(v.output().rack_force_n.abs());
        account.add(v.output());
    }
    account.close("parking");
    println!(
        "parking: rack force up to {torque:.0} N, wheel torque now {:.2} N·m",
        v.output().steering_torque_n_m
    );
    assert!((1500.0..12000.0).contains(&torque), "rack force {torque} N");
    // Off a ramp: the road falls away and comes back.
    let mut input = hold(20.0);
    v.reset(20.0, &input);
    let mut air = 0;
    let mut account = TyreAccount::new(1e-3);
    for n in 0..3000 {
        input.time_s = 1e-3 * f64::from(n);
        for (road, w) in input.road.iter_mut().zip(&v.output().wheels) {
            let x = w.centre_position_m[0];
            (road.height_m, road.slope_x) =
                if x > 5.0 && x < 10.0 { (0.12 * (x - 5.0), 0.12) } else { (0.0, 0.0) };
        }
        v.step(&input);
        assert!(sane(v.output()), "jump step {n}: {:?}", v.output());
        air += i32::from(v.output().wheels.iter().all(|w| w.fz_n == 0.0));
        account.add(v.output());
    }
    account.close("jump");
    println!("jump: {air} ms with all wheels off the road");
    assert!(air > 100, "did not jump");
    // Backwards.
    let mut input = VehicleInput { gear_mode: GearMode::Reverse, ..hold(-4.0) };
    v.reset(-4.0, &input);
    let mut account = TyreAccount::new(1e-3);
    for n in 0..4000 {
        input.time_s = 1e-3 * f64::from(n);
        input.steering_wheel_angle_rad = 1.0;
        v.step(&input);
        assert!(sane(v.output()), "reverse step {n}");
        account.add(v.output());
    }
    account.close("reverse");
    let o = v.output();
    assert!((o.velocity_m_s[0] + 4.0).abs() < 0.2, "reverses at {}", o.velocity_m_s[0]);
    assert!(
        o.yaw_rate_rad_s < -0.05,
        "wheel to the left in reverse turns the nose right: {}",
        o.yaw_rate_rad_s
    );
}

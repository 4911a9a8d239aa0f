//! Past the limit: hand-brake turn, roll-over, and the account of the tyres' energy in the whole car.

use crate::robustness::{Random, sane};
use crate::support::*;
use config::car::Car;
use vehicle::{GearMode, Vehicle, VehicleInput};

/// A tall car without its peer's simplifications.
fn tall() -> Car {
    let mut c = car("vw_vanagon");
    c.peer_model = None;
    c
}

/// The same on the saloon's tyres, which can be held to account; its peer's are no passive bodies: their curves do not go
/// through zero and push sideways unpaid, their overturning moment by lateral force has no spring behind it, and a
/// tenth of a per cent of rolling resistance does not pay for driving at an effective radius above the loaded one.
pub fn tall_on_plain_tyres() -> Vehicle {
    build_on(&tall(), &tyre_text("car_205_60r15.tir"))
}

#[test]
fn hand_brake_turn() {
    let mut v = build(&with_constants(car("sedan")));
    let mut input = hold(16.0);
    v.reset(16.0, &input);
    input.target_speed_m_s = None;
    input.gear_mode = GearMode::Neutral;
    let mut slip = 0.0f64;
    let mut account = TyreAccount::new(1e-3);
    for n in 0..5000 {
        input.time_s = 1e-3 * f64::from(n);
        input.steering_wheel_angle_rad = (7.0 * input.time_s / 0.4).min(7.0);
        input.hand_brake = f64::from(u8::from(n > 300 && n < 2500));
        v.step(&input);
        let o = v.output();
        assert!(sane(o), "step {n}: {o:?}");
        account.add(o);
        if n == 1000 {
            assert!(
                o.wheels[2].spin_rad_s.abs() < 1.0 && o.wheels[3].spin_rad_s.abs() < 1.0,
                "the rear turns"
            );
        }
        slip = slip.max(o.side_slip_angle_rad.abs());
    }
    let o = v.output();
    println!(
        "hand-brake turn: yaw {:.0} deg, side slip up to {:.0} deg, ends at {:.2} m/s",
        o.yaw_rad.to_degrees(),
        slip.to_degrees(),
        o.velocity_m_s[0].hypot(o.velocity_m_s[1])
    );
    account.close("hand-brake turn");
    assert!(o.yaw_rad > 1.2 && slip > 0.7, "no turn");
}

#[test]
fn static_roll_over_threshold() {
    // The road banks slowly to the right under a car that grips: the upper wheels lift, then it tips.
    let c = tall();
    let mut v = tall_on_plain_tyres();
    let mut input =
        VehicleInput { brake_pressure_pa: 8e6, gear_mode: GearMode::Park, ..VehicleInput::default() };
    for r in &mut input.road {
        r.friction = 2.0;
    }
    v.reset(0.0, &input);
    let (mut lifted, mut tipped) = (f64::NAN, f64::NAN);
    let mut account = TyreAccount::new(1e-3);
    for n in 0..40000 {
        let slope = 0.05 * 1e-3 * f64::from(n);
        for (road, w) in input.road.iter_mut().zip(&v.output().wheels) {
            road.slope_y = slope;
            road.height_m = slope * w.centre_position_m[1];
        }
        input.time_s = 1e-3 * f64::from(n);
        v.step(&input);
        let o = v.output();
        assert!(sane(o), "step {n}: {o:?}");
        // The road turns by 0.05 / (1 + slope²) rad a second.
        account
            .book_on_turning_road(o, 0.05 / (1.0 + slope * slope))
            .unwrap_or_else(|e| panic!("step {n}: {e}"));
        if lifted.is_nan() && o.wheels[0].fz_n == 0.0 && o.wheels[2].fz_n == 0.0 {
            lifted = slope;
        }
        if o.roll_rad > 1.2 {
            tipped = slope;
            break;
        }
    }
    account.close("roll-over");
    let b = &c.body;
    let unsprung = 2.0 * (c.front.unsprung_mass_kg + c.rear.unsprung_mass_kg);
    let height = (b.sprung_mass_kg * b.sprung_cg_height_m + unsprung * c.front.wheel_centre_height_m)
        / (b.sprung_mass_kg + unsprung);
    let rigid = 0.25 * (c.front.track_m + c.rear.track_m) / height;
    println!(
        "both left wheels lift at a bank of {lifted:.3}, tips at {tipped:.3}; rigid car t/2h = {rigid:.3}"
    );
    assert!(lifted < rigid && lifted > 0.7 * rigid, "{lifted} against {rigid}");
    assert!(tipped >= lifted, "never tipped");
}

#[test]
fn j_turn_to_roll_over() {
    let mut most = Vec::new();
    for (friction, amplitude) in [(0.4, 4.0), (0.6, 1.0), (2.0, 5.0)] {
        let mut v = tall_on_plain_tyres();
        let mut input = hold(25.0);
        v.reset(25.0, &input);
        input.target_speed_m_s = None;
        for r in &mut input.road {
            r.friction = friction;
        }
        let mut roll = 0.0f64;
        let mut account = TyreAccount::new(1e-3);
        for n in 0..5000 {
            input.time_s = 1e-3 * f64::from(n);
            input.steering_wheel_angle_rad = amplitude * (input.time_s / 0.3).min(1.0);
            v.step(&input);
            assert!(sane(v.output()), "friction {friction} step {n}: {:?}", v.output());
            roll = roll.max(v.output().roll_rad.abs());
            account.add(v.output());
        }
        account.close("J-turn");
        println!(
            "J-turn at friction {friction}, {amplitude} rad of wheel: roll up to {:.0} deg",
            roll.to_degrees()
        );
        most.push(roll.to_degrees());
    }
    assert!(most[0] < 15.0 && most[1] < 15.0, "rolls over without grip: {most:?}");
    assert!(most[2] > 60.0, "does not roll over: {most:?}");
}

/// Power of the road on each wheel at its contact, from what the car tells: F·v + M·Ω with the contact's slip velocity.
/// Its sum over time is work that the tyre gives the car: never more than it was given (spec 3.3, Limit).
#[test]
fn no_tyre_makes_energy_in_the_car() {
    let c = with_constants(car("sedan"));
    for seed in 1..=6u64 {
        let mut random = Random(0x0E4E_5EED + seed);
        let mut v = build(&c);
        let speed = [0.0, 3.0, 15.0, 30.0, 45.0, 25.0][seed as usize - 1];
        let mut input = hold(speed);
        v.reset(speed, &input);
        let mut before = *v.output();
        let (mut work, mut traffic) = ([0.0f64; 4], [1.0f64; 4]);
        let (mut steer, mut worst) = (0.0, 0.0f64);
        for n in 0..10000 {
            if n % 250 == 0 {
                input.target_speed_m_s = None;
                input.throttle = if random.next() < 0.4 { random.next() } else { 0.0 };
                input.brake_pressure_pa = if random.next() < 0.4 { random.between(0.0, 9e6) } else { 0.0 };
                input.hand_brake = f64::from(u8::from(random.next() < 0.1));
                steer = random.between(-3.0, 3.0);
                let friction = random.between(0.2, 1.1);
                for r in &mut input.road {
                    r.friction = friction;
                }
            }
            let s = input.steering_wheel_angle_rad;
            input.steering_wheel_angle_rad = s + (steer - s).clamp(-0.01, 0.01);
            input.time_s = 1e-3 * f64::from(n);
            v.step(&input);
            let o = *v.output();
            for i in 0..4 {
                let (w, old) = (&o.wheels[i], &before.wheels[i]);
                let moved = [0, 1].map(|k| (w.centre_position_m[k] - old.centre_position_m[k]) / 1e-3);
                let heading = 0.5 * (o.yaw_rad + w.steer_rad + before.yaw_rad + old.steer_rad);
                let (cos, sin) = (heading.cos(), heading.sin());
                // Contact, carried by the knuckle: below the centre by the loaded radius.
                let lean_rate = (w.inclination_rad - old.inclination_rad) / 1e-3;
                let vx = moved[0] * cos + moved[1] * sin;
                let vy = -moved[0] * sin + moved[1] * cos + lean_rate * w.loaded_radius_m;
                let turn = (o.yaw_rad + w.steer_rad - before.yaw_rad - old.steer_rad) / 1e-3;
                let spin = 0.5 * (w.spin_rad_s + old.spin_rad_s);
                let power = w.fx_n * (vx - spin * w.loaded_radius_m)
                    + w.fy_n * vy
                    + w.my_n_m * spin
                    + w.mz_n_m * turn;
                work[i] += power * 1e-3;
                traffic[i] += power.abs() * 1e-3;
                worst = worst.max(work[i] / traffic[i]);
                // A few joules stand in the carcass at the start.
                assert!(
                    work[i] < 30.0 + 0.005 * traffic[i],
                    "seed {seed} step {n} wheel {i}: gave {} J of {} J",
                    work[i],
                    traffic[i]
                );
            }
            before = o;
        }
        println!(
            "from {speed} m/s: work of the tyres on the car {work:.0?} J, of {traffic:.0?} J to and fro"
        );
        assert!(speed == 0.0 || work.iter().all(|w| *w < 0.0));
    }
}

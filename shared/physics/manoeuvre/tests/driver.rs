//! The path-following driver keeps a linear single-track car on its path.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use config::load;
use config::scenario::{DriverPath, PathFollowing, Scenario, Steer};
use manoeuvre::path::{Observed, PathDriver};

/// Linear single-track model [e.g. Rajamani, Vehicle Dynamics and Control, ch. 2], a mid-size car.
#[derive(Default)]
struct SingleTrack {
    seen: Observed,
    lateral_speed: f64,
    yaw_rate: f64,
}

const RATIO: f64 = 15.5;
const WHEELBASE_M: f64 = 2.78;

impl SingleTrack {
    fn step(&mut self, hand_wheel_rad: f64, dt: f64) {
        let (m, inertia, a, b) = (1600.0, 2700.0, 1.25, WHEELBASE_M - 1.25);
        let (front, rear) = (90e3, 130e3);
        let v = self.seen.speed_m_s;
        let alpha_f = hand_wheel_rad / RATIO - (self.lateral_speed + a * self.yaw_rate) / v;
        let alpha_r = -(self.lateral_speed - b * self.yaw_rate) / v;
        let (fy, ry) = (front * alpha_f, rear * alpha_r);
        self.lateral_speed += ((fy + ry) / m - v * self.yaw_rate) * dt;
        self.yaw_rate += (a * fy - b * ry) / inertia * dt;
        self.seen.yaw_rad += self.yaw_rate * dt;
        let (sine, cosine) = self.seen.yaw_rad.sin_cos();
        self.seen.x_m += (v * cosine - self.lateral_speed * sine) * dt;
        self.seen.y_m += (v * sine + self.lateral_speed * cosine) * dt;
    }
}

fn following(name: &str) -> PathFollowing {
    let scenario = load::<Scenario>(name).unwrap_or_else(|problems| panic!("{problems}")).value;
    let Steer::Path(following) = scenario.steer else { panic!("{name} follows no path") };
    following
}

/// Drives for `seconds`; returns position, lateral error and hand-wheel angle at each millisecond.
fn drive(driver: &mut PathDriver, speed_m_s: f64, seconds: f64) -> Vec<(f64, f64, f64, f64)> {
    let mut car = SingleTrack::default();
    car.seen.speed_m_s = speed_m_s;
    (0..(seconds * 1e3) as usize)
        .map(|_| {
            let out = driver.step(&car.seen, 1e-3);
            car.step(out.wheel.value, 1e-3);
            (car.seen.x_m, car.seen.y_m, out.lateral_error_m, out.wheel.value)
        })
        .collect()
}

#[test]
fn the_circle_is_held_at_five_metres_per_second_squared_and_at_walking_pace() {
    for speed in [5.0, 20.0] {
        let mut driver = PathDriver::new(&following("steady_circle_r80"));
        let run = drive(&mut driver, speed, 500.0 / speed + 20.0);
        let (.., error, wheel) = *run.last().unwrap();
        assert!(error.abs() < 0.05, "{error} m beside the circle at {speed} m/s");
        // Neutral part of the hand-wheel angle plus understeer: L/R + K·ay, K from the model's axles.
        let k = 1600.0 / WHEELBASE_M * ((WHEELBASE_M - 1.25) / 90e3 - 1.25 / 130e3);
        let expected = RATIO * (WHEELBASE_M / 80.0 + k * speed * speed / 80.0);
        assert!((wheel / expected - 1.0).abs() < 0.01, "{wheel} rad, expected {expected}");
    }
}

#[test]
fn the_gates_of_iso_3888_1_are_passed_at_80_km_h() {
    // The shipped driver, who knows this car in the place of the saloon: neutral part L·i and characteristic
    // speed of the single-track model.
    let mut following = following("double_lane_change_80");
    following.expected_rad_m = RATIO * WHEELBASE_M;
    let understeer = 1600.0 / WHEELBASE_M * ((WHEELBASE_M - 1.25) / 90e3 - 1.25 / 130e3);
    following.characteristic_speed_km_h = 3.6 * (WHEELBASE_M / understeer).sqrt();
    let DriverPath::DoubleLaneChangeIso3888Part1 { straight_m, vehicle_width_m: b } = following.path else {
        panic!("another path");
    };
    let mut driver = PathDriver::new(&following);
    let run = drive(&mut driver, 80.0 / 3.6, 12.0);
    // Lanes with a common right edge, the middle one 3.5 m left of it: their middles.
    let gates = [
        (0.0, 15.0, 0.0, 1.1 * b + 0.25),
        (45.0, 70.0, 3.5 + 0.05 * b, 1.2 * b + 0.25),
        (95.0, 110.0, 0.1 * b, 1.3 * b + 0.25),
    ];
    for (from, to, middle, width) in gates {
        let room = 0.5 * (width - b);
        let inside = run.iter().filter(|(x, ..)| (straight_m + from..straight_m + to).contains(x));
        let worst = inside.map(|(_, y, ..)| (y - middle).abs()).fold(0.0, f64::max);
        assert!(worst < room, "gate at {from} m: {worst:.2} m off the middle, room {room:.2} m");
    }
    let (.., error, wheel) = *run.last().unwrap();
    assert!(error.abs() < 0.1 && wheel.abs() < 0.02, "not straight again: {error} m, {wheel} rad");
}

#[test]
fn a_restored_driver_goes_on_bit_for_bit() {
    let mut one = PathDriver::new(&following("steady_circle_r80"));
    drive(&mut one, 15.0, 3.0);
    let mut state = vec![0.0; one.state_len()];
    one.save_state(&mut state);
    let mut other = PathDriver::new(&following("steady_circle_r80"));
    other.load_state(&state);
    for i in 0..1000 {
        let seen = Observed { x_m: 45.0 + 0.015 * f64::from(i), y_m: 0.1, yaw_rad: 0.02, speed_m_s: 15.0 };
        assert_eq!(one.step(&seen, 1e-3), other.step(&seen, 1e-3));
    }
}

#[test]
fn what_is_not_finite_holds_the_wheel() {
    let mut driver = PathDriver::new(&following("steady_circle_r80"));
    drive(&mut driver, 15.0, 6.0);
    let before = driver.clone();
    let out = driver.step(&Observed { x_m: f64::NAN, ..Observed::default() }, 1e-3);
    assert!(out.held && out.wheel.value.is_finite());
    assert_eq!(driver, before);
}

#[test]
fn the_wheel_keeps_to_its_rate_and_angle() {
    let mut tight = following("double_lane_change_80");
    tight.rate_max_deg_s = 100.0;
    tight.angle_max_deg = 20.0;
    let run = drive(&mut PathDriver::new(&tight), 80.0 / 3.6, 12.0);
    let fastest = run.windows(2).map(|pair| (pair[1].3 - pair[0].3).abs() / 1e-3).fold(0.0, f64::max);
    assert!(fastest <= 100.0_f64.to_radians() + 1e-9);
    assert!(run.iter().all(|(.., wheel)| wheel.abs() <= 20.0_f64.to_radians() + 1e-12));
}

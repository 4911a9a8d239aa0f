//! Step size, determinism, checkpoints, maps.

use crate::support::*;
use std::f64::consts::TAU;
use vehicle::{Vehicle, VehicleInput};

/// Sine with dwell of the steering wheel, 0.7 Hz. [rad]
pub fn sine_with_dwell(t: f64, amplitude: f64) -> f64 {
    let (f, start) = (0.7, 0.5);
    let x = t - start;
    let peak = 0.75 / f;
    let x = if x > peak { (x - 0.5).max(peak) } else { x };
    if (0.0..=1.0 / f).contains(&x) { amplitude * (TAU * f * x).sin() } else { 0.0 }
}

fn manoeuvre(v: &mut Vehicle, name: &str) -> Vec<f64> {
    let step = v.step_s();
    let speed = if name == "on_centre" { 33.3 } else { 22.22 };
    let mut input = hold(speed);
    v.reset(speed, &input);
    let n = (6.0 / step).round() as usize;
    let sample = (0.01 / step).round() as usize;
    let mut out = Vec::new();
    for k in 0..n {
        let t = k as f64 * step;
        let at = t + step;
        input.time_s = t;
        input.steering_wheel_angle_rad = match name {
            "on_centre" => 0.25 * (TAU * 0.2 * at).sin(),
            "slalom" => 0.35 * at * (TAU * 0.3 * at).sin(),
            "dwell" => sine_with_dwell(at, 1.6),
            _ => 0.6 * ((at - 0.5) / 0.2).clamp(0.0, 1.0),
        };
        if name == "brake" && t > 1.5 {
            input.target_speed_m_s = None;
            input.brake_pressure_pa = 5e6;
        }
        v.step(&input);
        if (k + 1) % sample == 0 {
            out.push(v.output().lateral_acceleration_m_s2);
        }
    }
    out
}

#[test]
fn halving_the_step_changes_less_than_half_a_percent() {
    for name in ["on_centre", "slalom", "dwell", "step", "brake"] {
        let c = with_constants(car("sedan"));
        let coarse = manoeuvre(&mut build_with_step(&c, 1e-3), name);
        let fine = manoeuvre(&mut build_with_step(&c, 5e-4), name);
        let peak = fine.iter().fold(0.0f64, |m, v| m.max(v.abs()));
        let coarse_peak = coarse.iter().fold(0.0f64, |m, v| m.max(v.abs()));
        let apart = coarse.iter().zip(&fine).fold(0.0f64, |m, (a, b)| m.max((a - b).abs()));
        println!(
            "{name:10} peak {peak:.3} m/s2, changes by {:.3} %, histories apart by at most {:.3} %",
            100.0 * (coarse_peak / peak - 1.0),
            100.0 * apart / peak
        );
        assert!((coarse_peak / peak - 1.0).abs() < 0.005, "{name}: {coarse_peak} against {peak}");
    }
}

#[test]
fn resumes_from_a_checkpoint_bit_by_bit() {
    let c = with_constants(car("sedan"));
    let mut first = build(&c);
    let mut input = hold(25.0);
    first.reset(25.0, &input);
    let drive = |v: &mut Vehicle, input: &mut VehicleInput, n: usize| {
        input.time_s = 1e-3 * n as f64;
        input.steering_wheel_angle_rad = sine_with_dwell(input.time_s, 1.5);
        input.rack_displacement_m = (n > 2500).then_some(0.004);
        v.step(input);
    };
    for n in 0..2000 {
        drive(&mut first, &mut input, n);
    }
    let mut saved = vec![0.0; first.state_len()];
    first.save_state(&mut saved);
    assert!(saved.iter().all(|v| v.is_finite()), "a checkpoint must be finite to be checked");
    let mut second = build(&c);
    second.load_state(&saved);
    let mut again = vec![0.0; second.state_len()];
    second.save_state(&mut again);
    assert_eq!(saved, again, "loading changed the state");
    for n in 2000..4000 {
        let mut same = input;
        drive(&mut first, &mut input, n);
        drive(&mut second, &mut same, n);
        assert_eq!(first.output(), second.output(), "step {n}");
    }
}

#[test]
fn two_cars_with_one_input_are_equal() {
    let c = with_constants(car("sedan"));
    assert_eq!(manoeuvre(&mut build(&c), "dwell"), manoeuvre(&mut build(&c), "dwell"));
}

#[test]
fn starts_without_a_transient() {
    for (name, speed) in
        [("sedan", 5.0), ("sedan", 22.22), ("sedan", 60.0), ("bmw_320i", 30.0), ("vw_vanagon", 25.0)]
    {
        let mut v = build(&with_constants(car(name)));
        let mut input = hold(speed);
        v.reset(speed, &input);
        let start = *v.output();
        let mut worst = [0.0f64; 3];
        for n in 0..1000 {
            input.time_s = 1e-3 * f64::from(n);
            v.step(&input);
            let o = v.output();
            worst[0] = worst[0].max((o.horizontal_velocity_m_s[0] - speed).abs());
            worst[1] = worst[1]
                .max((0..4).map(|i| (o.wheels[i].fz_n - start.wheels[i].fz_n).abs()).fold(0.0, f64::max));
            worst[2] = worst[2].max(o.lateral_acceleration_m_s2.abs());
        }
        // The peers' tyre pulls a little to one side (RVY1 with the slip that drives).
        let pull = if name == "sedan" { 1e-6 } else { 0.01 };
        assert!(worst[0] < 0.02 && worst[1] < 5.0 && worst[2] < pull, "{name} at {speed} m/s: {worst:?}");
    }
}

#[test]
fn holds_the_last_good_input() {
    let c = with_constants(car("sedan"));
    let mut v = build(&c);
    let mut input = hold(20.0);
    v.reset(20.0, &input);
    v.step(&input);
    input.steering_wheel_angle_rad = f64::NAN;
    for _ in 0..100 {
        v.step(&input);
    }
    let o = v.output();
    assert_eq!(o.held_steps, 100);
    assert!(o.yaw_rate_rad_s.abs() < 1e-9 && o.position_m[0] > 1.0);
}

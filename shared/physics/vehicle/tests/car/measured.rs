//! Against a measured car: the BMW M8's double lane change of the roadview project (spec 3.3).
//!
//! Steering and speed are the input. Parameters as in the car file; its tyre scale factors were fitted on the first half
//! of the manoeuvre, the second half is the check; `KINGPIN_MEASURED_PLOT=m8.html` plots both. Hardpoints are not the car's
//! own, so constants stand in here.

use crate::support::*;
use config::car::SteeringSystem;
use vehicle::VehicleInput;

fn columns(text: &str, names: &[&str]) -> Vec<Vec<f64>> {
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().unwrap().split(',').collect();
    let at: Vec<usize> = names.iter().map(|n| header.iter().position(|h| h == n).unwrap()).collect();
    let mut out = vec![Vec::new(); names.len()];
    for line in lines {
        let cells: Vec<&str> = line.split(',').collect();
        for (o, i) in out.iter_mut().zip(&at) {
            o.push(cells[*i].parse().unwrap_or(f64::NAN));
        }
    }
    out
}

fn interpolate(x: &[f64], y: &[f64], at: f64) -> f64 {
    let k = x.partition_point(|v| *v <= at).clamp(1, x.len() - 1);
    let w = ((at - x[k - 1]) / (x[k] - x[k - 1]).max(1e-9)).clamp(0.0, 1.0);
    y[k - 1] + w * (y[k] - y[k - 1])
}

/// Mean over ±`half` seconds.
fn smooth(x: &[f64], y: &[f64], at: f64, half: f64) -> f64 {
    let (a, b) = (x.partition_point(|v| *v < at - half), x.partition_point(|v| *v <= at + half));
    if b > a { y[a..b].iter().sum::<f64>() / (b - a) as f64 } else { interpolate(x, y, at) }
}

/// A page with the three histories, model over measurement; the line parts the fitted half from the checked one.
fn plot(history: &[[f64; 7]]) -> String {
    let mut page = String::from(
        "<!DOCTYPE html><meta charset=\"utf-8\"><title>BMW M8, double lane change</title>\n\
         <h1>BMW M8, double lane change: model (red) over measurement (black)</h1>\n",
    );
    let (start, span) = (history[0][0], history[history.len() - 1][0] - history[0][0]);
    for (k, name) in [(1, "yaw rate [rad/s]"), (3, "lateral acceleration [m/s²]"), (5, "roll angle [rad]")] {
        let most = history.iter().fold(1e-9f64, |m, r| m.max(r[k].abs()).max(r[k + 1].abs()));
        page += &format!(
            "<h2>{name}, ±{most:.3}, {start:.1} to {:.1} s</h2><svg viewBox=\"0 0 900 260\" width=\"900\">",
            start + span
        );
        page += "<path d=\"M0 130H900\" stroke=\"#ccc\"/>";
        let parted = 900.0 * PARTED_S / span;
        page += &format!("<path d=\"M{parted:.1} 0V260\" stroke=\"#88f\" stroke-dasharray=\"4\"/>");
        for (column, colour) in [(k + 1, "black"), (k, "red")] {
            page += &format!("<polyline fill=\"none\" stroke=\"{colour}\" points=\"");
            for r in history {
                page +=
                    &format!("{:.1},{:.1} ", 900.0 * (r[0] - start) / span, 130.0 - 125.0 * r[column] / most);
            }
            page += "\"/>";
        }
        page += "</svg>\n";
    }
    page
}

/// A run of the car by the measured steering and speed.
struct Run {
    /// Time, then found and measured of yaw rate, lateral acceleration, roll; every 10 ms.
    history: Vec<[f64; 7]>,
    /// Sums of squared differences over the two halves, every step; and their numbers.
    squares: [[f64; 3]; 2],
    counts: [f64; 2],
    /// Of the measured signals.
    peaks: [f64; 3],
}

/// The part of the record that is driven: 4 s to fit on, 3 s to check on. [s]
const START_S: f64 = 8.5;
const PARTED_S: f64 = 4.0;
const LENGTH_S: f64 = 7.0;

fn run(step_s: f64) -> Option<Run> {
    let folder = "measured/bmw_m8_roadview";
    let bus = reference(&format!("{folder}/double_lane_change_car_bus.csv"))?;
    let inputs = reference(&format!("{folder}/double_lane_change_inputs_200Hz.csv"))?;
    let bus = columns(&bus, &["car_time", "Velocity_X", "Yaw_Velocity", "Acceleration_Y", "Roll"]);
    let steer = columns(&inputs, &["time", "steering"]);
    let mut section = with_constants(car("bmw_m8"));
    if let SteeringSystem::Kinematic { rack_per_steering_wheel_m_rad, .. } = &mut section.steering {
        // The constants' own ratio, so that 14.3 hand-wheel radians make one of road wheel.
        *rack_per_steering_wheel_m_rad = -1.0 / (14.3 * 7.3);
    }
    let mut v = build_with_step(&section, step_s);
    let speed = |t: f64| smooth(&bus[0], &bus[1], t, 0.1);
    let mut input = VehicleInput { target_speed_m_s: Some(speed(START_S)), ..VehicleInput::default() };
    let straight = smooth(&steer[0], &steer[1], START_S, 0.4);
    let zero = smooth(&bus[0], &bus[4], START_S, 0.4);
    v.reset(speed(START_S), &input);
    let mut run = Run { history: Vec::new(), squares: [[0.0; 3]; 2], counts: [0.0; 2], peaks: [0.0; 3] };
    let each = (0.01 / step_s).round() as usize;
    for n in 0..(LENGTH_S / step_s).round() as usize {
        let since = step_s * n as f64;
        let t = START_S + since;
        input.time_s = since;
        input.target_speed_m_s = Some(speed(t));
        input.steering_wheel_angle_rad = 20.0 * (interpolate(&steer[0], &steer[1], t) - straight);
        v.step(&input);
        let o = v.output();
        let found = [o.yaw_rate_rad_s, o.lateral_acceleration_m_s2, o.roll_rad];
        let measured = [
            smooth(&bus[0], &bus[2], t, 0.01),
            smooth(&bus[0], &bus[3], t, 0.05),
            smooth(&bus[0], &bus[4], t, 0.05) - zero,
        ];
        if n % each == 0 {
            run.history.push([t, found[0], measured[0], found[1], measured[1], found[2], measured[2]]);
        }
        let half = usize::from(since >= PARTED_S);
        run.counts[half] += 1.0;
        for k in 0..3 {
            run.squares[half][k] += (found[k] - measured[k]).powi(2);
            run.peaks[k] = run.peaks[k].max(measured[k].abs());
        }
    }
    Some(run)
}

#[test]
fn double_lane_change_of_a_real_car() {
    let Some(run) = run(1e-3) else { return };
    if let Ok(path) = std::env::var("KINGPIN_MEASURED_PLOT") {
        std::fs::write(&path, plot(&run.history)).unwrap();
        println!("plotted to {path}");
    }
    for (half, name) in [(0, "first half (fitted)"), (1, "second half (checked)")] {
        let rms: Vec<f64> =
            (0..3).map(|k| (run.squares[half][k] / run.counts[half]).sqrt() / run.peaks[k]).collect();
        println!(
            "{name}: rms of the peak: yaw rate {:.1} %, lateral acceleration {:.1} %, roll {:.1} %",
            100.0 * rms[0],
            100.0 * rms[1],
            100.0 * rms[2]
        );
        assert!(rms[0] < 0.085 && rms[1] < 0.07, "{name}: {rms:?}");
    }
}

#[test]
fn halving_the_step_in_the_measured_lane_change() {
    let (Some(coarse), Some(fine)) = (run(1e-3), run(5e-4)) else { return };
    let peak = |run: &Run| run.history.iter().fold(0.0f64, |m, row| m.max(row[3].abs()));
    let change = 100.0 * (peak(&coarse) / peak(&fine) - 1.0);
    println!("peak {:.3} m/s2 at 0.5 ms, {change:+.3} % at 1 ms", peak(&fine));
    assert!(change.abs() < 0.5, "{change:+.3} %");
}

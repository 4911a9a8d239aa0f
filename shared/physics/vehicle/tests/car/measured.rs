//! Against a measured car: the BMW M8's double lane change of the roadview project (spec 3.3).
//!
//! Steering and speed are the input. Parameters as in the car file; its tyre scale factors were fitted on the first half
//! of the manoeuvre, the second half is the check; `KINGPIN_MEASURED_PLOT=m8.html` plots both. Hardpoints are not the car's own, so constants stand in here.

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
        let parted = 900.0 * 4.0 / span;
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

#[test]
fn double_lane_change_of_a_real_car() {
    let folder = "measured/bmw_m8_roadview";
    let (Some(bus), Some(inputs)) = (
        reference(&format!("{folder}/double_lane_change_car_bus.csv")),
        reference(&format!("{folder}/double_lane_change_inputs_200Hz.csv")),
    ) else {
        return;
    };
    let bus = columns(&bus, &["car_time", "Velocity_X", "Yaw_Velocity", "Acceleration_Y", "Roll"]);
    let steer = columns(&inputs, &["time", "steering"]);
    let mut section = with_constants(car("bmw_m8"));
    if let SteeringSystem::Kinematic { rack_per_steering_wheel_m_rad, .. } = &mut section.steering {
        // The constants' own ratio, so that 14.3 hand-wheel radians make one of road wheel.
        *rack_per_steering_wheel_m_rad = -1.0 / (14.3 * 7.3);
    }
    let (f, r) = (tyre("bmw_m8_front.tir"), tyre("bmw_m8_rear.tir"));
    let mut v = vehicle::Vehicle::new(&section, maps(&section), [f.clone(), f, r.clone(), r], 1e-3).unwrap();
    let start = 8.5;
    let speed = |t: f64| smooth(&bus[0], &bus[1], t, 0.1);
    let mut input = VehicleInput { target_speed_m_s: Some(speed(start)), ..VehicleInput::default() };
    let straight = smooth(&steer[0], &steer[1], start, 0.4);
    let zero = smooth(&bus[0], &bus[4], start, 0.4);
    v.reset(speed(start), &input);
    let mut halves = [[0.0; 3]; 2];
    let mut counts = [0.0; 2];
    let mut peaks = [0.0f64; 3];
    let mut history: Vec<[f64; 7]> = Vec::new();
    for n in 0..7000 {
        let t = start + 1e-3 * f64::from(n);
        input.time_s = 1e-3 * f64::from(n);
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
        if n % 10 == 0 {
            history.push([t, found[0], measured[0], found[1], measured[1], found[2], measured[2]]);
        }
        let half = usize::from(n >= 4000);
        counts[half] += 1.0;
        for k in 0..3 {
            halves[half][k] += (found[k] - measured[k]).powi(2);
            peaks[k] = peaks[k].max(measured[k].abs());
        }
        if std::env::var("KINGPIN_MEASURED").is_ok() && n % 200 == 0 {
            println!(
                "{t:.1} sw {:.3} yaw rate {:.3} {:.3}  ay {:.2} {:.2}  roll {:.4} {:.4}",
                input.steering_wheel_angle_rad,
                found[0],
                measured[0],
                found[1],
                measured[1],
                found[2],
                measured[2]
            );
        }
    }
    if let Ok(path) = std::env::var("KINGPIN_MEASURED_PLOT") {
        std::fs::write(&path, plot(&history)).unwrap();
        println!("plotted to {path}");
    }
    for (half, name) in [(0, "first half (fitted)"), (1, "second half (checked)")] {
        let rms: Vec<f64> = (0..3).map(|k| (halves[half][k] / counts[half]).sqrt() / peaks[k]).collect();
        println!(
            "{name}: rms of the peak: yaw rate {:.1} %, lateral acceleration {:.1} %, roll {:.1} %",
            100.0 * rms[0],
            100.0 * rms[1],
            100.0 * rms[2]
        );
        assert!(rms[0] < 0.085 && rms[1] < 0.07, "{name}: {rms:?}");
    }
}

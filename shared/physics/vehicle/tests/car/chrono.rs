//! Against Project Chrono's multibody cars (BMW E90, sedan) on cars of ours matched to them; what was taken from their
//! parameters and what was identified from one record of each (the middle step) stands in the car files.
//!
//! Their lateral acceleration is noisy: here speed times yaw rate plus the rate of lateral speed, of both, over
//! 0.1 s. Bound of the issue: 8 %, rms over peak, below 0.6 g. Named differences: kinematics as constants (their bump
//! steer curves, ours does not), TMeasy and Chrono's own combined slip, an engine with automatic gearbox against a
//! wheel torque.

use crate::peers::{Table, run};
use crate::support::*;

/// Lateral acceleration from the motion. [m/s2]
fn lateral(t: &Table) -> Vec<f64> {
    let (time, vx, vy, yaw) =
        (t.column("t_s"), t.column("v_x_mps"), t.column("v_y_mps"), t.column("yawrate_rps"));
    (0..time.len())
        .map(|n| {
            let (a, b) = (n.saturating_sub(5), (n + 5).min(time.len() - 1));
            vx[n] * yaw[n] + (vy[b] - vy[a]) / (time[b] - time[a])
        })
        .collect()
}

fn compare(name: &str, model: &str, file: &str) -> Option<[f64; 4]> {
    let theirs = Table::read(&reference(&format!("vehicle/chrono_{model}_{file}.csv"))?);
    let section = car(name);
    let mut v = build(&section);
    let ours = run(&mut v, &theirs, "rack_disp_m");
    let time = theirs.column("t_s");
    let (a, b) = (lateral(&ours), lateral(&theirs));
    // Their runs begin with a settling of speed and pitch; ours on the circle in a straight line.
    let from = if file.starts_with("circle") { 10.0 } else { 0.3 };
    let first = time.iter().position(|t| *t >= from).unwrap();
    let end = b.iter().skip(first).position(|a| a.abs() > 0.6 * 9.81).map_or(time.len(), |k| first + k);
    let rms = |a: &[f64], b: &[f64]| {
        let sum: f64 = (first..end).map(|n| (a[n] - b[n]).powi(2)).sum();
        (sum / (end - first) as f64).sqrt()
    };
    let peak = |b: &[f64]| b[first..end].iter().fold(0.0f64, |m, x| m.max(x.abs()));
    let mut e = [rms(&a, &b) / peak(&b), 0.0, 0.0, 0.0];
    for (k, column) in [(1, "yawrate_rps"), (2, "roll_rad")] {
        let (a, b) = (ours.column(column), theirs.column(column));
        e[k] = rms(&a, &b) / peak(&b);
    }
    for wheel in ["fl", "fr", "rl", "rr"] {
        let (a, b) = (ours.column(&format!("Fz_N_{wheel}")), theirs.column(&format!("Fz_N_{wheel}")));
        e[3] += 0.25 * (rms(&a, &b) / b[first]).powi(2);
    }
    e[3] = e[3].sqrt();
    let last = end - 1;
    let pair = |c: &str| (ours.column(c)[last], theirs.column(c)[last]);
    println!(
        "{model:12} {file:22} to {:5.2} s  ay {:5.2} %  yaw rate {:5.2} %  roll {:5.2} %  loads {:5.2} %   at its end yaw rate {:.4?} roll {:.4?} v_y {:.3?}",
        time[last],
        100.0 * e[0],
        100.0 * e[1],
        100.0 * e[2],
        100.0 * e[3],
        pair("yawrate_rps"),
        pair("roll_rad"),
        pair("v_y_mps"),
    );
    Some(e)
}

#[test]
fn chrono_cars_within_eight_percent() {
    let mut broken = Vec::new();
    for (name, model) in [("chrono_e90", "bmw_e90"), ("chrono_sedan", "sedan_pac02")] {
        for file in [
            "step_steer_80_lin",
            "step_steer_80_mid",
            "step_steer_80_limit",
            "slalom_0p3Hz_grow_80",
            "swd_0p7Hz_80_a0p10",
            "swd_0p7Hz_80_a0p22",
            "circle_R80",
        ] {
            let Some(e) = compare(name, model, file) else { continue };
            if !e.iter().all(|x| *x <= 0.08) {
                broken.push(format!("{model} {file}: {e:.4?}"));
            }
        }
    }
    assert!(broken.is_empty(), "{broken:#?}");
}

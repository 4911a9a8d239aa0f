//! Against Project Chrono's multibody cars (BMW E90, sedan) on cars of ours matched to them; what was taken from their
//! parameters and what was identified from one record of each (the middle step) stands in the car files.
//!
//! Their lateral acceleration is noisy: here speed times yaw rate plus the rate of lateral speed, of both, over
//! 0.1 s. Bound of the issue: 8 %, rms over peak, below 0.6 g. Named differences: kinematics as constants (their bump
//! steer curves, ours does not), TMeasy and Chrono's own combined slip, an engine with automatic gearbox against a
//! wheel torque.

use crate::peers::{Table, run};
use crate::support::*;
use config::car::Car;
use vehicle::Vehicle;

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
    Some(differences(&mut build(&car(name)), &theirs, model, file, true))
}

fn differences(v: &mut Vehicle, theirs: &Table, model: &str, file: &str, print: bool) -> [f64; 4] {
    let ours = run(v, theirs, "rack_disp_m");
    let time = theirs.column("t_s");
    let (a, b) = (lateral(&ours), lateral(theirs));
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
    if !print {
        return e;
    }
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
    e
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

/// Cornering stiffness, grip, springs in front and behind, dampers as multiples of a car file's.
type Factors = [f64; 5];

fn with_factors(section: &Car, tyre: &str, f: &Factors) -> Vehicle {
    let mut c = section.clone();
    for (axle, spring) in [(&mut c.front, f[2]), (&mut c.rear, f[3])] {
        axle.spring.force_n.iter_mut().for_each(|force| *force *= spring);
        axle.damper.force_n.iter_mut().for_each(|force| *force *= f[4]);
    }
    let own = |key: &str| {
        let line = tyre.lines().find(|l| l.split('=').next().unwrap().trim() == key).unwrap();
        line.split('=').nth(1).unwrap().split('$').next().unwrap().trim().parse::<f64>().unwrap()
    };
    build_on(&c, &with_keys(tyre, &[("PKY1", f[0] * own("PKY1")), ("PDY1", f[1] * own("PDY1"))]))
}

/// The car files were tuned with all records in view. Here is what independence they have: what was tuned (tyre's cornering
/// stiffness and grip, springs, dampers) is put wrong, fitted again to one step and one sine with dwell alone, and
/// checked on the five records the fit has not seen.
#[test]
fn fitted_to_two_records_and_checked_on_the_other_five() {
    let fitted = ["step_steer_80_mid", "swd_0p7Hz_80_a0p10"];
    let checked = [
        "step_steer_80_lin",
        "step_steer_80_limit",
        "slalom_0p3Hz_grow_80",
        "swd_0p7Hz_80_a0p22",
        "circle_R80",
    ];
    let mut broken = Vec::new();
    for (name, model) in [("chrono_e90", "bmw_e90"), ("chrono_sedan", "sedan_pac02")] {
        let read = |file: &str| Some(Table::read(&reference(&format!("vehicle/chrono_{model}_{file}.csv"))?));
        let Some(seen) = fitted.iter().map(|f| read(f)).collect::<Option<Vec<Table>>>() else { return };
        let section = car(name);
        let tyre = tyre_text(&section.front.tyre_file);
        let cost = |f: &Factors| -> f64 {
            let of = |theirs: &Table| {
                let e = differences(&mut with_factors(&section, &tyre, f), theirs, model, "", false);
                e.iter().map(|x| x * x).sum::<f64>()
            };
            seen.iter().map(of).sum()
        };
        let mut best: Factors = [0.8, 1.15, 1.3, 0.75, 1.4];
        let mut least = cost(&best);
        println!("{model}: put wrong {best:?}, cost {least:.4}");
        // Coordinate search with halved steps: bounded, and the same every time.
        let mut step = 0.16;
        while step > 0.015 {
            let mut better = false;
            for k in 0..best.len() {
                for factor in [1.0 + step, 1.0 / (1.0 + step)] {
                    let mut tried = best;
                    tried[k] = (tried[k] * factor).clamp(0.4, 2.5);
                    let c = cost(&tried);
                    if c < least {
                        (best, least, better) = (tried, c, true);
                        break;
                    }
                }
            }
            if !better {
                step *= 0.5;
            }
        }
        println!("{model}: fitted to {fitted:?}: factors {best:.2?}, cost {least:.5}");
        for file in fitted.iter().chain(&checked) {
            let Some(theirs) = read(file) else { return };
            let e = differences(&mut with_factors(&section, &tyre, &best), &theirs, model, file, true);
            if checked.contains(file) && !e.iter().all(|x| *x <= 0.08) {
                broken.push(format!("{model} {file}: {e:.4?}"));
            }
        }
    }
    assert!(broken.is_empty(), "{broken:#?}");
}

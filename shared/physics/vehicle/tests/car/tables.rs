//! Runs from tables, named variables.

use crate::support::*;
use vehicle::{Exports, ImportMode, Imports, simulate_csv};

#[test]
fn a_table_drives_the_car() {
    let mut v = build(&car("bmw_320i"));
    let mut input = String::from("t_s,delta_road_rad,target_speed_mps\n");
    for n in 0..=400 {
        let t = 0.01 * f64::from(n);
        let steer = 0.02 * ((t - 1.0) / 0.2).clamp(0.0, 1.0);
        input.push_str(&format!("{t},{steer},22.2\n"));
    }
    let out = simulate_csv(&mut v, &input).unwrap();
    let lines: Vec<&str> = out.lines().collect();
    assert_eq!(lines.len(), 402);
    let header: Vec<&str> = lines[0].split(',').collect();
    let get = |line: &str, name: &str| -> f64 {
        line.split(',').nth(header.iter().position(|h| *h == name).unwrap()).unwrap().parse().unwrap()
    };
    assert!(lines[1..].iter().all(|l| l.split(',').count() == header.len()));
    assert_eq!(get(lines[1], "t_s"), 0.0);
    assert!(get(lines[100], "yawrate_rps").abs() < 1e-3, "turns before it is steered");
    let last = lines[401];
    // The rack is set for the angle at design; travel changes it a little.
    assert!((get(last, "delta_road_rad") - 0.02).abs() < 2e-4);
    assert!((0.14..0.2).contains(&get(last, "yawrate_rps")), "{}", get(last, "yawrate_rps"));
    assert!(get(last, "Fz_N_fr") > get(last, "Fz_N_fl") + 1000.0, "the load goes to the outside");
    assert!(get(last, "alpha_rad_fl") < 0.0 && get(last, "roll_rad") > 0.03);
}

#[test]
fn a_broken_table_tells_everything_at_once() {
    let mut v = build(&car("bmw_320i"));
    let rules = |text: &str, v: &mut vehicle::Vehicle| -> Vec<String> {
        simulate_csv(v, text).unwrap_err().iter().map(ToString::to_string).collect()
    };
    let missing = rules("time,steer\n0,0\n", &mut v);
    assert_eq!(missing.len(), 3, "{missing:?}");
    let cells = rules("t_s,rack_disp_m,throttle,brake_pa\n0,0,0,0\n0.1,x,0,0\n0.05,0,nan,0\n", &mut v);
    assert_eq!(cells.len(), 3, "{cells:?}");
    assert!(cells[0].contains("line 3") && cells[0].contains("rack_disp_m = x"), "{cells:?}");
    assert_eq!(rules("t_s,rack_disp_m,target_speed_mps\n0,0,0\n", &mut v).len(), 1);
}

#[test]
fn imports_reach_into_the_step() {
    let c = car("bmw_320i");
    let mut v = build(&c);
    let input = hold(20.0);
    v.reset(20.0, &input);
    // A side force of 1000 N on the body.
    let push = Imports::find("external_force_y_n").unwrap();
    v.imports_mut().set(push, ImportMode::Add, 1000.0);
    v.step(&input);
    let expected = 1000.0 / v.mass_kg();
    let found = v.output().lateral_acceleration_cg_m_s2;
    assert!((found / expected - 1.0).abs() < 0.1, "{found} against {expected}");
    v.imports_mut().clear(push);
    // A measured rack by REPLACE, as by input.
    v.reset(20.0, &input);
    let rack = Imports::find("rack_displacement_m").unwrap();
    v.imports_mut().set(rack, ImportMode::Replace, 0.002);
    let mut other = build(&c);
    other.reset(20.0, &input);
    let steered = vehicle::VehicleInput { rack_displacement_m: Some(0.002), ..input };
    for _ in 0..1000 {
        v.step(&input);
        other.step(&steered);
    }
    let yaw = Exports::find("yaw_rate_rad_s").unwrap();
    assert_eq!(Exports::get(yaw, v.output()), Exports::get(yaw, other.output()));
    assert!(Exports::get(yaw, v.output()) > 0.05);
    // Half the lateral force on one wheel.
    let before = v.output().wheels[1].fy_n;
    let fy = Imports::find("tyre_fy_n_fr").unwrap();
    v.imports_mut().set(fy, ImportMode::Multiply, 0.5);
    v.step(&input);
    assert!((v.output().wheels[1].fy_n / before - 0.5).abs() < 0.05);
}

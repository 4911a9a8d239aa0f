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
    let out = simulate_csv(&mut v, &input, "in.csv").unwrap();
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
        simulate_csv(v, text, "in.csv").unwrap_err().violations.iter().map(ToString::to_string).collect()
    };
    let missing = rules("time,steer\n0,0\n", &mut v);
    assert_eq!(missing, ["in.csv:1: t_s: column is missing"]);
    assert_eq!(rules("t_s\n0\n1\n", &mut v).len(), 2);
    let outside = rules("t_s,rack_disp_m,throttle,brake_pa\n0,0,2,0\n0,0,0,-1\n", &mut v);
    assert_eq!(outside.len(), 3, "{outside:?}");
    let cells = rules("t_s,rack_disp_m,throttle,brake_pa\n0,0,0,0\n0.1,x,0,0\n0.05,0,nan,0\n", &mut v);
    assert_eq!(cells.len(), 2, "{cells:?}");
    assert!(cells[0].contains("in.csv:3") && cells[0].contains("rack_disp_m = x"), "{cells:?}");
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

fn equations(text: &str) -> config::equations::Equations {
    toml::from_str(text).unwrap_or_else(|e| panic!("{e}"))
}

#[test]
fn equations_are_imports_and_outputs() {
    let c = car("bmw_320i");
    let input = hold(20.0);
    let mut v = build(&c);
    v.set_equations(&equations(
        r#"
        variables = [
            { name = "push", unit = "kN", expression = "if(time_s >= 0.1 s, 1 kN, 0)" },
            # An integrator: its own last value.
            { name = "impulse", unit = "N*s", start = 0.5, expression = "impulse + push * step_s" },
        ]
        imports = [
            { variable = "external_force_y_n", mode = "add", expression = "push" },
            { variable = "tyre_fy_n_fl", mode = "multiply", expression = "0" },
        ]
        outputs = [
            { name = "axle_load", unit = "kN", expression = "fz_n_fl + fz_n_fr" },
            { name = "pushed", unit = "N*s", expression = "impulse" },
            { name = "difference", unit = "N", expression = "fz_n_fr - fz_n_fl" },
            { name = "twice", unit = "N", expression = "2 * difference" },
            { name = "roll", unit = "deg", expression = "roll_rad" },
        ]"#,
    ))
    .unwrap();
    v.reset(20.0, &input);
    let loads = |v: &vehicle::Vehicle| (v.output().wheels[0].fz_n, v.output().wheels[1].fz_n);
    let mut plain = build(&c);
    plain.reset(20.0, &input);
    for n in 0..300 {
        let now = vehicle::VehicleInput { time_s: 1e-3 * f64::from(n), ..input };
        v.step(&now);
        // The same by hand.
        let set = |v: &mut vehicle::Vehicle, name: &str, mode, value| {
            v.imports_mut().set(Imports::find(name).unwrap(), mode, value);
        };
        let push = if n >= 100 { 1000.0 } else { 0.0 };
        set(&mut plain, "external_force_y_n", ImportMode::Add, push);
        set(&mut plain, "tyre_fy_n_fl", ImportMode::Multiply, 0.0);
        plain.step(&now);
        assert_eq!(v.output(), plain.output(), "step {n}");
        let (fl, fr) = loads(&v);
        let out = v.equations().unwrap().values();
        assert!((out[0] - 1e-3 * (fl + fr)).abs() < 1e-9 && (out[3] - 2.0 * (fr - fl)).abs() < 1e-9);
        let steps = f64::from((n - 99).max(0));
        assert!((out[1] - 0.5 - steps).abs() < 1e-9, "{} after {steps} steps", out[1]);
        assert!((out[4] - v.output().roll_rad.to_degrees()).abs() < 1e-12);
    }
    // The force and not the moment: this car's tyre has no aligning moment.
    assert!(v.output().wheels[0].fy_n == 0.0 && v.output().wheels[1].fy_n != 0.0);
    assert!(v.output().yaw_rad != 0.0);
}

#[test]
fn equations_go_on_with_the_same_bits_after_a_checkpoint() {
    let text = r#"
        variables = [
            { name = "slow", unit = "m/s^2", start = 0, expression = "slow + (lateral_acceleration_m_s2 - slow) * 0.02" },
        ]
        imports = [{ variable = "steering_wheel_angle_rad", mode = "add", expression = "0.05 - slow * 0.002 s^2/m" }]
        outputs = [{ name = "filtered", unit = "m/s^2", expression = "slow" }]"#;
    let c = car("bmw_320i");
    let input = hold(25.0);
    let mut v = build(&c);
    v.set_equations(&equations(text)).unwrap();
    v.reset(25.0, &input);
    let mut other = v.clone();
    for n in 0..700 {
        v.step(&vehicle::VehicleInput { time_s: 1e-3 * f64::from(n), ..input });
        if n == 350 {
            let mut state = vec![0.0; v.state_len()];
            v.save_state(&mut state);
            other.load_state(&state);
        } else if n > 350 {
            other.step(&vehicle::VehicleInput { time_s: 1e-3 * f64::from(n), ..input });
            assert_eq!(v.output(), other.output(), "step {n}");
            assert_eq!(v.equations().unwrap().values(), other.equations().unwrap().values());
        }
    }
    assert!(v.equations().unwrap().values()[0].abs() > 0.1);
}

#[test]
fn results_that_are_not_finite_are_held_and_counted() {
    let mut v = build(&car("bmw_320i"));
    v.set_equations(&equations(
        r#"
        imports = [{ variable = "throttle", mode = "replace", expression = "if(time_s < 0.01 s, 0.3, ln(-1 - time_s / 1 s))" }]
        outputs = [{ name = "bad", unit = "s", expression = "1 s^2 / min(time_s, 0 s)" }]"#,
    ))
    .unwrap();
    let input = vehicle::VehicleInput::default();
    v.reset(10.0, &input);
    let before = v.equations().unwrap().faults();
    for n in 0..50 {
        v.step(&vehicle::VehicleInput { time_s: 1e-3 * f64::from(n), ..input });
    }
    assert_eq!(v.output().throttle, 0.3);
    assert_eq!(v.equations().unwrap().values(), [0.0]);
    assert_eq!(v.equations().unwrap().faults() - before, 50 + 40);
}

#[test]
fn what_is_wrong_with_equations_is_told_by_key() {
    let mut v = build(&car("bmw_320i"));
    let broken = v
        .set_equations(&equations(
            r#"
        variables = [
            { name = "roll_rad", unit = "rad", expression = "1" },
            { name = "a", unit = "N", expression = "a + 1 N" },
            { name = "b", unit = "furlong", expression = "1 m" },
        ]
        imports = [
            { variable = "tyre_fy_n_xx", mode = "add", expression = "1 N" },
            { variable = "yaw_rate_rad_s", mode = "replace", expression = "1 rad/s" },
            { variable = "throttle", mode = "multiply", expression = "3 N" },
        ]
        outputs = [{ name = "c", unit = "N", expression = "fz_n_fll * 2" }]"#,
        ))
        .unwrap_err();
    let told: Vec<String> = broken.iter().map(|b| format!("{}: {}", b.key, b.rule)).collect();
    let has = |start: &str, part: &str| {
        assert!(told.iter().any(|t| t.starts_with(start) && t.contains(part)), "{start} {part} in {told:#?}");
    };
    has("variables[0].name", "must not be a name that the car");
    has("variables[2].unit", "furlong");
    has("imports[0].variable", "did you mean `tyre_fy_n_");
    has("imports[1].variable", "can be read but not imported");
    has("imports[2].expression", "must give 1, gives N");
    has("outputs[0].expression", "did you mean 'fz_n_fl'");
    let broken = v
        .set_equations(&equations(r#"variables = [{ name = "a", unit = "N", expression = "a + 1 N" }]"#))
        .unwrap_err();
    assert_eq!(broken[0].key, "variables[0].start");
}

#[test]
fn every_variable_has_a_unit_that_expressions_know() {
    for v in Exports::variables().into_iter().chain(Imports::variables()) {
        assert!(functional_model::si_per_unit(v.unit) == Some(1.0), "{} [{}]", v.name, v.unit);
        assert!(!v.description.is_empty(), "{}", v.name);
    }
}

//! The standards' procedures on the bench's own runs: conditions reached, figures that agree with each other, withheld
//! where they must be.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use kingpin_tests::support::kingpin;
use serde_json::Value;
use std::process::Command;

/// Runs a procedure; the exit code and its JSON.
fn procedure(name: &str, arguments: &[&str]) -> (i32, Value) {
    let folder = tempfile::tempdir().unwrap();
    let done = Command::new(kingpin())
        .args(["procedure", name, "--json", "--no-report", "--out"])
        .arg(folder.path().join("out"))
        .args(arguments)
        .args(["--name", &format!("procedure-{name}-{}", std::process::id())])
        .env("KINGPIN_RUNTIME_DIR", folder.path().join("runtime"))
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&done.stdout).into_owned();
    let said = String::from_utf8_lossy(&done.stderr).into_owned();
    if done.status.code() != Some(2) {
        assert!(folder.path().join("out/procedure.html").is_file(), "{said}{text}");
    }
    (done.status.code().unwrap(), serde_json::from_str(&text).unwrap_or_else(|e| panic!("{e}: {text}{said}")))
}

fn figure(result: &Value, run: usize, name: &str) -> Option<f64> {
    let figures = result["runs"][run]["assessment"]["figures"].as_array().unwrap();
    figures.iter().find(|f| f["name"] == name).unwrap_or_else(|| panic!("{name}: {figures:?}"))["value"]
        .as_f64()
}

#[test]
fn the_weave_reaches_its_lateral_acceleration_and_its_figures_hang_together() {
    let (code, result) = procedure("weave", &[]);
    assert_eq!(code, 0, "{result:#}");
    let of = |name: &str| figure(&result, 0, name).unwrap();
    // Stiffness times sensitivity is the torque gradient, for a loop that is narrow against its length.
    let chain = of("steering stiffness at 0°") * 100.0 / of("steering sensitivity at 0 g");
    let direct = of("torque gradient at 0 g");
    assert!(chain > 0.0 && direct > 0.0 && (0.3..3.0).contains(&(chain / direct)), "{chain} {direct}");
    assert!(of("friction torque (at 0°)") > 0.1 && of("friction torque (at 0°)") < 5.0);
}

#[test]
fn the_weave_at_another_speed_is_withheld_with_the_reason() {
    let (code, result) = procedure(
        "weave",
        &["--as-is", "--set", "speed.speed_km_h=80", "--set", "duration_s=30", "--set", "steer.cycles=4"],
    );
    assert_eq!(code, 1);
    assert_eq!(result["valid"], false);
    for figure in result["runs"][0]["assessment"]["figures"].as_array().unwrap() {
        assert!(figure["value"].is_null());
        assert!(figure["withheld"].as_str().unwrap().contains("mean speed"), "{figure}");
    }
}

#[test]
fn both_ways_round_give_one_understeer_gradient() {
    let gradient = |name: &str| {
        let (code, result) = procedure(name, &[]);
        assert_eq!(code, 0, "{result:#}");
        figure(&result, 0, "understeer gradient, 1 to 4 m/s²").unwrap()
    };
    let (radius, speed) = (gradient("steady-circle"), gradient("steady-speed"));
    // Not the same: the drive force at the front differs between the two.
    assert!((radius / speed - 1.0).abs() < 0.15, "{radius} {speed}");
}

#[test]
fn the_step_and_the_random_input_see_the_same_car() {
    let (code, step) = procedure("step", &[]);
    assert_eq!(code, 0, "{step:#}");
    let (code, random) = procedure("random", &[]);
    assert_eq!(code, 0, "{random:#}");
    let (a, b) = (
        figure(&step, 0, "steady yaw rate gain").unwrap(),
        figure(&random, 0, "yaw rate gain at 0.2 Hz").unwrap(),
    );
    assert!((a / b - 1.0).abs() < 0.1, "{a} {b}");
}

#[test]
fn lane_changes_are_driven_between_the_cones_and_faster_they_are_not() {
    for name in ["lane-change", "obstacle-avoidance"] {
        let (code, result) = procedure(name, &[]);
        assert_eq!(code, 0, "{name}: {result:#}");
    }
    let (code, result) = procedure("obstacle-avoidance", &["--set", "speed.speed_km_h=75"]);
    assert_eq!(code, 1);
    assert_eq!(result["runs"][0]["assessment"]["rulings"][0]["kept"], false, "{result:#}");
}

#[test]
fn a_car_without_stability_control_keeps_the_rule_at_small_amplitude_and_breaks_it_at_large() {
    let (code, result) = procedure("sine-with-dwell", &["--factor", "2", "--factor", "5.5"]);
    assert_eq!(code, 1);
    let ratio = |run: usize| figure(&result, run, "yaw rate ratio 1.00 s after completion").unwrap();
    assert!(ratio(0).abs() < 10.0 && ratio(1) > 35.0, "{result:#}");
    let displacement = figure(&result, 1, "lateral displacement 1.07 s after the beginning").unwrap();
    assert!((1.83..6.0).contains(&displacement), "{displacement}");
}

#[test]
fn a_log_of_another_manoeuvre_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let call = |arguments: &[&str]| {
        Command::new(kingpin())
            .args(arguments)
            .current_dir(folder.path())
            .env("KINGPIN_RUNTIME_DIR", folder.path().join("runtime"))
            .output()
            .unwrap()
    };
    let name = format!("procedure-log-{}", std::process::id());
    let run = call(&["run", "step_100", "--lockstep", "--no-report", "--out", "run", "--name", &name]);
    assert!(run.status.success());
    let wrong = call(&["procedure", "weave", "--log", "run"]);
    assert_eq!(wrong.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&wrong.stderr).contains("step_100 does not steer as weave needs it"));
    let right = call(&["procedure", "step", "--log", "run", "--json"]);
    let result: Value = serde_json::from_slice(&right.stdout).unwrap();
    assert!(figure(&result, 0, "yaw rate response time").unwrap() > 0.02, "{result:#}");
}

//! The command line as a user meets it: bad input, exit codes, nothing half-written; list, schema, completions.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use kingpin_tests::support::kingpin;
use std::path::Path;
use std::process::{Command, Output};

fn call(arguments: &[&str], folder: &Path) -> Output {
    Command::new(kingpin())
        .args(arguments)
        .current_dir(folder)
        .env("KINGPIN_RUNTIME_DIR", folder.join("runtime"))
        .output()
        .unwrap()
}

fn said(output: &Output) -> String {
    format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr))
}

const GOOD: &str = r#"extends = "_bench"
name = "mine"
description = "A test."
duration_s = 5.0
speed = { type = "constant", speed_km_h = 80.0 }

[steer]
type = "sine"
start_s = 0.0
amplitude_deg = 20.0
frequency_hz = 0.3
cycles = 2.0
fade_in_cycles = 0.5
fade_out_cycles = 0.5
"#;

/// Edits of [`GOOD`]: (what is replaced, by what), and what the message must contain.
const EDITS: &[(&str, &str, &[&str])] = &[
    ("duration_s = 5.0", "duration_s = \"5\"", &["mine.toml:4:", "duration_s", "number"]),
    ("duration_s = 5.0", "duration_s = nan", &["mine.toml:4:", "duration_s", "finite"]),
    ("duration_s = 5.0", "duration_s = inf", &["mine.toml:4:", "duration_s", "finite"]),
    ("duration_s = 5.0", "duration_s = -5.0", &["mine.toml:4:", "duration_s", "-5"]),
    ("duration_s = 5.0", "duration_s = 1e9", &["mine.toml:4:", "duration_s", "86400"]),
    ("duration_s = 5.0", "", &["duration_s", "missing"]),
    ("duration_s = 5.0", "duration_ms = 5000.0", &["mine.toml:4:", "duration_ms", "unknown", "duration_s"]),
    ("duration_s = 5.0", "duration_s = 5.0\nseeed = 3", &["mine.toml:5:", "seeed", "unknown", "seed"]),
    ("duration_s = 5.0", "duration_s = 5.0\nseed = -3", &["mine.toml:5:", "seed"]),
    ("duration_s = 5.0", "duration_s = 5.0\nseed = 1.5", &["mine.toml:5:", "seed", "whole number"]),
    ("duration_s = 5.0", "duration_s = 2.0", &["mine.toml:4:", "duration_s", "longer than warm_up_s"]),
    ("duration_s = 5.0", "duration_s = 5.0\ngear = \"fourth\"", &["mine.toml:5:", "gear", "drive"]),
    (
        "duration_s = 5.0",
        "duration_s = 5.0\ncar_file = \"nowhere.toml\"",
        &["mine.toml:5:", "car_file", "nowhere"],
    ),
    ("duration_s = 5.0", "duration_s = 5.0\ncar_file = \"sedann\"", &["mine.toml:5:", "car_file", "sedan"]),
    ("duration_s = 5.0", "duration_s = 5.0\nduration_s = 6.0", &["mine.toml:5:", "duplicate key"]),
    ("duration_s = 5.0", "duration_s = = 5", &["mine.toml:4:"]),
    ("extends = \"_bench\"", "extends = \"mine.toml\"", &["mine.toml:1:", "extends", "back to itself"]),
    ("extends = \"_bench\"", "extends = \"gone\"", &["mine.toml:1:", "extends", "gone"]),
    ("extends = \"_bench\"", "", &["car_file", "missing", "timing"]),
    ("name = \"mine\"", "name = \"my run!\"", &["mine.toml:2:", "name"]),
    ("name = \"mine\"", "name = 7", &["mine.toml:2:", "name", "text"]),
    ("speed_km_h = 80.0", "speed_km_h = 800.0", &["mine.toml:5:", "speed_km_h", "300"]),
    ("speed_km_h = 80.0", "speed_m_s = 22.0", &["mine.toml:5:", "speed_m_s", "unknown", "km_h"]),
    ("type = \"constant\"", "type = \"constnat\"", &["mine.toml:5:", "constnat", "constant"]),
    ("type = \"sine\"", "type = \"sinus\"", &["mine.toml:8:", "sinus"]),
    ("amplitude_deg = 20.0", "amplitude_rad = 0.3", &["mine.toml:10:", "amplitude_rad", "unknown", "deg"]),
    ("amplitude_deg = 20.0", "amplitude_deg = [20.0]", &["mine.toml:10:", "amplitude_deg"]),
    ("frequency_hz = 0.3", "frequency_hz = 0.0", &["mine.toml:11:", "frequency_hz"]),
    ("cycles = 2.0", "cycles = true", &["mine.toml:12:", "cycles"]),
    ("[steer]", "[timing]\nperiod_ms = 0.7\n[steer]", &["mine.toml:8:", "period_ms", "0.25"]),
    ("[steer]", "[limits]\ncatch_up_max_ticks = 0\n[steer]", &["mine.toml:8:", "catch_up_max_ticks"]),
    ("[steer]", "[realtime.cores]\nrig = 5000\n[steer]", &["mine.toml:8:", "rig", "1023"]),
    ("[steer]", "[steering]", &["mine.toml:7:", "steering", "unknown", "steer"]),
];

#[test]
fn every_broken_scenario_is_told_by_file_line_key_and_rule() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    std::fs::write(here.join("mine.toml"), GOOD).unwrap();
    let fine = call(&["check", "mine.toml"], here);
    assert_eq!(fine.status.code(), Some(0), "{}", said(&fine));
    for (from, to, expected) in EDITS {
        assert!(GOOD.contains(from), "{from}");
        std::fs::write(here.join("mine.toml"), GOOD.replacen(from, to, 1)).unwrap();
        let output = call(&["run", "mine.toml", "--out", "out"], here);
        let text = said(&output);
        assert_eq!(output.status.code(), Some(2), "{to}: {text}");
        for part in *expected {
            assert!(text.contains(part), "{to}: the message lacks `{part}`:\n{text}");
        }
        assert!(!text.contains("panicked"), "{to}: {text}");
        assert!(!here.join("out").exists(), "{to}: something half-written is left");
    }
}

#[test]
fn all_faults_of_all_files_are_told_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    std::fs::write(here.join("car.toml"), "extends = \"sedan\"\nnmae = \"x\"\n[body]\nwheelbase_m = -1.0\n")
        .unwrap();
    let text = GOOD.replace("duration_s = 5.0", "duration_s = 0.0\ncar_file = \"car.toml\"\nfoo = 1");
    std::fs::write(here.join("mine.toml"), text).unwrap();
    let output = call(&["run", "mine.toml", "--json", "--out", "out"], here);
    assert_eq!(output.status.code(), Some(2));
    let text = said(&output);
    for part in ["duration_s", "foo", "nmae", "wheelbase_m", "car.toml"] {
        assert!(text.contains(part), "lacks {part}: {text}");
    }
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(json.to_string().contains("\"line\""), "{json}");
}

#[test]
fn an_axle_that_cannot_be_assembled_or_steers_the_wrong_way_is_refused_before_anything_starts() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let wrong = call(&["run", "slalom_120", "--set", "unit_file=column_eps", "--out", "out"], here);
    assert_eq!(wrong.status.code(), Some(2));
    assert!(said(&wrong).contains("rack_travel_m_per_rev"), "{}", said(&wrong));
    let point = "front_axle.geometry.left.uca_ball_m=[0.0, 0.77, -0.2001]";
    let degenerate = call(&["run", "slalom_120", "--set", point, "--out", "out"], here);
    assert_eq!(degenerate.status.code(), Some(2), "{}", said(&degenerate));
    assert!(!here.join("out").exists());
}

#[test]
fn wrong_arguments_and_names_end_with_two() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    for arguments in [
        &["run"] as &[&str],
        &["run", "no_such_scenario"],
        &["run", "growing_slalom_80", "--name", "A/B"],
        &["run", "growing_slalom_80", "--duration", "-1"],
        &["run", "growing_slalom_80", "--set", "nonsense"],
        &["run", "growing_slalom_80", "--set", "body.nonsense=1"],
        &["run", "growing_slalom_80", "--restart-delay", "nan"],
        &["frobnicate"],
        &["report", "nowhere"],
        &["recover", "nowhere.mcap"],
        &["export", "nowhere", "--format", "csv"],
        &["export", "nowhere", "--format", "xls"],
        &["table", "show", "--name", "nobody-runs-this", "no_such_region"],
    ] {
        let output = call(arguments, here);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {}", said(&output));
        assert!(!said(&output).contains("panicked"), "{arguments:?}");
    }
    let close = call(&["run", "growing_slalom_8"], here);
    assert!(said(&close).contains("growing_slalom_80"), "{}", said(&close));
}

#[test]
fn help_completions_list_and_schemas_answer() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let help = said(&call(&["--help"], here));
    assert!(help.contains("Exit codes") && help.contains("kingpin run growing_slalom_80"), "{help}");
    let bash = said(&call(&["completions", "bash"], here));
    assert!(bash.contains("growing") || bash.contains("lockstep"), "completions are empty");
    let list: serde_json::Value = serde_json::from_slice(&call(&["list", "--json"], here).stdout).unwrap();
    assert!(list["scenarios"].as_array().unwrap().len() >= 10);
    for section in ["scenario", "car", "axle", "rig", "unit"] {
        let schema: serde_json::Value =
            serde_json::from_slice(&call(&["schema", section], here).stdout).unwrap();
        assert!(schema["properties"].is_object(), "{section}");
    }
}

/// Every shipped scenario that needs no record of the user's is valid and can be built.
#[test]
fn every_shipped_scenario_can_be_built() {
    let folder = tempfile::tempdir().unwrap();
    let list: serde_json::Value =
        serde_json::from_slice(&call(&["list", "scenarios", "--json"], folder.path()).stdout).unwrap();
    for scenario in list["scenarios"].as_array().unwrap() {
        let name = scenario["name"].as_str().unwrap();
        let output = call(&["check", name], folder.path());
        let measured = name.ends_with("_measured") || name == "reproduce_run";
        assert_eq!(output.status.code(), Some(if measured { 2 } else { 0 }), "{name}: {}", said(&output));
        if measured {
            assert!(said(&output).contains("record"), "{}", said(&output));
        }
    }
}

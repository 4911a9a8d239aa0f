//! What a scenario brings to the car besides its manoeuvre: equations, a measured road, a log of this bench as input.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout, missing_docs)]

use kingpin_tests::support::{kingpin, reference};
use record::LogReader;
use regions::model_flags;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use tempfile::TempDir;

fn told(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Runs a scenario file in one process as fast as it goes.
fn run(scenario: &Path, out: &Path, name: &str) -> Output {
    let bench = format!("si{}{name}", std::process::id());
    Command::new(kingpin())
        .args(["run", scenario.to_str().unwrap(), "--lockstep", "--no-report", "--name", &bench, "--out"])
        .arg(out)
        .output()
        .unwrap()
}

fn scenario(folder: &Path, name: &str, text: &str) -> PathBuf {
    let path = folder.join(format!("{name}.toml"));
    std::fs::write(&path, text).unwrap();
    path
}

fn signal(log: &LogReader, name: &str) -> Vec<f64> {
    log.signal(name).unwrap_or_else(|e| panic!("{name}: {e}")).value
}

#[test]
fn equations_act_on_the_car_of_the_bench_and_are_logged_by_name() {
    let folder = TempDir::new().unwrap();
    let file = scenario(
        folder.path(),
        "gust",
        r#"extends = "lane_change_120"
duration_s = 6.0
steer = { type = "hold", angle_deg = 0.0 }
[[equations.variables]]
name = "gust"
unit = "kN"
expression = "if(time_s > 4 s, 1.5 kN, 0)"
[[equations.imports]]
variable = "external_force_y_n"
mode = "add"
expression = "gust"
[[equations.outputs]]
name = "gust_now"
unit = "N"
expression = "gust"
[[equations.outputs]]
name = "axle_side_force"
unit = "kN"
expression = "fy_n_fl + fy_n_fr"
"#,
    );
    let out = folder.path().join("run");
    let ended = run(&file, &out, "eq");
    assert_eq!(ended.status.code(), Some(0), "{}", told(&ended));
    let log = LogReader::open(&out).unwrap();
    let gust = signal(&log, "vehicle_state.user_output.gust_now");
    assert_eq!((gust[3900], gust[4100]), (0.0, 1500.0));
    assert_eq!(log.signal("vehicle_state.user_output.axle_side_force").unwrap().unit, "kN");
    let sum = signal(&log, "vehicle_state.user_output.axle_side_force")[5000];
    let forces = [1, 4].map(|k| {
        log.column(
            "vehicle_state",
            log.region("vehicle_state")
                .unwrap()
                .columns
                .iter()
                .map(|c| c.name.as_str())
                .filter(|n| n.starts_with("tyre_force_n."))
                .nth(k)
                .unwrap(),
        )
        .unwrap()[5000]
    });
    assert!((sum - 1e-3 * (forces[0] + forces[1])).abs() < 1e-9, "{sum} {forces:?}");
    let drift = signal(&log, "vehicle_state.velocity_m_s.y");
    assert!(drift[3900].abs() < 0.01 && drift[5500].abs() > 0.02, "{} {}", drift[3900], drift[5500]);
    assert!(
        signal(&log, "vehicle_state.user_output.2").iter().all(|v| v.is_nan()),
        "unused slots are absent"
    );

    // Wrong ones are told with file and line, and nothing is started.
    let text = std::fs::read_to_string(&file)
        .unwrap()
        .replace("\"gust\"\n[[equations.outputs]]", "\"gust * 1 m\"\n[[equations.outputs]]");
    let bad = scenario(folder.path(), "bad", &text);
    let ended = run(&bad, &folder.path().join("none"), "bad");
    assert_eq!(ended.status.code(), Some(2));
    assert!(told(&ended).contains("bad.toml:11:"), "{}", told(&ended));
    assert!(told(&ended).contains("equations.imports[0].expression"), "{}", told(&ended));
}

#[test]
fn a_measured_road_lies_under_the_wheels_of_the_bench() {
    let Some(road) = reference("road/belgian_block.crg") else { return };
    let folder = TempDir::new().unwrap();
    let text = format!(
        r#"extends = "lane_change_120"
duration_s = 6.0
speed = {{ type = "constant", speed_km_h = 20.0 }}
steer = {{ type = "hold", angle_deg = 0.0 }}
[road.surface]
file = "{}"
begin_x_m = 18.0
begin_y_m = 0.0
begin_height_m = 0.0
heading_deg = 0.0
height_scale = 0.3
outside = "zero"
patch_length_m = 0.12
patch_width_m = 0.15
"#,
        road.display()
    );
    let file = scenario(folder.path(), "block", &text);
    let out = folder.path().join("run");
    let ended = run(&file, &out, "crg");
    assert_eq!(ended.status.code(), Some(0), "{}", told(&ended));
    let log = LogReader::open(&out).unwrap();
    let x = signal(&log, "vehicle_state.position_m.x");
    let travel = signal(&log, "vehicle_state.wheel_travel_m.fl");
    let flags = log.column_u64("vehicle_state", "flags").unwrap();
    let rough = |from: f64, to: f64| {
        let part: Vec<f64> =
            x.iter().zip(&travel).filter(|(x, _)| (from..to).contains(*x)).map(|(_, t)| *t).collect();
        assert!(part.len() > 500);
        let mean = part.iter().sum::<f64>() / part.len() as f64;
        (part.iter().map(|t| (t - mean).powi(2)).sum::<f64>() / part.len() as f64).sqrt()
    };
    let (smooth, block) = (rough(8.0, 14.0), rough(20.0, 25.0));
    println!("wheel travel rms: {:.2} mm before the block, {:.2} mm on it", 1e3 * smooth, 1e3 * block);
    assert!(block > 1e-3 && smooth < 0.2 * block);
    // The flag says when any wheel is off the grid: before, and not in the middle of the ten metres.
    let off = |at: f64| {
        let n = x.iter().position(|x| *x >= at).unwrap();
        flags[n] & model_flags::OFF_SURFACE != 0
    };
    assert!(off(5.0) && !off(23.0));

    let bad = text.replace("belgian_block.crg", "fileref.crg");
    let ended = run(&scenario(folder.path(), "bad", &bad), &folder.path().join("none"), "crgbad");
    assert_eq!(ended.status.code(), Some(2));
    assert!(told(&ended).contains("fileref.crg") && told(&ended).contains("OpenCRG"), "{}", told(&ended));
    let lost = scenario(folder.path(), "lost", &text.replace("belgian_block", "nowhere"));
    let ended = run(&lost, &folder.path().join("none"), "crglost");
    assert!(
        told(&ended).contains("lost.toml:6:") && told(&ended).contains("no such file"),
        "{}",
        told(&ended)
    );
}

#[test]
fn a_log_of_this_bench_drives_the_next_run() {
    let folder = TempDir::new().unwrap();
    let first = scenario(folder.path(), "first", "extends = \"lane_change_120\"\nduration_s = 8.0\n");
    let out = folder.path().join("first_run");
    let ended = run(&first, &out, "log1");
    assert_eq!(ended.status.code(), Some(0), "{}", told(&ended));
    // The hand wheel as it was turned, and the speed as it was driven; the warm-up is 3 s.
    let again = scenario(
        folder.path(),
        "again",
        r#"extends = "_bench"
name = "again"
description = "The first run's hand wheel and speed again"
duration_s = 7.8
[record]
start_s = 3.0
fade_in_s = 0.0
[steer]
type = "recorded_history"
file = "first_run"
time_column = "time_s"
time_offset_s = 0.0
column = "vehicle_state.steering_wheel_angle_command_rad"
scale_rad = 1.0
offset_deg = 0.0
clip_deg = 600.0
[speed]
type = "recorded_history"
file = "first_run/log.mcap"
time_column = "time_s"
time_offset_s = 0.0
column = "vehicle_state.velocity_m_s.x"
scale_m_s = 1.0
"#,
    );
    let second = folder.path().join("second_run");
    let ended = run(&again, &second, "log2");
    assert_eq!(ended.status.code(), Some(0), "{}", told(&ended));
    let yaw = |path: &Path| signal(&LogReader::open(path).unwrap(), "vehicle_state.angular_velocity_rad_s.z");
    let (a, b) = (yaw(&out), yaw(&second));
    let peak = a.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    let rms = (a.iter().zip(&b).map(|(a, b)| (a - b).powi(2)).sum::<f64>() / b.len() as f64).sqrt();
    println!("yaw rate: peak {peak:.4} rad/s, difference {:.2} % rms of it", 100.0 * rms / peak);
    assert!(peak > 0.1 && rms < 0.01 * peak, "{rms} of {peak}");

    let bad = std::fs::read_to_string(&again).unwrap().replace("command_rad", "command_deg");
    let ended = run(&scenario(folder.path(), "bad", &bad), &folder.path().join("none"), "log3");
    assert_eq!(ended.status.code(), Some(2));
    assert!(told(&ended).contains("first_run") && told(&ended).contains("command_deg"), "{}", told(&ended));
}

/// Spec 6.2: inputs of a recorded drive replayed, tie-rod forces within 10 %, torque loops with gradient and width.
#[test]
fn a_recorded_run_is_reproduced_with_its_forces_and_torque_loops() {
    let folder = TempDir::new().unwrap();
    let bench = format!("sirep{}", std::process::id());
    let call = |arguments: &[&str], out: &Path| {
        let ended = Command::new(kingpin())
            .args(["run", "--lockstep", "--no-report", "--name", &bench, "--out"])
            .arg(out)
            .args(arguments)
            .output()
            .unwrap();
        assert_eq!(ended.status.code(), Some(0), "{}", told(&ended));
        let text = std::fs::read(out.join("summary.json")).unwrap();
        serde_json::from_slice::<serde_json::Value>(&text).unwrap()
    };
    let recorded = folder.path().join("recorded");
    call(&["growing_slalom_80"], &recorded);
    let directory = format!("record.directory={}", recorded.display());
    let same = call(&["reproduce_run", "--set", &directory], &folder.path().join("same"));
    let error = |summary: &serde_json::Value, signal: &str| {
        let all = summary["overlays"].as_array().unwrap();
        let found = all.iter().find(|o| o["target"].as_str().unwrap().contains(signal)).unwrap();
        found["normalised_rms_error_percent"].as_f64().unwrap()
    };
    for (signal, most) in [
        ("acceleration_m_s2.y", 2.0),
        ("tie_rod_force_n.left", 5.0),
        ("tie_rod_force_n.right", 5.0),
        ("steering_wheel_torque", 5.0),
    ] {
        let found = error(&same, signal);
        println!("{signal}: {found:.2} % of the recorded rms");
        assert!(found < most, "{signal}: {found}");
    }
    let loops = same["record_loops"].as_array().unwrap();
    assert_eq!(loops.len(), 2, "{loops:?}");
    for found in loops {
        println!("loop: {found}");
        assert!(found["gradient_error_percent"].as_f64().unwrap().abs() < 5.0, "{found}");
        // The width at 0 is not judged sharper than a third: at rest after the slalom the two hand wheels tremble about 0
        // each in its own way, and those crossings count too (seen: 22 % over the angle, 9 % over the acceleration).
        assert!(found["width_error_percent"].as_f64().unwrap().abs() < 33.0, "{found}");
    }
    // The same drive with grip gone from the front is another one, and that is seen.
    let change = r#"parameters=[{type="set", at_s=-1.0, path="tyre.front.friction_scale", value=0.6}]"#;
    let other = call(&["reproduce_run", "--set", &directory, "--set", change], &folder.path().join("other"));
    let found = error(&other, "tie_rod_force_n.left");
    assert!(found > 10.0, "less grip changes the forces: {found} %");
}

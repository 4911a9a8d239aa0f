//! The model commands, run as a user runs them: shipped models, known answers, bad input.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout, missing_docs)]

use kingpin_tests::support::kingpin;
use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output};
use tempfile::TempDir;

fn run(args: &[&str]) -> Output {
    Command::new(kingpin()).arg("model").args(args).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn json(args: &[&str]) -> Value {
    let ended = run(args);
    assert!(ended.status.success(), "{}", text(&ended.stderr));
    serde_json::from_slice(&ended.stdout).unwrap()
}

fn write(folder: &TempDir, name: &str, content: &str) -> String {
    let path = folder.path().join(name);
    std::fs::write(&path, content).unwrap();
    path.display().to_string()
}

fn column(path: &str, name: &str) -> Vec<f64> {
    let content = std::fs::read_to_string(Path::new(path)).unwrap();
    let mut lines = content.lines();
    let at = lines
        .next()
        .unwrap()
        .split(',')
        .position(|h| h == name)
        .unwrap_or_else(|| panic!("no column {name}"));
    lines.map(|l| l.split(',').nth(at).unwrap().parse().unwrap()).collect()
}

/// A mass of 2 kg with a damper of 4 N·s/m, pushed.
const CART: &str = r#"
format = "kingpin-model/1"
ports.push = { of = "cart.body", positive = "in" }
[observe]
speed = "cart.v"
[parts.cart]
use = "library/mass.toml"
set = { m = "2 kg", d = "4 N*s/m" }
"#;

#[test]
fn every_shipped_model_checks_describes_and_draws() {
    let names = [
        "rack_eps",
        "column_eps",
        "column_eps_lumped",
        "hydraulic",
        "recirculating_ball",
        "steer_by_wire",
        "driveline",
        "one_wheel",
    ];
    let checked = json(&[&["check", "--json"][..], &names[..]].concat());
    assert!(checked.as_array().unwrap().iter().all(|m| m["valid"] == true), "{checked}");
    let about = json(&["describe", "one_wheel", "--json"]);
    assert_eq!(about["states"].as_array().unwrap().len(), 2);
    assert_eq!(about["sampled"][0], "heading.beta");
    let svg = text(&run(&["draw", "one_wheel"]).stdout);
    assert!(svg.starts_with("<svg") && svg.matches("class=\"frame\"").count() == 2);
}

#[test]
fn the_matrices_of_the_one_wheel_vehicle_are_the_closed_form() {
    // Spec 5.4 with D_T isotropic: M_C x' = -[D_C + Phi^T Psi Phi] x - F_F + Phi^T Psi O_V.
    let (alpha, beta) = (0.4f64, -0.9f64);
    let m = json(&[
        "compose",
        "one_wheel",
        "--set",
        &format!("car.alpha={alpha} rad"),
        "--at",
        &format!("heading.beta={beta}"),
        "--json",
    ]);
    let value = |name: &str| {
        let listed = json(&["describe", "one_wheel", "--json"]);
        let found =
            listed["parameters"].as_array().unwrap().iter().find(|p| p["name"] == name).unwrap()["value"]
                .as_f64();
        found.unwrap()
    };
    let (mc, dc, dt) = (value("MC"), value("DC"), value("DT"));
    let (d0, n, rt) = (value("car.D0"), value("car.N"), value("car.RT"));
    let p = rt * rt * n * n / d0;
    // P_V = p n n^T: Psi = (1/dt + P_V)^-1 = dt (I - dt p/(1 + dt p) n n^T).
    let along = [alpha.sin(), -alpha.cos()];
    let psi = |i: usize, j: usize| {
        dt * (f64::from(u8::from(i == j)) - dt * p / (1.0 + dt * p) * along[i] * along[j])
    };
    let phi = [[beta.cos(), beta.sin()], [-beta.sin(), beta.cos()]];
    for i in 0..2 {
        for j in 0..2 {
            let turned: f64 = (0..2)
                .flat_map(|a| (0..2).map(move |b| (a, b)))
                .map(|(a, b)| phi[a][i] * psi(a, b) * phi[b][j])
                .sum();
            let want = -(f64::from(u8::from(i == j)) * dc + turned);
            let got = m["A"][i][j].as_f64().unwrap();
            assert!((got - want).abs() < 1e-9 * dt, "A[{i}][{j}]: {got} {want}");
        }
        assert!((m["E"][i][i].as_f64().unwrap() - mc).abs() < 1e-9);
    }
}

#[test]
fn a_simulation_takes_inputs_start_values_and_keeps_account() {
    let folder = TempDir::new().unwrap();
    let model = write(&folder, "cart.toml", CART);
    // 8 N from 0.5 s on, in kN and ms.
    let drive = write(
        &folder,
        "in.csv",
        "time [ms],push.f [kN],note\n0,0,a\n500,0,b\n500.000001,0.008,c\n2000,0.008,d\n",
    );
    let out = folder.path().join("out.csv").display().to_string();
    let ended = run(&[
        "simulate",
        &model,
        "--input",
        &drive,
        "--start",
        "cart.v=1",
        "--dt",
        "0.001",
        "--output",
        &out,
        "--account",
    ]);
    assert!(ended.status.success(), "{}", text(&ended.stderr));
    let speed = column(&out, "speed [m/s]");
    assert_eq!(speed.len(), 2001);
    // v' = (f - 4 v)/2: decays from 1, then tends to 2.
    let at_half = (-1.0f64).exp();
    assert!((speed[500] - at_half).abs() < 1e-9, "{}", speed[500]);
    let want = 2.0 + (at_half - 2.0) * (-3.0f64).exp();
    assert!((speed[2000] - want).abs() < 1e-6, "{} {want}", speed[2000]);
    assert!(column(&out, "imbalance_j").iter().all(|v| v.abs() < 1e-12));
    let page = folder.path().join("out.html").display().to_string();
    assert!(
        run(&["plot", &model, "--constant", "push.f=8", "--duration", "1", "--output", &page])
            .status
            .success()
    );
    assert!(std::fs::read_to_string(page).unwrap().contains("Plotly"));
}

#[test]
fn compare_finds_lag_gain_and_bias() {
    let folder = TempDir::new().unwrap();
    let model = write(&folder, "cart.toml", CART);
    // The drive and what a cart of 2 kg and 4 N·s/m does under 10 sin 5t: 20 ms late, 3 % more, 0.1 m/s up.
    let (w, steady) = (5.0f64, 10.0 / (4.0f64.powi(2) + (2.0f64 * 5.0).powi(2)));
    let answer = |t: f64| {
        let t = t.max(0.0);
        steady * (4.0 * (w * t).sin() - 2.0 * w * (w * t).cos()) + steady * 2.0 * w * (-2.0 * t).exp()
    };
    let mut measured = String::from("time_s,push.f,Speed [mm/s]\n");
    for k in 0..=4000 {
        let t = f64::from(k) * 1e-3;
        measured += &format!("{t},{},{}\n", 10.0 * (w * t).sin(), 1e3 * (1.03 * answer(t - 0.02) + 0.1));
    }
    let file = write(&folder, "measured.csv", &measured);
    let c =
        json(&["compare", &model, "--measured", &file, "--signal", "speed=Speed", "--dt", "0.001", "--json"]);
    let s = &c["signals"][0];
    let get = |v: &Value, key: &str| v[key].as_f64().unwrap();
    assert!((get(&c, "lag_s") - 0.02).abs() < 3e-4, "{c}");
    assert!((get(s, "gain") - 1.03).abs() < 2e-3 && (get(s, "bias") - 0.1).abs() < 2e-3, "{c}");
    assert!(get(s, "correlation") > 0.9999);
    assert!((get(&s["measured"], "frequency_hz") - w / std::f64::consts::TAU).abs() < 0.05, "{c}");
}

#[test]
fn bad_input_names_file_line_part_and_port_and_exits_2() {
    let folder = TempDir::new().unwrap();
    let broken = write(&folder, "broken.toml", &CART.replace("cart.body", "cart.bdoy"));
    let check = |args: &[&str], expected: &[&str]| {
        let ended = run(args);
        assert_eq!(ended.status.code(), Some(2), "{args:?}");
        let told = text(&ended.stderr) + &text(&ended.stdout);
        for e in expected {
            assert!(told.contains(e), "{e} not in\n{told}");
        }
    };
    check(&["check", &broken], &["broken.toml:3", "cart.bdoy"]);
    check(&["check", "rack_esp"], &["did you mean `rack_eps`"]);
    check(&["compose", "one_wheel", "--set", "MC=3 N"], &["MC"]);
    check(&["compose", "one_wheel", "--at", "beta=1"], &["beta", "heading.beta"]);
    check(&["simulate", "one_wheel", "--output", "x.csv"], &["--duration"]);
    let csv = write(&folder, "in.csv", "time_s,outside.fF.x [m]\n0,1\n0,nan\n");
    check(
        &["simulate", "one_wheel", "--input", &csv, "--output", "x.csv"],
        &["in.csv:1: outside.fF.x [m]", "in.csv:3"],
    );
}

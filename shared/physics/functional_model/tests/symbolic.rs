//! Symbolic text reads back to the numbers; causality is reported and parts are turned round where needed.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout, missing_docs)]

mod support;

use std::collections::BTreeMap;

use functional_model::{OperatingPoint, Parameters, System, evaluate_symbolic};
use support::{Random, model, shipped, show};

/// Every entry of the matrices against the text.
fn compare(system: &System, sampled: &[f64]) -> (f64, String) {
    let s = system.symbolic().unwrap();
    let text = s.to_string();
    let mut values: BTreeMap<String, f64> =
        system.parameters().into_iter().map(|p| (p.name, p.value)).collect();
    for (n, v) in system.sampled_names().into_iter().zip(sampled) {
        values.insert(n, *v);
    }
    let read = evaluate_symbolic(&text, &values).unwrap();
    let m =
        show(system.matrices_at(&OperatingPoint { sampled: sampled.to_vec(), ..OperatingPoint::default() }));
    let get = |k: String| read.get(&k).copied().unwrap_or(0.0);
    let mut worst = 0.0f64;
    let mut check = |number: f64, k: String, size: f64| {
        let d = (number - get(k.clone())).abs() / size.max(1e-300);
        assert!(d < 1e-9, "{k}: {number} in numbers, {} in text\n{text}", get(k.clone()));
        worst = worst.max(d);
    };
    let size = |r: &[f64]| r.iter().fold(0.0f64, |m, v| m.max(v.abs()));
    for (i, x) in m.states.iter().enumerate() {
        // Rows may come out scaled: compare what E gives.
        let (es, scale) = (size(&m.e[i]), 1.0);
        for (j, y) in m.states.iter().enumerate() {
            check(m.e[i][j], format!("E[{x}, {y}]"), es * scale);
            check(m.a[i][j], format!("A[{x}, {y}]"), size(&m.a[i]).max(es));
        }
        for (j, u) in m.inputs.iter().enumerate() {
            check(m.b[i][j], format!("B[{x}, {u}]"), size(&m.b[i]).max(es * 1e-9));
        }
        check(m.state_constant[i], format!("A[{x}, 1]"), m.state_constant[i].abs().max(es));
    }
    for (i, y) in m.outputs.iter().enumerate() {
        let row = size(&m.c[i]).max(size(&m.d[i])).max(m.output_constant[i].abs()).max(1e-12);
        for (j, x) in m.states.iter().enumerate() {
            check(m.c[i][j], format!("C[{y}, {x}]"), row);
        }
        for (j, u) in m.inputs.iter().enumerate() {
            check(m.d[i][j], format!("D[{y}, {u}]"), row);
        }
        check(m.output_constant[i], format!("C[{y}, 1]"), row);
    }
    (worst, text)
}

#[test]
fn one_wheel_text_reads_back() {
    let model = shipped("one_wheel.toml");
    let mut r = Random(11);
    let mut worst = 0.0f64;
    for k in 0..100 {
        let p = Parameters::new()
            .with("MC", &format!("{} kg", r.between(50.0, 500.0)))
            .with("DT", &format!("[{} N*s/m, {} N*s/m]", r.between(300.0, 900.0), r.between(300.0, 900.0)))
            .with("car.alpha", &format!("{} rad", r.between(-3.0, 3.0)));
        let system = show(model.compose(&p));
        let (w, text) = compare(&system, &[r.between(-3.0, 3.0)]);
        worst = worst.max(w);
        if k == 0 {
            println!("{text}");
        }
    }
    println!("symbolic text against numbers: {worst:.1e}");
    assert!(worst < 1e-11);
}

const GEAR: &str = r#"
ports.drive = { of = "motor.shaft", positive = "in" }
[parameters]
N = "7"
[start]
"motor.w" = "0 rad/s"
[parts.motor]
use = "library/hand_wheel.toml"
[parts.gear]
use = "library/gear.toml"
set = { N = "N" }
[parts.load]
use = "library/inertia.toml"
set = { J = "3 kg*m^2" }
[[couplings]]
join = ["motor.column", "gear.input"]
[[couplings]]
join = ["gear.output", "load.shaft"]
"#;

#[test]
fn reduced_storages_have_text_and_are_reported() {
    let text = GEAR.replace("motor.shaft", "motor.hub");
    let system = show(model(&text).compose(&Parameters::new()));
    let (worst, text) = compare(&system, &[]);
    println!("{text}");
    assert!(worst < 1e-12);
    assert!(text.contains("motor.J") && text.contains("load.J") && text.contains("N^2"), "{text}");
    let report = system.causality_report();
    println!("{report}");
    assert_eq!(report.dependent_states, ["load.w"]);
    let load = report.ports.iter().find(|p| p.port == "load.shaft").unwrap();
    assert!(load.turned && load.actual == "through T", "{load:?}");
}

#[test]
fn two_dampers_in_a_row_turn_one_round() {
    // Both want to give through; the speed between them is a loop of two losses.
    let system = show(
        model(
            r#"
ports = { left = "first.a", right = "second.b" }
[parts.first]
use = "library/damper.toml"
[parts.second]
use = "library/damper.toml"
set = { d = "300 N*s/m" }
[[couplings]]
join = ["first.b", "second.a"]
"#,
        )
        .compose(&Parameters::new()),
    );
    let report = system.causality_report();
    println!("{report}");
    assert_eq!(report.ports.iter().filter(|p| p.turned).count(), 1);
    let (worst, text) = compare(&system, &[]);
    println!("{text}");
    assert!(worst < 1e-13);
    // In a row: 100 * 300 / 400.
    let m = show(system.matrices());
    assert!((m.d[0][0] - 75.0).abs() < 1e-12, "{m:?}");
    assert!(system.causality_report().loops.iter().any(|l| l.len() > 1));
}

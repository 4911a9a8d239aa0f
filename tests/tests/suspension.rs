//! The suspension commands, run as a user runs them: every reference file, methods compared, bad input.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout, missing_docs)]

use config::axle::{Axle, Bushing};
use kingpin_tests::csv::Table;
use kingpin_tests::support::{kingpin, reference};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use tempfile::TempDir;

fn run(args: &[&str]) -> Output {
    Command::new(kingpin()).arg("suspension").args(args).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn path_text(path: &Path) -> &str {
    path.to_str().unwrap()
}

fn hardpoints(file: &str) -> Option<PathBuf> {
    let name = if file.contains("dw_sedan") { "dw_sedan" } else { "strut_compact" };
    reference(&format!("suspension/hardpoints_{name}.json"))
}

/// Solves a reference file with the executable and compares every column of the reference by name.
fn check(file: &str) {
    let (Some(input), Some(axle)) = (reference(&format!("suspension/{file}")), hardpoints(file)) else {
        return;
    };
    let folder = TempDir::new().unwrap();
    let output = folder.path().join("out.csv");
    let ended = run(&[
        "solve",
        "--axle",
        path_text(&axle),
        "--input",
        path_text(&input),
        "--output",
        path_text(&output),
    ]);
    assert!(ended.status.success(), "{}", text(&ended.stderr));
    compare(file, &Table::read(&input), &Table::read(&output));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "a draft was left behind");
}

/// Position columns: metres; angles and quaternions go with them.
const POSITIONS: [&str; 17] = [
    "lbj_",
    "ubj_",
    "to_",
    "wc_",
    "cp_",
    "q0",
    "q1",
    "q2",
    "q3",
    "steer",
    "toe",
    "camber",
    "caster",
    "kpi",
    "spring_length",
    "strut_length",
    "arb_angle",
];

fn compare(file: &str, expected: &Table, got: &Table) {
    assert_eq!(expected.rows.len(), got.rows.len());
    assert!(got.column("status").iter().all(|s| *s == 0.0));
    assert_eq!(got.names.last().unwrap(), "status");
    let compliant = file.contains("compliant");
    let (mut positions, mut forces, mut columns) = (0.0_f64, 0.0_f64, 0);
    for name in &expected.names {
        // What moves the compliant runs, and is no column of ours.
        if name == "s" {
            continue;
        }
        assert!(got.has(name), "{file}: no column {name}");
        let ours = got.column(name);
        columns += 1;
        for (row, (a, b)) in expected.column(name).iter().zip(&ours).enumerate() {
            let off = (a - b).abs();
            if POSITIONS.iter().any(|p| name.starts_with(p)) {
                positions = positions.max(off);
                let limit = match () {
                    () if compliant => 1e-8,
                    () if file.contains("strut_compact_compound") => 1e-8,
                    () => 1e-9,
                };
                assert!(off <= limit, "{file} row {row} {name}: {b} for {a}");
            } else if ["step", "rack", "zL", "zR"].contains(&name.as_str()) {
                assert_eq!(a, b, "{file} row {row} {name}");
            } else {
                // A vector's components share a peak; loads in knuckle and body axes, theirs.
                let stem = name.split('_').next().unwrap();
                let stem = if stem.len() == 3 { &stem[..1] } else { stem };
                let peak = expected.peak(stem);
                // Forces whose true value is 0 are held against 1 N, moments against 1 N m.
                let small = ["dtoe", "dcamber", "defl"].contains(&stem);
                let peak = if small { peak } else { peak.max(1.0) };
                let off = if peak > 0.0 { off / peak } else { off };
                forces = forces.max(off);
                let limit = if compliant { 1e-5 } else { 1e-6 };
                assert!(off <= limit, "{file} row {row} {name}: {b} for {a}, peak {peak}");
            }
        }
    }
    println!(
        "{file}: {columns} columns: positions and angles {positions:.1e}, others {forces:.1e} of the peak"
    );
    assert!(columns >= 40, "{columns}");
}

macro_rules! files {
    ($($name:ident: $check:ident $file:literal;)+) => { $(#[test] fn $name() { $check($file); })+ };
}

files! {
    dw_steer_kin: check "ref_dw_sedan_steer_kin.csv";
    dw_bounce_kin: check "ref_dw_sedan_bounce_kin.csv";
    dw_rebound_kin: check "ref_dw_sedan_rebound_kin.csv";
    dw_compound_kin: check "ref_dw_sedan_compound_kin.csv";
    strut_steer_kin: check "ref_strut_compact_steer_kin.csv";
    strut_bounce_kin: check "ref_strut_compact_bounce_kin.csv";
    strut_rebound_kin: check "ref_strut_compact_rebound_kin.csv";
    strut_compound_kin: check "ref_strut_compact_compound_kin.csv";
    dw_steer_force: check "ref_dw_sedan_steer_force.csv";
    dw_bounce_force: check "ref_dw_sedan_bounce_force.csv";
    dw_rebound_force: check "ref_dw_sedan_rebound_force.csv";
    dw_compound_force: check "ref_dw_sedan_compound_force.csv";
    strut_steer_force: check "ref_strut_compact_steer_force.csv";
    strut_bounce_force: check "ref_strut_compact_bounce_force.csv";
    strut_rebound_force: check "ref_strut_compact_rebound_force.csv";
    strut_compound_force: check "ref_strut_compact_compound_force.csv";
    compliant_fy2000: check_compliant "ref_dw_sedan_compliant_fy2000.csv";
    compliant_fy2000_fz4000: check_compliant "ref_dw_sedan_compliant_fy2000_fz4000.csv";
    compliant_fxm2000: check_compliant "ref_dw_sedan_compliant_fxm2000.csv";
    compliant_fxm2000_fz4000: check_compliant "ref_dw_sedan_compliant_fxm2000_fz4000.csv";
}

/// The reference's bushings on its hardpoints, as an axle file.
fn check_compliant(file: &str) {
    let (Some(input), Some(points)) = (reference(&format!("suspension/{file}")), hardpoints(file)) else {
        return;
    };
    let folder = TempDir::new().unwrap();
    let mut axle = Axle::from_hardpoint_json(&std::fs::read_to_string(points).unwrap(), "dw_sedan").unwrap();
    let bushing = Bushing {
        radial_n_per_m: 8e6,
        axial_n_per_m: 1e6,
        torsional_n_m_per_rad: 50.0,
        axis: None,
        damping: None,
    };
    let all = ["uca_front", "uca_rear", "lca_front", "lca_rear"];
    let all: BTreeMap<_, _> = all.iter().map(|name| ((*name).to_owned(), bushing.clone())).collect();
    axle.bushings = Some(all);
    let (toml, output) = (folder.path().join("axle.toml"), folder.path().join("out.csv"));
    std::fs::write(&toml, toml::to_string(&axle).unwrap()).unwrap();
    let ended = run(&[
        "solve",
        "--axle",
        path_text(&toml),
        "--input",
        path_text(&input),
        "--output",
        path_text(&output),
        "--lock-springs",
    ]);
    assert!(ended.status.success(), "{}", text(&ended.stderr));
    compare(file, &Table::read(&input), &Table::read(&output));
}

#[test]
fn describe_counts_as_the_literature_does() {
    let count = |name: &str| {
        let ended = run(&["describe", name, "--json"]);
        assert!(ended.status.success(), "{}", text(&ended.stderr));
        let json: serde_json::Value = serde_json::from_slice(&ended.stdout).unwrap();
        let models = json["models"].as_array().unwrap();
        let rows = models.iter().map(|m| {
            let sum: u64 =
                m["constraints"].as_array().unwrap().iter().map(|c| c["rows"].as_u64().unwrap()).sum();
            assert_eq!(sum, m["rows"].as_u64().unwrap());
            assert_eq!(m["rows"], m["coordinates"]);
            sum
        });
        rows.collect::<Vec<_>>()
    };
    assert_eq!(count("sedan_double_wishbone"), [24, 36]);
    // With stabiliser: kinematic, reaction; without: kinematic, reaction.
    assert_eq!(count("compact_strut"), [36, 36, 24, 24]);
    let shown = text(&run(&["describe", "compact_strut"]).stdout);
    for line in
        ["translational 1 (5)", "revolute 2 (10)", "36 equations for 36 coordinates", "without stabiliser"]
    {
        assert!(shown.contains(line), "{line} not in\n{shown}");
    }
}

/// Largest error of each method [N] and the peak, by `compare --json`.
fn methods(axle: &Path, file: &Path, page: &Path) -> BTreeMap<String, f64> {
    let ended = run(&[
        "compare",
        "--axle",
        path_text(axle),
        "--reference",
        path_text(file),
        "--output",
        path_text(page),
        "--json",
    ]);
    assert!(ended.status.success(), "{}", text(&ended.stderr));
    let json: serde_json::Value = serde_json::from_slice(&ended.stdout).unwrap();
    let mut errors = BTreeMap::new();
    for method in json["methods"].as_array().unwrap() {
        let both = method["max_n"].as_array().unwrap();
        let worst = both.iter().map(|x| x.as_f64().unwrap()).fold(0.0, f64::max);
        errors.insert(method["method"].as_str().unwrap().to_owned(), worst);
        errors.insert("peak".to_owned(), method["peak_n"].as_f64().unwrap());
    }
    errors
}

#[test]
fn in_compound_the_older_methods_are_off_by_far_more() {
    let folder = TempDir::new().unwrap();
    let page = folder.path().join("compare.html");
    for name in ["dw_sedan", "strut_compact"] {
        let file = format!("suspension/ref_{name}_compound_force.csv");
        let (Some(file), Some(axle)) = (reference(&file), hardpoints(name)) else { return };
        let errors = methods(&axle, &file, &page);
        println!("{name} compound, largest error [N]: {errors:.4?}");
        let (peak, multibody) = (errors["peak"], errors["multibody"]);
        assert!(multibody < 1e-6 * peak);
        for method in ["map", "simple", "map_thesis"] {
            assert!(errors[method] > 0.01 * peak && errors[method] > 1e3 * multibody, "{name} {method}");
        }
        if name == "strut_compact" {
            assert!(errors["multibody without stabiliser"] > 200.0);
        }
        let html = std::fs::read_to_string(&page).unwrap();
        assert!(html.contains("plotly.js v3") && html.contains("Tie-rod force, left: method"));
        assert!(html.contains("default-src 'none'"), "the page may fetch from elsewhere");
    }
}

#[test]
fn positions_are_compared_where_the_reference_has_them() {
    let (Some(file), Some(axle)) =
        (reference("suspension/ref_dw_sedan_compound_kin.csv"), hardpoints("dw_sedan"))
    else {
        return;
    };
    let ended = run(&["compare", "--axle", path_text(&axle), "--reference", path_text(&file)]);
    assert!(ended.status.success());
    let shown = text(&ended.stdout);
    println!("{shown}");
    assert!(
        ["lbj", "ubj", "to", "wc", "toe"]
            .iter()
            .all(|q| shown.lines().any(|l| l.starts_with(&format!("{q} "))))
    );
}

#[test]
fn curves_are_written_with_units_and_slopes() {
    let folder = TempDir::new().unwrap();
    let into = folder.path().join("deep/curves");
    let ended =
        run(&["curves", "--axle", "sedan_double_wishbone", "--output", path_text(&into), "--points", "41"]);
    assert!(ended.status.success(), "{}", text(&ended.stderr));
    let travel = Table::read(&into.join("travel.csv"));
    assert_eq!(travel.rows.len(), 41);
    let (z, toe) = (travel.column("wheel_travel_m"), travel.column("toe_rad_L"));
    let slope = travel.column("toe_rad_per_mm_L");
    for k in 1..40 {
        let difference = (toe[k + 1] - toe[k - 1]) / (1e3 * (z[k + 1] - z[k - 1]));
        assert!(
            (difference - slope[k]).abs() < 0.02 * slope[k].abs() + 2e-6,
            "{k}: {difference} {}",
            slope[k]
        );
    }
    // The published geometry's bump steer.
    assert!((toe[40].to_degrees().abs() - 1.8).abs() < 0.1, "{}", toe[40].to_degrees());
    let rack = Table::read(&into.join("rack.csv"));
    assert!(rack.has("scrub_radius_m_R") && rack.column("rack_m")[40] == 0.07);
    let map = Table::read(&into.join("kinematics_map.csv"));
    assert_eq!(map.rows.len(), 33 * 41);
    assert!(std::fs::read_to_string(into.join("curves.html")).unwrap().contains("Caster trail"));
}

#[test]
fn bad_input_is_told_whole_and_nothing_is_written() {
    let folder = TempDir::new().unwrap();
    let (input, output) = (folder.path().join("in.csv"), folder.path().join("out.csv"));
    let refused = |content: &str, axle: &str, expected: &[&str]| {
        std::fs::write(&input, content).unwrap();
        let ended =
            run(&["solve", "--axle", axle, "--input", path_text(&input), "--output", path_text(&output)]);
        let told = text(&ended.stderr);
        assert_eq!(ended.status.code(), Some(2), "{told}");
        for words in expected {
            assert!(told.contains(words), "{words} not in\n{told}");
        }
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "something was written");
    };
    refused(
        "rack,zL\n0,x\nNaN,0\n",
        "compact_strut",
        &["in.csv:1: zR: column is missing", "in.csv:2:3: zL = x", "in.csv:3:1: rack = NaN"],
    );
    refused("", "compact_strut", &["is empty"]);
    refused("rack,zL,zR\n", "compact_strut", &["has no rows"]);
    refused(
        "rack,zL,zR\n0,0\n",
        "compact_strat",
        &["did you mean `compact_strut`", "in.csv:2: has 2 fields"],
    );
    refused("rack,zL,zR\n0,0,0\n", "no/such.json", &["no such file"]);
    let broken = folder.path().join("in.csv");
    let ended = run(&[
        "solve",
        "--axle",
        "compact_strut",
        "--input",
        path_text(&broken),
        "--output",
        path_text(&output),
        "--lock-springs",
    ]);
    assert_eq!(ended.status.code(), Some(2));
    assert!(text(&ended.stderr).contains("--lock-springs: needs an axle with bushings"));
}

#[test]
fn rows_out_of_reach_are_flagged_and_the_others_solved() {
    let folder = TempDir::new().unwrap();
    let (input, output) = (folder.path().join("in.csv"), folder.path().join("out.csv"));
    std::fs::write(&input, "step,rack,zL,zR,Fzk_L\n1,0.01,0,0,4000\n2,0.9,0,0,4000\n3,0.02,0,0.01,4000\n")
        .unwrap();
    let ended = run(&[
        "solve",
        "--axle",
        "compact_strut",
        "--input",
        path_text(&input),
        "--output",
        path_text(&output),
        "--method",
        "all",
    ]);
    let told = text(&ended.stderr);
    assert_eq!(ended.status.code(), Some(1), "{told}");
    assert!(told.contains("in.csv:3: step 2 (with stabiliser)") && told.contains("tie rod"), "{told}");
    let table = Table::read(&output);
    let status = table.column("status");
    assert!(status[0] == 0.0 && status[1] > 0.0 && status[2] == 0.0, "{status:?}");
    assert!(table.rows.iter().flatten().all(|x| x.is_finite()));
    for name in
        ["tie_arb_L", "tie_noarb_R", "tie_map_L", "tie_simple_R", "tie_map_thesis_L", "rack_force_map"]
    {
        assert!(table.has(name), "{name}");
    }
}

#[test]
fn each_method_alone_gives_what_all_give() {
    let folder = TempDir::new().unwrap();
    let input = folder.path().join("in.csv");
    std::fs::write(&input, "rack,zL,zR,Fyk_L,Fzk_R\n0.03,0.01,-0.02,1500,4000\n").unwrap();
    let solve = |method: &str| {
        let output = folder.path().join(format!("{method}.csv"));
        let ended = run(&[
            "solve",
            "--axle",
            "sedan_double_wishbone",
            "--input",
            path_text(&input),
            "--output",
            path_text(&output),
            "--method",
            method,
        ]);
        assert!(ended.status.success(), "{}", text(&ended.stderr));
        Table::read(&output)
    };
    let all = solve("all");
    for method in ["multibody", "map", "simple", "map_thesis"] {
        let one = solve(method);
        for (name, value) in one.names.iter().zip(&one.rows[0]) {
            assert_eq!(all.column(name)[0], *value, "{method} {name}");
        }
        let stem = if method == "multibody" { "tie_L".to_owned() } else { format!("tie_{method}_L") };
        assert!(one.column(&stem)[0].abs() > 100.0, "{stem}");
    }
}

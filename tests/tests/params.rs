//! Live parameters: each one acts, undoing leaves no bit behind, refusals say why; on a real run the services
//! take changes over and say so, and killed askers harm nobody.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use assembly::{ServiceKind, build};
use config::ResolvedBench;
use kingpin_tests::support::kingpin;
use params::{Id, Kind, LIST, Parameter};
use regions::{Payload, RegionId};
use runtime::lockstep::Chain;
use runtime::{Bound, Model, region_specs};
use serde_json::Value;
use std::collections::hash_map::DefaultHasher;
use std::hash::{Hash, Hasher};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};
use supervisor::RunPlan;
use table::{Read, Table, TableInfo};

/// Tick of the change; the bench arms at 50, starts at 100 and is under full force from 1100 on.
const AT: u64 = 1300;
const TICKS: u64 = 1500;

/// A hash of all that rig, vehicle and suspension said, for each tick; versions of parameters left out.
fn trace(changes: &[String]) -> Vec<u64> {
    let overrides = [
        "warm_up_s=0.2".to_owned(),
        "duration_s=10.0".to_owned(),
        "rig.limits.command_force_step_n=17000".to_owned(),
        format!("parameters=[{}]", changes.join(", ")),
    ];
    let resolved = ResolvedBench::load("slalom_120", &overrides).unwrap_or_else(|p| panic!("{p}"));
    let period_s = resolved.scenario.timing.period_s();
    let info = TableInfo { run_id: 1, period_ns: resolved.scenario.timing.period_ns(), t0_ns: 1 };
    let table = Table::create_local(&region_specs(period_s), info).unwrap();
    let bind = |kind| Bound::<dyn Model>::new(build(kind, &resolved).unwrap(), &table, true).unwrap();
    let mut chain =
        Chain::new(ServiceKind::ALL.map(bind).into_iter().collect(), vec![(0, 0), (1, 0), (2, 0), (0, 1)]);
    let mut bench = table.claim_writer(RegionId::Bench as usize).unwrap();
    let mut parameters = table.claim_writer(RegionId::Parameters as usize).unwrap();
    let schedule = params::Schedule::new(&resolved).unwrap();
    let plan = RunPlan::new(resolved.scenario.ticks(), period_s, resolved.rig.limits.stop_fade_s);
    let regions =
        [RegionId::RigMeasurement, RegionId::VehicleState, RegionId::SuspensionState, RegionId::RigStatus];
    let version = regions.map(|id| {
        let columns = id.region().layout.columns();
        columns.iter().find(|c| c.name == "parameters_version").map(|c| c.word)
    });
    let mut hashes = Vec::new();
    for n in 0..TICKS {
        bench.write(n, plan.at(n).words()).unwrap();
        parameters.write(n, supervisor::parameters_at(&schedule, n).words()).unwrap();
        chain.tick(n).unwrap();
        let mut hasher = DefaultHasher::new();
        for (id, version) in regions.iter().zip(version) {
            let reader = table.reader(*id as usize);
            let mut words = vec![0; reader.words()];
            assert_eq!(reader.read(n, &mut words), Read::Ready);
            if let Some(word) = version {
                words[word] = 0;
            }
            words.hash(&mut hasher);
        }
        hashes.push(hasher.finish());
    }
    hashes
}

fn set(tick: u64, path: &str, value: f64) -> String {
    format!(r#"{{type="set", at_s={:?}, path="{path}", value={value:?}}}"#, tick as f64 * 1e-3 - 0.2)
}

fn undo(tick: u64) -> String {
    format!(r#"{{type="undo", at_s={:?}}}"#, tick as f64 * 1e-3 - 0.2)
}

/// Another value than the default.
fn other(parameter: &Parameter, default: f64) -> f64 {
    match parameter.kind {
        Kind::Number if default < parameter.max => default + 0.3 * (parameter.max - default),
        Kind::Number => default - 0.3 * (default - parameter.min),
        Kind::Switch => 1.0 - default,
        Kind::Choice(_) => 1.0,
    }
}

/// What must be so for a parameter to matter.
fn context(id: Id) -> Vec<String> {
    match id {
        Id::ForceIntegral | Id::ForceDerivative => {
            vec![set(5, "control.switches.delay_compensation", 0.0)]
        }
        Id::SteerTorqueGain | Id::SteerTorqueDamping | Id::HumanTorque => {
            vec![set(5, "human.steering_wheel_torque_n_m", 1.0), set(5, "human.mode", 2.0)]
        }
        Id::HumanAngle => vec![set(5, "human.mode", 1.0)],
        _ => Vec::new(),
    }
}

#[test]
fn every_parameter_acts_from_its_tick_on_and_not_before() {
    let defaults = params::defaults(&ResolvedBench::load("slalom_120", &[]).unwrap());
    let mut bases: Vec<(Vec<String>, Vec<u64>)> = Vec::new();
    let mut faults = Vec::new();
    for parameter in LIST {
        let context = context(parameter.id);
        if !bases.iter().any(|(known, _)| *known == context) {
            bases.push((context.clone(), trace(&context)));
        }
        let base = &bases.iter().find(|(known, _)| *known == context).unwrap().1;
        let value = other(parameter, defaults[parameter.id as usize]);
        let mut changes = context.clone();
        changes.push(set(AT, parameter.path, value));
        let changed = trace(&changes);
        match base.iter().zip(&changed).position(|(a, b)| a != b) {
            None => faults.push(format!("{} = {value} changes nothing", parameter.path)),
            Some(first) if (first as u64) < AT => {
                faults.push(format!("{} acts at {first}, before its tick", parameter.path));
            }
            Some(_) => {}
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn undo_restores_bit_identical_behaviour() {
    let defaults = params::defaults(&ResolvedBench::load("slalom_120", &[]).unwrap());
    let all = |tick: u64| -> Vec<String> {
        LIST.iter().map(|p| set(tick, p.path, other(p, defaults[p.id as usize]))).collect()
    };
    let undone = |tick: u64| vec![undo(tick); LIST.len()];
    let base = trace(&[]);
    // Everything changed and undone between two ticks: as if nothing had been.
    let mut changes = all(AT);
    changes.extend(undone(AT));
    assert!(trace(&changes) == base, "a change that was undone at once left a trace");
    // Set for a while where it has no effect (torque mode's gains in angle mode, a human who does not steer), then
    // undone: as if nothing had been, before, during and after.
    let quiet: Vec<_> = LIST
        .iter()
        .filter(|p| p.path.starts_with("control.steer.torque") || p.path.starts_with("human.steering"))
        .collect();
    let mut changes: Vec<_> =
        quiet.iter().map(|p| set(300, p.path, other(p, defaults[p.id as usize]))).collect();
    changes.extend(vec![undo(900); quiet.len()]);
    assert!(trace(&changes) == base, "what had no effect while it was set has one after it was undone");
    // Undoing is the same as setting the old values again, bit by bit, also when the change acted meanwhile.
    let mut undoing = all(AT);
    undoing.extend(undone(AT + 60));
    let mut setting = all(AT);
    setting.extend(LIST.iter().map(|p| set(AT + 60, p.path, defaults[p.id as usize])));
    let (undoing, setting) = (trace(&undoing), trace(&setting));
    assert!(undoing == setting, "undoing differs from setting the old values");
    assert!(undoing[AT as usize + 1..] != base[AT as usize + 1..], "the change acted meanwhile");
}

fn run(args: &[&str]) -> (Option<i32>, String, String) {
    let output = Command::new(kingpin()).args(args).output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (output.status.code(), text(&output.stdout), text(&output.stderr))
}

#[test]
fn a_scenario_with_bad_changes_is_refused_before_it_starts() {
    let changes = r#"parameters=[{type="set", at_s=1.0, path="unit.assist_scal", value=0.5},
        {type="set", at_s=2.0, path="unit.assist_scale", value=50.0}]"#;
    for command in [&["run", "slalom_120", "--lockstep"][..], &["check", "slalom_120"]] {
        let (code, _, said) = run(&[command, &["--set", changes]].concat());
        assert_eq!(code, Some(2), "{said}");
        assert!(said.contains("parameters[0]") && said.contains("did you mean unit.assist_scale"), "{said}");
        assert!(said.contains("parameters[1]") && said.contains("must be in [0, 1.5]"), "{said}");
    }
}

fn link_files(name: &str) -> usize {
    let prefix = format!("kingpin_link.{name}.");
    let files = std::fs::read_dir("/dev/shm").unwrap();
    files.filter(|f| f.as_ref().unwrap().file_name().to_string_lossy().starts_with(&prefix)).count()
}

#[test]
fn a_running_bench_is_tuned_says_so_and_survives_killed_askers() {
    let folder = tempfile::tempdir().unwrap();
    let name = format!("con-tune-{}", std::process::id());
    let out = folder.path().join("run");
    let bench = Command::new(kingpin())
        .args(["run", "slalom_120", "--no-report", "--duration", "600", "--operate", "--name", &name])
        .args(["--set", "rig.limits.stall_ticks=5000", "--set", "rig.limits.holding_max_s=30"])
        .args(["--set", "realtime.lock_memory=false", "--set", "realtime.cores={}"])
        .arg("--out")
        .arg(&out)
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let param = |args: &[&str]| run(&[&["param", "--name", &name, "--json"][..], args].concat());
    let begin = Instant::now();
    while param(&["list"]).0 != Some(0) {
        assert!(begin.elapsed() < Duration::from_secs(60), "the bench does not answer");
        std::thread::sleep(Duration::from_millis(100));
    }
    // Echoed by all three services.
    let (code, said, _) =
        param(&["set", "control.force.bandwidth_rad_s=90", "tyre.front.friction_scale=0.5"]);
    let answer: Value = serde_json::from_str(&said).unwrap();
    assert_eq!(code, Some(0));
    assert_eq!(answer["version"], 2);
    for service in ["rig", "vehicle", "multibody"] {
        assert!(
            answer["applied_by_tick"][service].is_u64(),
            "{service} did not say that it took it over: {answer}"
        );
    }
    for (setting, reason) in [
        ("control.force.bandwidth_rad_s=1e9", "must be in [10, 300]"),
        ("control.force.bandwidth_rad_s=on", "wrong type"),
        ("control.force.bandwith=1", "no such parameter"),
    ] {
        let (code, said, _) = param(&["set", setting]);
        assert!(code == Some(2) && said.contains(reason), "{setting}: {said}");
    }
    // Askers killed at any moment.
    let before = link_files(&name);
    for round in 0..20 {
        let mut asker = Command::new(kingpin())
            .args(["param", "list", "--name", &name])
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        std::thread::sleep(Duration::from_millis(3 * round));
        asker.kill().unwrap();
        asker.wait().unwrap();
    }
    assert_eq!(param(&["undo"]).0, Some(0), "the bench still answers");
    let after = link_files(&name);
    println!("files of the link before and after 20 killed askers: {before}, {after}");
    assert!(after <= before + 4, "killed askers leave files: {before} before, {after} after");
    let (code, said, _) = param(&["diff"]);
    assert!(code == Some(0) && said.contains(r#""differences": []"#), "{said}");
    assert_eq!(run(&["operate", "end", "--name", &name]).0, Some(0));
    bench.wait_with_output().unwrap();
    assert_eq!(link_files(&name), 0, "the supervisor removes the link");
    let log = record::LogReader::open(&out).unwrap();
    let changed: Vec<_> = log.events.iter().filter(|e| e.kind == "parameter").collect();
    assert_eq!(changed.len(), 4, "two changes and their undoing are in the log: {changed:?}");
    assert_eq!(changed[0].detail["path"], "control.force.bandwidth_rad_s");
    let seen = log.column_u64("vehicle_state", "parameters_version").unwrap();
    assert!(
        seen.is_sorted() && seen.contains(&2) && seen.last() == Some(&3),
        "the versions are echoed in order"
    );
}

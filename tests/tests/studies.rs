//! Studies and the Python package: the same table whoever makes it and whatever dies on the way.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use kingpin_tests::support::{kingpin, peer, workspace};
use std::collections::BTreeMap;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant, SystemTime};

/// A sweep of the shipped study `quick` into a directory.
fn sweep(out: &Path, runs: u32) -> Command {
    let mut command = Command::new(kingpin());
    command.args(["sweep", "quick", "--jobs", "2", "--json", "--set", &format!("sampling.runs={runs}")]);
    command.arg("--out").arg(out).stdout(Stdio::piped()).stderr(Stdio::null());
    command
}

/// Finished runs and when each was written.
fn journal(out: &Path) -> BTreeMap<PathBuf, SystemTime> {
    let entries = std::fs::read_dir(out.join("journal")).into_iter().flatten();
    let paths = entries.map(|entry| entry.unwrap().path());
    let kept = paths.filter(|path| path.extension().is_some_and(|e| e == "json"));
    // One may be renamed in between.
    kept.filter_map(|path| Some((path.clone(), path.metadata().ok()?.modified().ok()?))).collect()
}

/// Starts a sweep, waits for so many finished runs, sends a signal to it (or its whole group), and waits for its end.
fn interrupted(out: &Path, runs: u32, finished: usize, signal: &str, group: bool) {
    let mut child = sweep(out, runs).process_group(0).spawn().unwrap();
    let begin = Instant::now();
    while journal(out).len() < finished {
        assert!(child.try_wait().unwrap().is_none(), "ended before it was interrupted");
        assert!(begin.elapsed() < Duration::from_secs(600), "no run is finished");
        std::thread::sleep(Duration::from_millis(5));
    }
    let target = if group { format!("-{}", child.id()) } else { child.id().to_string() };
    assert!(Command::new("kill").args([signal, "--", &target]).status().unwrap().success());
    let status = child.wait().unwrap();
    assert!(!status.success(), "{status}");
    if signal == "-INT" {
        assert_eq!(status.code(), Some(130));
    }
    // Workers of a killed sweep end with the run they are at.
    let begin = Instant::now();
    loop {
        let before = journal(out);
        std::thread::sleep(Duration::from_millis(1500));
        if journal(out) == before || begin.elapsed() > Duration::from_secs(60) {
            break;
        }
    }
}

/// Ends a study's sweep; what it says.
fn finish(out: &Path, runs: u32) -> serde_json::Value {
    let done = sweep(out, runs).output().unwrap();
    let said: serde_json::Value = serde_json::from_slice(&done.stdout).unwrap();
    assert!(done.status.success(), "{said}");
    said
}

#[test]
fn an_interrupted_sweep_goes_on_without_repeating_a_run() {
    const RUNS: u32 = 40;
    let folder = tempfile::tempdir().unwrap();
    let (whole, broken) = (folder.path().join("whole"), folder.path().join("broken"));
    interrupted(&broken, RUNS, 6, "-KILL", true);
    let first = journal(&broken);
    assert!(first.len() < RUNS as usize, "killed too late: {}", first.len());
    interrupted(&broken, RUNS, first.len() + 6, "-INT", false);
    let second = journal(&broken);
    for (path, written) in &first {
        assert_eq!(second.get(path), Some(written), "{}: made again", path.display());
    }
    let said = finish(&broken, RUNS);
    assert_eq!(said["taken_over"].as_u64().unwrap(), second.len() as u64, "{said}");
    assert_eq!(said["made_now"].as_u64().unwrap(), u64::from(RUNS) - second.len() as u64, "{said}");
    let last = journal(&broken);
    assert_eq!(last.len(), RUNS as usize);
    for (path, written) in &second {
        assert_eq!(last.get(path), Some(written), "{}: made again", path.display());
    }
    finish(&whole, RUNS);
    let table = |out: &Path| std::fs::read_to_string(out.join("results.csv")).unwrap();
    assert_eq!(table(&broken), table(&whole));
    for out in [&broken, &whole] {
        let parquet = std::fs::read(out.join("results.parquet")).unwrap();
        assert_eq!(parquet, std::fs::read(whole.join("results.parquet")).unwrap());
        assert!(parquet.starts_with(b"PAR1") && parquet.ends_with(b"PAR1"));
    }
    // Runs out of range are rows with file, key, value and rule; the others have figures.
    let table = table(&whole);
    let rows: Vec<&str> = table.lines().skip(1).collect();
    let (wrong, right): (Vec<&str>, Vec<&str>) = rows.iter().partition(|row| row.contains("-1"));
    let wrong: Vec<&&str> = wrong.iter().filter(|row| row.contains("sliding_n = -1")).collect();
    assert!(!wrong.is_empty() && right.len() > 20, "{table}");
    assert!(rows.len() >= RUNS as usize);
    let page = std::fs::read_to_string(whole.join("report.html")).unwrap();
    assert!(page.contains("Correlation with the parameters") && page.contains("sliding_n = -1"));
    // Another study does not take over these runs.
    let mut other = sweep(&whole, RUNS + 1);
    assert_eq!(other.output().unwrap().status.code(), Some(2));
}

#[test]
fn a_worker_that_dies_costs_only_the_run_it_was_at() {
    const RUNS: u32 = 24;
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let mut child = sweep(&out, RUNS).spawn().unwrap();
    let mut killed = 0;
    while child.try_wait().unwrap().is_none() {
        if killed < 2 && journal(&out).len() > 4 * (killed + 1) {
            let id = child.id().to_string();
            let found = Command::new("pgrep").args(["-P", &id]).output().unwrap();
            if let Some(worker) = String::from_utf8_lossy(&found.stdout).lines().next() {
                let done = Command::new("kill").args(["-KILL", worker]).status().unwrap();
                killed += usize::from(done.success());
            }
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    assert!(killed > 0 && child.wait().unwrap().success());
    assert_eq!(journal(&out).len(), RUNS as usize);
    let table = std::fs::read_to_string(out.join("results.csv")).unwrap();
    assert!(!table.contains("worker died"), "a run that was killed once is made again: {table}");
}

#[test]
fn a_run_in_memory_has_the_bits_of_a_lockstep_run() {
    let folder = tempfile::tempdir().unwrap();
    let overrides = ["duration_s=1.2".to_owned(), "warm_up_s=0.5".to_owned()];
    let mut command = Command::new(kingpin());
    command
        .args(["run", "slalom_120", "--lockstep", "--no-report", "--out", "run"])
        .current_dir(folder.path());
    for set in &overrides {
        command.args(["--set", set]);
    }
    assert!(command.output().unwrap().status.success());
    let logged = record::LogReader::open(&folder.path().join("run")).unwrap();
    let resolved = config::ResolvedBench::load("slalom_120", &overrides).unwrap();
    let made = study::run(&resolved, |_, _| Ok(())).unwrap();
    let differences = record::compare(&made, &logged);
    assert!(differences.is_empty(), "{differences:?}");
    let (a, b) = (made.column("rig_status", "tick").unwrap(), logged.column("rig_status", "tick").unwrap());
    assert_eq!(a, b);
    // Another seed is seen.
    let other =
        config::ResolvedBench::load("slalom_120", &[overrides.to_vec(), vec!["seed=9".to_owned()]].concat());
    assert!(!record::compare(&study::run(&other.unwrap(), |_, _| Ok(())).unwrap(), &logged).is_empty());
}

/// The wheel in a fresh virtual environment, with the peers' modules beside it.
fn python_with_the_wheel(peers: &Path, folder: &Path) -> PathBuf {
    let run = |command: &mut Command| {
        let done = command.output().unwrap();
        let said =
            String::from_utf8_lossy(&done.stdout).into_owned() + &String::from_utf8_lossy(&done.stderr);
        assert!(done.status.success(), "{command:?}: {said}");
        String::from_utf8_lossy(&done.stdout).trim().to_owned()
    };
    // The executable first: both share most of what is compiled.
    kingpin();
    run(Command::new(peers)
        .args(["-m", "maturin", "build", "--release", "--out"])
        .arg(folder)
        .arg("--manifest-path")
        .arg(workspace().join("shared/python/Cargo.toml"))
        .current_dir(workspace()));
    let mut entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let wheel = entries.find(|path| path.extension().is_some_and(|e| e == "whl")).unwrap();
    let name = wheel.file_name().unwrap().to_string_lossy().into_owned();
    assert!(name.contains("abi3"), "{name}");
    let fresh = folder.join("venv");
    run(Command::new(peers).args(["-m", "venv"]).arg(&fresh));
    let python = fresh.join("bin/python");
    run(Command::new(&python)
        .args(["-m", "pip", "install", "--quiet", "--no-deps", "--no-index"])
        .arg(&wheel));
    let site = "import sysconfig; print(sysconfig.get_path('purelib'))";
    let (ours, theirs) =
        (run(Command::new(&python).args(["-c", site])), run(Command::new(peers).args(["-c", site])));
    std::fs::write(Path::new(&ours).join("peers.pth"), theirs).unwrap();
    python
}

/// What is said of the package from outside: logs, runs, errors, threads, signals.
const PACKAGE: &str = r#"
import json, os, signal, subprocess, sys, threading, time
import numpy as np
import pandas
import kingpin

log_directory, executable = sys.argv[1:3]
overrides = {"warm_up_s": 0.5, "duration_s": 1.2}
run = kingpin.run("slalom_120", overrides)
log = kingpin.open_log(log_directory)
assert log.scenario == "slalom_120" and log.period_s == 1e-3 and "rig_status.state" in log
# The same bits as the command's lockstep run, in every signal of the physics.
seen = 0
for name in log.select("rig_measurement", "vehicle_state", "suspension_state", "rig_status"):
    if "wall" in name:
        continue
    a, b = log[name], run[name]
    assert a.value.tobytes() == b.value.tobytes() and a.unit == b.unit and a.comment, name
    seen += 1
assert seen > 100, seen
assert log["vehicle_state.acceleration_m_s2.y"].unit == "m/s^2"
assert log["rig_status.state"].value.dtype == np.uint64
frame = run.to_pandas(["vehicle_state.position_m", "*tie_rod_force_n.left"])
assert isinstance(frame, pandas.DataFrame) and len(frame) == len(run["vehicle_state.tick"])
assert frame.attrs["units"]["vehicle_state.position_m.x"] == "m"
assert (frame["vehicle_state.position_m.x"].to_numpy() == run["vehicle_state.position_m.x"].value).all()
peak = run.metrics["peaks"]["steering_wheel_torque_n_m"]
assert np.isclose(peak, np.nanmax(np.abs(run["rig_measurement.steering_wheel_torque_n_m"].value)))
try:
    log["vehicle_state.roll"]
except kingpin.LogError as error:
    assert "roll_rad" in str(error), error
else:
    raise AssertionError

# Wrong input: all at once, each with its key, value and rule.
with open("wrong.toml", "w") as file:
    file.write('extends = "slalom_120"\n\nduration_s = -1.0\nspeeed = 3\n')
try:
    kingpin.run("./wrong.toml", {"car.body.sprung_mass_kg": -3})
except kingpin.ConfigError as error:
    by_key = {violation["key"]: violation for violation in error.violations}
    assert by_key["duration_s"]["line"] == 3 and by_key["duration_s"]["file"].endswith("wrong.toml"), by_key
    assert float(by_key["duration_s"]["value"]) == -1 and by_key["duration_s"]["rule"], by_key
    assert any("speeed" in key for key in by_key), by_key
    assert any("sprung_mass_kg" in key for key in by_key), by_key
    assert isinstance(error, kingpin.KingpinError)
else:
    raise AssertionError

# Another thread runs meanwhile.
counted = 0
over = threading.Event()
def count():
    global counted
    while not over.is_set():
        counted += 1
        time.sleep(0.001)
thread = threading.Thread(target=count)
thread.start()
again = kingpin.run("slalom_120", overrides)
over.set()
thread.join()
assert counted > 20, counted
assert again["vehicle_state.yaw_rad"].value.tobytes() == run["vehicle_state.yaw_rad"].value.tobytes()

# Ctrl-C ends a run. Who started this in the background may have had the signal ignored.
signal.signal(signal.SIGINT, signal.default_int_handler)
begin = time.monotonic()
timer = threading.Timer(1.5, lambda: os.kill(os.getpid(), signal.SIGINT))
timer.start()
try:
    kingpin.run("growing_slalom_80", duration_s=600.0)
except KeyboardInterrupt:
    assert time.monotonic() - begin < 60
else:
    raise AssertionError

# A tyre to the digits of the command.
alpha = np.linspace(-0.1, 0.1, 11)
ours = kingpin.evaluate_tyre("car_205_60r15", 4000.0, alpha_rad=alpha, gamma_rad=0.02)
with open("in.csv", "w") as file:
    file.write("Fz_N,kappa,alpha_rad,gamma_rad,phit_1pm,Vx_mps\n")
    file.writelines(f"4000.0,0.0,{a!r},0.02,0.0,16.7\n" for a in alpha.tolist())
subprocess.run([executable, "tyre", "evaluate", "--tir", "car_205_60r15", "--input", "in.csv", "--output", "out.csv"], check=True)
theirs = pandas.read_csv("out.csv", float_precision="round_trip")
for column in theirs.columns:
    assert (theirs[column].to_numpy() == ours[column]).all(), column

# A suspension as the command solves it.
axle = kingpin.suspension("sedan_double_wishbone")
rack = np.linspace(0.0, 0.02, 5)
force = np.zeros((5, 2, 3)); force[:, 0, 1] = 1000.0
solved = axle.solve(rack_m=rack, wheel_height_m=[0.01, -0.01], wheel_force_n=force)
with open("poses.csv", "w") as file:
    file.write("rack,zL,zR,Fyk_L\n")
    file.writelines(f"{r!r},0.01,-0.01,1000.0\n" for r in rack.tolist())
subprocess.run([executable, "suspension", "solve", "--axle", "sedan_double_wishbone", "--input", "poses.csv",
                "--output", "solved.csv", "--method", "multibody"], check=True)
table = pandas.read_csv("solved.csv", float_precision="round_trip")
tie = [column for column in table.columns if column in ("tie_L", "tie_arb_L")][0]
assert (table[tie].to_numpy() == solved["tie_rod_force_n.left"]).all(), (table[tie], solved["tie_rod_force_n.left"])
assert (table["toe_L"].to_numpy() == solved["toe_rad.left"]).all()
print("package", seen)
"#;

/// 200 runs of the study: by the command, and on two Dask workers of which one is killed in the middle.
const CLUSTER: &str = r#"
import os, signal, sys, time
import pandas
import kingpin
from distributed import Client, LocalCluster

def main():
    runs, local = int(sys.argv[1]), sys.argv[2]
    killed = []
    done = 0
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster, Client(cluster) as client:
        def progress(finished, all_runs):
            nonlocal done
            done = finished
            if finished > all_runs // 3 and not killed:
                pid = next(iter(client.run(os.getpid).values()))
                os.kill(pid, signal.SIGKILL)
                killed.append(pid)
        table = kingpin.sweep("quick", client=client, out="cluster", overrides={"sampling.runs": runs}, progress=progress)
    assert killed and done == runs == len(table), (killed, done, len(table))
    assert open("cluster/results.csv").read() == open(local + "/results.csv").read()
    a, b = pandas.read_parquet("cluster/results.parquet"), pandas.read_parquet(local + "/results.parquet")
    pandas.testing.assert_frame_equal(a, b, check_exact=True)
    assert a["error"].ne("").sum() == len(table.errors) > 0
    assert not any("worker" in error for error in table.errors.values()), table.errors
    print("runs", len(table), "tasks", table.tasks, "with an error", len(table.errors))

if __name__ == "__main__":
    main()
"#;

#[test]
fn the_wheel_in_a_fresh_environment_does_what_the_commands_do() {
    let Some(peers) = peer("maturin, pandas, pyarrow, distributed, matplotlib") else { return };
    let folder = tempfile::tempdir().unwrap();
    let python = python_with_the_wheel(&peers, folder.path());
    let script = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        path
    };
    let call = |script: &Path, arguments: &[&str]| {
        let done = Command::new(&python)
            .arg(script)
            .args(arguments)
            .current_dir(folder.path())
            .env("KINGPIN_EXAMPLE_DURATION_S", "6")
            .env("KINGPIN_EXAMPLE_RUNS", "12")
            .env("MPLBACKEND", "Agg")
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&done.stdout).into_owned();
        assert!(done.status.success(), "{script:?}: {said}{}", String::from_utf8_lossy(&done.stderr));
        said
    };
    let name = format!("py-{}", std::process::id());
    let run =
        ["run", "slalom_120", "--lockstep", "--no-report", "--set", "warm_up_s=0.5", "--duration", "1.2"];
    let done = Command::new(kingpin())
        .args(run)
        .args(["--out", "run", "--name", &name])
        .current_dir(folder.path())
        .output()
        .unwrap();
    assert!(done.status.success());
    let executable = kingpin();
    let said = call(&script("package.py", PACKAGE), &["run", executable.to_str().unwrap()]);
    assert!(said.contains("package "), "{said}");
    // Examples.
    let examples = workspace().join("shared/python/examples");
    for example in ["weave.py", "parts.py", "study.py"] {
        call(&examples.join(example), &[]);
    }
    let picture = std::fs::read(folder.path().join("weave.png")).unwrap();
    assert!(picture.starts_with(b"\x89PNG") && picture.len() > 10_000);
    // The table of the command and of the cluster.
    const RUNS: u32 = 200;
    let local = folder.path().join("local");
    finish(&local, RUNS);
    let said = call(&script("cluster.py", CLUSTER), &[&RUNS.to_string(), local.to_str().unwrap()]);
    assert!(said.contains("runs 200"), "{said}");
}

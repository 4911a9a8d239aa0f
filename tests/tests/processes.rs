//! The process set in real time: what it leaves, what kills do to it, what it refuses. No timed assertions:
//! the machine may be slow, the order of events may not change.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use kingpin_tests::support::{self, kingpin, left_over, show};
use record::LogReader;
use regions::model_flags;
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::{Mutex, MutexGuard};
use std::time::Duration;

/// Longest wait for anything.
const PATIENCE: Duration = Duration::from_secs(60);

struct Run {
    child: Child,
    name: String,
    out: PathBuf,
}

/// A paced run of `duration` seconds. Long safety limits: a slow machine must not trip it.
fn start(name: &str, folder: &Path, duration: &str, more: &[&str]) -> Run {
    let out = folder.join(name);
    let child = Command::new(kingpin())
        .args(["run", "slalom_120", "--json", "--no-report", "--duration", duration, "--name", name])
        .args(["--set", "rig.limits.stall_ticks=5000", "--set", "rig.limits.holding_max_s=30"])
        .args(["--set", "realtime.lock_memory=false"])
        .args(more)
        .arg("--out")
        .arg(&out)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    Run { child, name: name.to_owned(), out }
}

fn until<T>(what: &str, look: impl FnMut() -> Option<T>) -> T {
    support::until(what, PATIENCE, look)
}

impl Run {
    /// Waits until the rig is in one of `states`.
    fn until_state(&self, states: &[u64]) {
        until(&format!("state {states:?} of {}", self.name), || {
            let status = show(&self.name, "rig_status")?;
            states.contains(&status["content"]["state"].as_u64()?).then_some(())
        });
    }

    fn writer(&self, region: &str) -> u64 {
        until("a writer", || show(&self.name, region)?["header"]["writer_pid"].as_u64())
    }

    fn epoch(&self, region: &str) -> u64 {
        until("an epoch", || show(&self.name, region)?["header"]["epoch"].as_u64())
    }

    fn finish(self) -> (Output, Value) {
        let output = self.child.wait_with_output().unwrap();
        let summary = serde_json::from_slice(&output.stdout).unwrap_or(Value::Null);
        (output, summary)
    }
}

fn kill(pid: u64, signal: Signal) {
    kill_process(Pid::from_raw(i32::try_from(pid).unwrap()).unwrap(), signal).unwrap();
}

/// A bench name that no other run of these tests uses.
fn own(name: &str) -> String {
    format!("{name}-{}", std::process::id())
}

const IDLE: u64 = 1;
const RUNNING: u64 = 4;
const TRIPPED: u64 = 8;

/// Real-time runs one after the other: together they would stall each other.
static ALONE: Mutex<()> = Mutex::new(());

fn alone() -> MutexGuard<'static, ()> {
    ALONE.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
}

#[test]
fn a_run_leaves_log_and_summary_and_nothing_in_memory() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let run = start(&own("t-plain"), folder.path(), "5", &[]);
    run.until_state(&[RUNNING]);
    // The browser reads the live table: all regions, with their writers alive.
    let all = show(&own("t-plain"), "").unwrap();
    let regions = all["regions"].as_array().unwrap();
    assert_eq!(regions.len(), regions::REGIONS.len());
    assert!(
        regions
            .iter()
            .filter(|r| {
                let region = r["region"].as_str().unwrap();
                !["parameters", "faults", "can"].contains(&region) && !region.starts_with("fmu_")
            })
            .all(|r| r["writer_alive"] == true),
        "{all}"
    );
    let out = run.out.clone();
    let (output, summary) = run.finish();
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(summary["run"]["end_state"], "idle");
    assert_eq!(left_over(&own("t-plain")), Vec::<String>::new());
    let log = LogReader::open(&out).unwrap();
    assert!(log.intact());
    assert!(log.region("vehicle_state").unwrap().ticks.len() > 4000);
    assert!(out.join("summary.json").is_file());
}

#[test]
fn a_logger_killed_and_away_for_two_seconds_leaves_no_gap_and_its_file_is_mended() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let run = start(&own("t-logger"), folder.path(), "9", &["--restart-delay", "2"]);
    run.until_state(&[RUNNING]);
    let written =
        until("the log", || show(&own("t-logger"), "logger_status")?["content"]["written_tick"].as_u64());
    kill(run.writer("logger_status"), Signal::KILL);
    let at_kill = until("the rig", || show(&own("t-logger"), "rig_status")?["tick"].as_u64());
    let out = run.out.clone();
    let (output, summary) = run.finish();
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(summary["run"]["restarts"]["logger"], 1);

    let first = LogReader::open(&out.join("log.mcap")).unwrap();
    let (_, last) = first.tick_range().unwrap();
    assert!(!first.intact() && last + 1 >= written);
    println!("killed at about tick {at_kill}: the first file ends at tick {last}");
    let both = LogReader::open(&out).unwrap();
    for region in ["rig_measurement", "vehicle_state", "suspension_state", "rig_status"] {
        let region = both.region(region).unwrap();
        let (from, to) = (region.ticks[0], *region.ticks.last().unwrap());
        // Ticks that a service itself skipped are not in the table either.
        let skipped = region.missing_count();
        let lost = summary["log"]["lost_count"].as_u64().unwrap_or(0);
        assert!(skipped < 500 && lost == 0, "{}: {from}..{to} misses {skipped}", region.name);
        assert!(region.ticks.windows(2).all(|w| w[0] < w[1]), "{}: in order, none twice", region.name);
        let around: Vec<_> = region.ticks.iter().filter(|t| (last - 20..last + 20).contains(t)).collect();
        assert!(around.len() >= 38, "{}: a gap where the files meet: {around:?}", region.name);
    }
    let mended = out.join("mended.mcap");
    let output =
        Command::new(kingpin()).arg("recover").arg(out.join("log.mcap")).arg("-o").arg(&mended).output();
    assert!(output.unwrap().status.success());
    assert!(LogReader::open(&mended).unwrap().intact());
}

#[test]
fn killed_models_resume_from_their_checkpoints_and_the_loop_comes_back() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let run = start(&own("t-kill"), folder.path(), "9", &[]);
    run.until_state(&[RUNNING]);
    for region in ["vehicle_state", "suspension_state"] {
        kill(run.writer(region), Signal::KILL);
        until("the restart", || (run.epoch(region) >= 2).then_some(()));
        run.until_state(&[RUNNING]);
    }
    let out = run.out.clone();
    let (output, summary) = run.finish();
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(summary["run"]["restarts"]["vehicle"], 1);
    assert_eq!(summary["run"]["restarts"]["multibody"], 1);
    let log = LogReader::open(&out).unwrap();
    // Model time went on: position is continuous across the gap, to what a tick at 33 m/s explains.
    let ticks = &log.region("vehicle_state").unwrap().ticks;
    let x = log.column("vehicle_state", "position_m.x").unwrap();
    let flags = log.column_u64("vehicle_state", "flags").unwrap();
    for (i, pair) in x.windows(2).enumerate() {
        // A vehicle whose own input is stale (the host stalled the rig) holds its outputs, and says so.
        if flags[i + 1] & model_flags::STALE != 0 {
            assert!((pair[1] - pair[0]).abs() < 1e-9);
            continue;
        }
        let count = (ticks[i + 1] - ticks[i]) as f64;
        let jump = pair[1] - pair[0] - 0.0333 * count;
        assert!(jump.abs() < 0.01 * count, "a jump of {jump} m behind tick {}", ticks[i]);
    }
    let state = log.column_u64("rig_status", "state").unwrap();
    assert!(state.contains(&5), "the rig held while the inputs were stale");
    assert!(!state.contains(&8), "and did not trip");
    assert_eq!(left_over(&own("t-kill")), Vec::<String>::new());
}

#[test]
fn ctrl_c_stops_the_rig_softly_and_a_second_supervisor_is_refused() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let run = start(&own("t-stop"), folder.path(), "60", &[]);
    run.until_state(&[RUNNING]);
    let second = Command::new(kingpin())
        .args(["run", "slalom_120", "--name", &own("t-stop"), "--out"])
        .arg(folder.path().join("second"))
        .output()
        .unwrap();
    assert_eq!(second.status.code(), Some(3), "{}", String::from_utf8_lossy(&second.stderr));
    assert!(!folder.path().join("second").exists());
    let cleaned = Command::new(kingpin()).args(["clean", "--name", &own("t-stop")]).output().unwrap();
    assert_eq!(cleaned.status.code(), Some(3), "a live bench is never cleaned away");

    kill(u64::from(run.child.id()), Signal::INT);
    let out = run.out.clone();
    let (output, summary) = run.finish();
    assert_eq!(output.status.code(), Some(130), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(summary["run"]["end_state"], "idle");
    let log = LogReader::open(&out).unwrap();
    let state = log.column_u64("rig_status", "state").unwrap();
    assert!(state.contains(&7), "through stopping");
    assert_eq!(left_over(&own("t-stop")), Vec::<String>::new());
}

#[test]
fn without_its_supervisor_the_rig_stops_safely_and_what_is_left_can_be_read_and_cleaned() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let mut run = start(&own("t-orphan"), folder.path(), "60", &[]);
    run.until_state(&[RUNNING]);
    let rig = run.writer("rig_status");
    kill(u64::from(run.child.id()), Signal::KILL);
    run.child.wait().unwrap();
    // Ten seconds without a word: stopping, idle (a rig that tripped is safe already); then the services end.
    run.until_state(&[IDLE, TRIPPED]);
    until("the services' end", || (!Path::new(&format!("/proc/{rig}")).exists() || ended(rig)).then_some(()));
    until("the last writer", || {
        let all = show(&own("t-orphan"), "")?;
        all["regions"].as_array()?.iter().all(|r| r["writer_alive"] == false).then_some(())
    });
    let status = show(&own("t-orphan"), "rig_status").expect("the left-over table is readable");
    assert_eq!(status["content"]["force_fade_ratio"].as_f64(), Some(0.0));
    let cleaned = Command::new(kingpin()).args(["clean", "--name", &own("t-orphan")]).output().unwrap();
    assert_eq!(cleaned.status.code(), Some(0), "{}", String::from_utf8_lossy(&cleaned.stderr));
    assert_eq!(left_over(&own("t-orphan")), Vec::<String>::new());
}

/// A process that has ended but that nobody has waited for yet.
fn ended(pid: u64) -> bool {
    std::fs::read_to_string(format!("/proc/{pid}/stat"))
        .is_ok_and(|stat| stat.rsplit(')').next().is_some_and(|rest| rest.trim_start().starts_with('Z')))
}

/// Python's MCAP and ROS 2 decoders read every region of a real run as it is.
#[test]
fn python_decodes_every_region() {
    let python = std::env::var_os("KINGPIN_PEERS").unwrap_or_else(|| "python3".into());
    let modules = Command::new(&python).args(["-c", "import mcap, mcap_ros2"]).output();
    if !modules.is_ok_and(|output| output.status.success()) {
        let missing = "Python with the packages in tests/peers.txt (KINGPIN_PEERS names the interpreter)";
        assert!(std::env::var("CI").as_deref() != Ok("true"), "missing: {missing}");
        println!("SKIPPED: missing: {missing}");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("run");
    let output = Command::new(kingpin())
        .args(["run", "slalom_120", "--lockstep", "--duration", "4", "--no-report", "--out"])
        .arg(&out)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let script = r#"
import json, sys
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
count, last = {}, {}
with open(sys.argv[1], "rb") as f:
    for schema, channel, message, ros in make_reader(f, decoder_factories=[DecoderFactory()]).iter_decoded_messages(
            topics=[t for t in sys.argv[2].split(",")]):
        count[channel.topic] = count.get(channel.topic, 0) + 1
        last[channel.topic] = ros
v = last["/vehicle_state"]
print(json.dumps({"count": count, "x": v.position_m[0], "tick": v.tick, "fz": v.tyre_force_n[2]}))
"#;
    let topics: Vec<_> =
        regions::REGIONS.iter().filter(|r| r.logged()).map(|r| format!("/{}", r.name)).collect();
    let output = Command::new(&python)
        .args(["-c", script])
        .arg(out.join("log.mcap"))
        .arg(topics.join(","))
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let decoded: Value = serde_json::from_slice(&output.stdout).unwrap();
    let log = LogReader::open(&out).unwrap();
    for region in log.regions() {
        let count = decoded["count"][format!("/{}", region.name)].as_u64().unwrap_or(0);
        assert_eq!(count, region.ticks.len() as u64, "{}", region.name);
    }
    let x = log.column("vehicle_state", "position_m.x").unwrap();
    assert_eq!(decoded["x"].as_f64(), x.last().copied());
    let fz = log.column("vehicle_state", "tyre_force_n.fl_z").unwrap();
    assert_eq!(decoded["fz"].as_f64(), fz.last().copied());
}

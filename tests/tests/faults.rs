//! Faults: campaigns, disks, supervisors, permissions. No timed assertions: whatever the host does, a reaction is
//! either the expected one or said to be the host's.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout, missing_docs)]

use kingpin_tests::support::{self, kingpin, left_over, show};
use record::LogReader;
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;
use std::os::unix::fs::PermissionsExt;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::{Mutex, MutexGuard};
use std::time::Duration;

/// Longest wait for anything.
const PATIENCE: Duration = Duration::from_secs(90);

/// Real-time runs one after the other: together they would stall each other.
static ALONE: Mutex<()> = Mutex::new(());

fn alone() -> MutexGuard<'static, ()> {
    ALONE.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
}

fn own(name: &str) -> String {
    format!("{name}-{}", std::process::id())
}

fn until<T>(what: &str, look: impl FnMut() -> Option<T>) -> T {
    support::until(what, PATIENCE, look)
}

fn start(name: &str, out: &Path, duration: &str, more: &[&str]) -> Child {
    Command::new(kingpin())
        .args(["run", "slalom_120", "--json", "--no-report", "--duration", duration, "--name", name])
        .args(["--set", "warm_up_s=0.5", "--set", "rig.limits.stall_ticks=5000"])
        .args(["--set", "rig.limits.holding_max_s=30", "--set", "realtime.lock_memory=false"])
        .args(more)
        .arg("--out")
        .arg(out)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

fn until_running(name: &str) {
    until("running", || {
        let status = show(name, "rig_status")?;
        (status["content"]["state"].as_u64()? == 4).then_some(())
    });
}

fn writer(name: &str, region: &str) -> u64 {
    until("a writer", || show(name, region)?["header"]["writer_pid"].as_u64())
}

fn kill(pid: u64, signal: Signal) {
    kill_process(Pid::from_raw(i32::try_from(pid).unwrap()).unwrap(), signal).unwrap();
}

fn json(output: &Output) -> Value {
    serde_json::from_slice(&output.stdout).unwrap_or_else(|e| {
        panic!("{e}: {}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr))
    })
}

fn campaign(name: &str, campaign: &str, out: &Path, more: &[&str]) -> (Output, Value) {
    let output = Command::new(kingpin())
        .args(["fault", campaign, "--json", "--name", name])
        .args(more)
        .arg("--out")
        .arg(out)
        .output()
        .unwrap();
    let summary = json(&output);
    (output, summary)
}

fn failures(summary: &Value) -> String {
    let judged = summary["judgements"].as_array().into_iter().flatten();
    let failed: Vec<_> = judged.filter(|j| j["outcome"] == "failed").collect();
    format!("{failed:#?} {} {}", summary["run_faults"], summary["stepped_again"])
}

/// With `CI=true` all thirty of the shipped campaign; else six of them, so that the tests stay quick.
#[test]
fn seeded_kills_in_real_time_are_all_survived() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let name = own("t-kills");
    let all: &[&str] = &[];
    let few = ["--set", "fault[0].count=6", "--set", "faults_per_run=6"];
    let more = if std::env::var("CI").as_deref() == Ok("true") { all } else { &few };
    let (output, summary) = campaign(&name, "kills_30", &folder.path().join("f"), more);
    assert_eq!(output.status.code(), Some(0), "{}", failures(&summary));
    assert_eq!(summary["passed"], true);
    assert_eq!(summary["failed_count"], 0);
    for service in ["vehicle", "multibody"] {
        assert_eq!(summary["stepped_again"][service]["different"], 0);
        assert!(summary["stepped_again"][service]["ticks"].as_u64().unwrap() > 1000);
    }
    assert!(folder.path().join("f/faults.html").is_file());
    assert_eq!(left_over(&name), Vec::<String>::new());
}

/// What another program does to the memory of the table costs at most the ticks that it hits.
#[test]
fn spoilt_memory_is_survived_in_every_place_of_a_region() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let name = own("t-spoilt");
    let (output, summary) = campaign(&name, "spoilt_memory", &folder.path().join("f"), &[]);
    assert_eq!(output.status.code(), Some(0), "{}", failures(&summary));
    let places = summary["judgements"].as_array().unwrap().iter().filter(|j| j["outcome"] == "passed");
    assert_eq!(places.count(), 34);
    assert_eq!(left_over(&name), Vec::<String>::new());
}

#[test]
fn a_lockstep_campaign_gives_the_same_bits_twice_and_every_reaction_is_the_expected_one() {
    let folder = tempfile::tempdir().unwrap();
    let name = own("t-lock");
    let (output, summary) = campaign(&name, "lockstep_mix", &folder.path().join("f"), &[]);
    assert_eq!(output.status.code(), Some(0), "{}", failures(&summary));
    assert_eq!(summary["bit_identical_twice"], true);
    assert_eq!(summary["host_stalled_count"], 0);
    assert!(summary["passed_count"].as_u64().unwrap() >= 30);
}

#[test]
fn a_campaign_that_makes_no_sense_is_refused_with_all_that_is_wrong() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("bad.toml");
    let text = std::fs::read_to_string(
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../schemas/campaigns/lockstep_mix.toml"),
    )
    .unwrap();
    let text = text.replacen("settle_s = 0.5", "settle_s = -1.0", 1).replacen(
        "targets = [\"rig\", \"vehicle\", \"multibody\"]",
        "targets = [\"logger\", \"vehicel\"]",
        1,
    );
    std::fs::write(&file, text).unwrap();
    let (output, problems) = campaign("t-bad", file.to_str().unwrap(), &folder.path().join("f"), &[]);
    assert_eq!(output.status.code(), Some(2));
    let all = problems["violations"].as_array().unwrap();
    assert!(all.iter().any(|v| v["key"] == "settle_s" && v["line"].as_u64().unwrap() > 0), "{problems}");
    assert!(all.iter().any(|v| v["key"].as_str().unwrap().contains("targets")), "{problems}");
    assert!(!folder.path().join("f").exists(), "nothing was started");
}

/// The whole life without a supervisor: the loop runs on, another takes over, and what is asked of it counts.
#[test]
fn another_supervisor_takes_over_a_running_bench() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let (name, out) = (own("t-attach"), folder.path().join("run"));
    let mut first = start(&name, &out, "60", &[]);
    until_running(&name);
    let rig = writer(&name, "rig_status");
    // As long as there is one, nobody else is let in.
    let refused = Command::new(kingpin()).args(["attach", &name]).output().unwrap();
    assert_eq!(refused.status.code(), Some(3), "{}", String::from_utf8_lossy(&refused.stderr));
    first.kill().unwrap();
    first.wait().unwrap();
    // A new run of that name would find live services: refused, and told what to do.
    let second = Command::new(kingpin())
        .args(["run", "slalom_120", "--name", &name, "--out"])
        .arg(folder.path().join("second"))
        .output()
        .unwrap();
    assert_eq!(second.status.code(), Some(3));
    assert!(String::from_utf8_lossy(&second.stderr).contains("kingpin attach"));
    let cleaned = Command::new(kingpin()).args(["clean", "--name", &name]).output().unwrap();
    assert_eq!(cleaned.status.code(), Some(3), "a live bench is never cleaned away");

    let attached = Command::new(kingpin())
        .args(["attach", &name, "--json", "--no-report"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    until("the new supervisor", || {
        let bench = show(&name, "bench")?;
        (bench["header"]["writer_pid"].as_u64()? == u64::from(attached.id())).then_some(())
    });
    // It restarts what dies from now on.
    kill(writer(&name, "vehicle_state"), Signal::KILL);
    until("the restart", || (show(&name, "vehicle_state")?["header"]["epoch"].as_u64()? >= 2).then_some(()));
    until_running(&name);
    assert_eq!(writer(&name, "rig_status"), rig, "the rig was never started again");
    kill(u64::from(attached.id()), Signal::INT);
    let output = attached.wait_with_output().unwrap();
    let summary = json(&output);
    assert_eq!(output.status.code(), Some(130), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(summary["run"]["end_state"], "idle");
    // One: who ends in order in the last tick, before the supervisor's clock is there, is not started again.
    let said = std::fs::read_to_string(out.join("services.txt")).unwrap_or_default();
    let noted = String::from_utf8_lossy(&output.stderr);
    assert_eq!(summary["run"]["restarts"]["vehicle"], 1, "{noted}{said}");
    assert_eq!(summary["log"]["lost_count"], 0);
    assert_eq!(left_over(&name), Vec::<String>::new());
    let again = Command::new(kingpin()).args(["attach", &name]).output().unwrap();
    assert_eq!(again.status.code(), Some(3), "there is nothing left to take over");
}

/// Two benches at once; everything of the one is killed: the blackbox has its last seconds, `clean` takes what
/// it left and nothing of the other's.
#[test]
fn a_crash_of_everything_leaves_the_blackbox_and_the_neighbour_alone() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let (dead, live) = (own("t-dead"), own("t-live"));
    let mut first = start(&dead, &folder.path().join("dead"), "60", &[]);
    let second = start(&live, &folder.path().join("live"), "60", &[]);
    until_running(&dead);
    until_running(&live);
    let regions = ["rig_status", "vehicle_state", "suspension_state", "logger_status"];
    let pids = regions.map(|region| writer(&dead, region));
    first.kill().unwrap();
    pids.iter().for_each(|&pid| kill(pid, Signal::KILL));
    first.wait().unwrap();
    until("the last writer's end", || {
        let alive = |region: &&str| show(&dead, region).is_some_and(|r| r["header"]["writer_alive"] == true);
        (!regions.iter().any(alive)).then_some(())
    });
    let saved = folder.path().join("saved.mcap");
    let output = Command::new(kingpin())
        .args(["blackbox", "--json", "--name", &dead, "-o"])
        .arg(&saved)
        .output()
        .unwrap();
    let told = json(&output);
    assert_eq!(output.status.code(), Some(0));
    let last = show(&dead, "rig_status").unwrap()["tick"].as_u64().unwrap();
    assert!(told["ticks"][1].as_u64().unwrap() >= last);
    let log = LogReader::open(&saved).unwrap();
    assert!(log.intact());
    let ticks = &log.region("rig_status").unwrap().ticks;
    assert_eq!(*ticks.last().unwrap(), last, "to the last tick");
    // What the log and the blackbox both have is the same.
    let (crashed, blackbox) = (LogReader::open(&folder.path().join("dead")).unwrap(), &log);
    let (a, b) = (crashed.region("vehicle_state").unwrap(), blackbox.region("vehicle_state").unwrap());
    let both = b.ticks.iter().filter(|t| a.at_tick(**t).is_some());
    assert!(both.clone().count() > 300);
    both.for_each(|t| assert_eq!(a.at_tick(*t), b.at_tick(*t), "tick {t}"));

    let cleaned = Command::new(kingpin()).arg("clean").output().unwrap();
    assert_eq!(cleaned.status.code(), Some(0), "{}", String::from_utf8_lossy(&cleaned.stderr));
    assert_eq!(left_over(&dead), Vec::<String>::new());
    assert!(folder.path().join("dead/blackbox.mcap").is_file(), "saved before it was cleaned");
    assert!(!left_over(&live).is_empty());
    assert_eq!(show(&live, "rig_status").unwrap()["header"]["writer_alive"], true);
    kill(u64::from(second.id()), Signal::INT);
    let output = second.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(left_over(&live), Vec::<String>::new());
}

/// Every kind of fault on the bus, in lockstep and by the clock; there the CAN service is killed and stopped, too.
#[test]
fn faults_on_the_bus_are_obeyed_and_noticed_by_whoever_they_concern() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    for (name, least) in [("can_lockstep", 9), ("can_paced", 12)] {
        let own = own(&name.replace('_', "-"));
        let (output, summary) = campaign(&own, name, &folder.path().join(name), &[]);
        assert_eq!(output.status.code(), Some(0), "{}", failures(&summary));
        assert_eq!(summary["failed_count"], 0);
        assert_eq!(summary["skipped_count"], 0);
        assert!(summary["passed_count"].as_u64().unwrap() >= least, "{summary:#}");
        assert_eq!(left_over(&own), Vec::<String>::new());
    }
    // What the mapping does not have cannot be wrong: told before anything runs.
    let more = ["--set", "fault[0].message=Nonsense"];
    let (output, told) = campaign("t-can-bad", "can_lockstep", &folder.path().join("bad"), &more);
    assert_eq!(output.status.code(), Some(2));
    assert!(told["error"].as_str().unwrap().contains("message Nonsense"), "{told}");
}

/// Runs a script as root in a mount namespace of its own; `None`, and said so, where that is not allowed.
fn in_namespace(script: &str, folder: &Path) -> Option<Output> {
    let may = Command::new("unshare").args(["-m", "true"]).output();
    if !may.is_ok_and(|output| output.status.success()) {
        println!("SKIPPED: mounting needs root and unshare");
        return None;
    }
    let output = Command::new("unshare")
        .args(["-m", "sh", "-euc", script])
        .env("KINGPIN", kingpin())
        .env("FOLDER", folder)
        .output()
        .unwrap();
    Some(output)
}

/// A disk of 6 MB that never gets room again: the loop runs to its end, the loss is told, the log up to there is read.
#[test]
fn on_a_full_disk_the_run_ends_in_order_and_tells_its_loss() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let name = own("t-full");
    let script = format!(
        "mkdir $FOLDER/disk; mount -t tmpfs -o size=6m none $FOLDER/disk
         code=0; $KINGPIN run slalom_120 --json --no-report --duration 9 --name {name} --set warm_up_s=0.5 \
             --set rig.limits.stall_ticks=5000 --set rig.limits.holding_max_s=30 --out $FOLDER/disk/run || code=$?
         cp -r $FOLDER/disk/run $FOLDER/saved; exit $code"
    );
    let Some(output) = in_namespace(&script, folder.path()) else { return };
    let summary = json(&output);
    assert_eq!(output.status.code(), Some(1), "{summary}{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(summary["run"]["end_state"], "idle", "the loop ran to its end: {summary}");
    assert!(summary["run"]["failures"].to_string().contains("lost"), "{summary}");
    assert!(summary["run"]["failures"].to_string().contains("refused"), "{summary}");
    assert!(summary["error"].as_str().unwrap().contains("No space left"), "{summary}");
    let log = LogReader::open(&folder.path().join("saved")).unwrap();
    let ticks = &log.region("rig_status").unwrap().ticks;
    assert!(ticks.len() > 500 && *ticks.last().unwrap() < 9000, "{} ticks", ticks.len());
    assert_eq!(left_over(&name), Vec::<String>::new());
}

/// A file system mounted read-only from the beginning refuses the run; one that becomes so while the logger is started
/// again costs what comes from then on, and nothing else.
#[test]
fn on_a_read_only_disk_the_loop_runs_on_and_tells_its_loss() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let name = own("t-rom");
    let script = format!(
        r#"mkdir $FOLDER/never $FOLDER/run
         mount -t tmpfs -o ro none $FOLDER/never
         code=0; $KINGPIN run slalom_120 --duration 5 --name {name} --out $FOLDER/never/run 2>$FOLDER/told || code=$?
         echo $code >>$FOLDER/told
         $KINGPIN run slalom_120 --json --no-report --duration 12 --name {name} --set warm_up_s=0.5 \
             --set rig.limits.stall_ticks=5000 --set rig.limits.holding_max_s=30 --out $FOLDER/run &
         until grep -q . $FOLDER/run/log.mcap 2>/dev/null; do sleep 0.2; done
         sleep 3
         mount --bind $FOLDER/run $FOLDER/run; mount -o remount,bind,ro $FOLDER/run
         kill -9 $($KINGPIN table show --json --name {name} logger_status | grep -o '"writer_pid": *[0-9]*' | grep -o '[0-9]*')
         wait $!"#
    );
    let Some(output) = in_namespace(&script, folder.path()) else { return };
    let told = std::fs::read_to_string(folder.path().join("told")).unwrap();
    assert!(told.contains("Read-only file system") && told.trim_end().ends_with('3'), "{told}");
    let summary = json(&output);
    assert_eq!(output.status.code(), Some(1), "{summary}{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(summary["run"]["end_state"], "idle", "the loop ran to its end: {summary}");
    assert!(summary["run"]["failures"].to_string().contains("lost"), "{summary}");
    assert!(summary["error"].as_str().unwrap().contains("Read-only"), "{summary}");
    let log = LogReader::open(&folder.path().join("run")).unwrap();
    assert!(log.region("rig_status").unwrap().ticks.len() > 500, "what was written before");
    assert_eq!(left_over(&name), Vec::<String>::new());
}

/// Limits the size of files of the logger, which is a full disk to it, for ever; then removes the directory.
#[test]
fn without_a_disk_the_loop_runs_on_and_the_loss_is_told() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let (name, out) = (own("t-disk"), folder.path().join("run"));
    let run = start(&name, &out, "60", &[]);
    until_running(&name);
    let logger = Pid::from_raw(i32::try_from(writer(&name, "logger_status")).unwrap());
    use rustix::process::{Resource, Rlimit, prlimit};
    let full = Rlimit { current: Some(1), maximum: None };
    let before = prlimit(logger, Resource::Fsize, full).unwrap();
    let value = |key: &str| until("the logger", || show(&name, "logger_status")?["content"][key].as_u64());
    until("refused writes", || (value("write_error_count") > 5).then_some(()));
    let readable = LogReader::open(&out).unwrap();
    assert!(readable.region("rig_status").unwrap().ticks.len() > 100, "what was written before");
    assert_eq!(value("lost_count"), 0, "kept in memory meanwhile");
    prlimit(logger, Resource::Fsize, before).unwrap();
    let tick = value("read_tick");
    until("the disk's return", || (value("written_tick") > tick).then_some(()));

    std::fs::remove_dir_all(&out).unwrap();
    until("a new file", || out.join("log.mcap").is_file().then_some(()));
    let tick = value("read_tick");
    until("more ticks", || (value("written_tick") > tick + 500).then_some(()));
    assert!(value("lost_count") > 0, "the file that was removed is a loss");
    let status = show(&name, "rig_status").unwrap();
    assert_eq!(status["content"]["state"], 4, "the loop runs on");
    kill(u64::from(run.id()), Signal::INT);
    let output = run.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(1), "a loss is no success");
    let summary = json(&output);
    assert!(summary["run"]["failures"].to_string().contains("lost"), "{}", summary["run"]);
    let log = LogReader::open(&out).unwrap();
    assert!(log.intact() && log.events.iter().any(|e| e.kind == "log_removed"), "{:?}", log.events);
    assert_eq!(left_over(&name), Vec::<String>::new());
}

/// A directory in which nothing can be made, met by a logger that is started again. As root, only a mount does
/// that: a file system that is full from the beginning stands for it.
#[test]
fn a_logger_that_cannot_make_its_file_keeps_trying_and_counts() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let (name, out) = (own("t-ro"), folder.path().join("run"));
    let run = start(&name, &out, "60", &[]);
    until_running(&name);
    // A file where the directory was: no file can be made in it, whoever asks.
    let aside = folder.path().join("aside");
    std::fs::rename(&out, &aside).unwrap();
    std::fs::write(&out, "in the way").unwrap();
    kill(writer(&name, "logger_status"), Signal::KILL);
    until("the loss", || {
        let status = show(&name, "logger_status")?;
        (status["content"]["lost_count"].as_u64()? > 100).then_some(())
    });
    // The loop runs on; the host may make the rig hold for a moment.
    until_running(&name);
    std::fs::remove_file(&out).unwrap();
    std::fs::rename(&aside, &out).unwrap();
    until("a new file", || out.join("log.1.mcap").is_file().then_some(()));
    kill(u64::from(run.id()), Signal::INT);
    let output = run.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(1), "a loss is no success");
    let log = LogReader::open(&out).unwrap();
    let region = log.region("rig_status").unwrap();
    assert!(region.missing_count() > 100, "the gap is visible");
    assert!(log.events.iter().any(|e| e.kind == "log_refused"), "{:?}", log.events);
}

/// A service that cannot live is given up, and said why; the rig stops softly.
#[test]
fn a_service_that_dies_again_and_again_is_given_up() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let (name, out) = (own("t-giveup"), folder.path().join("run"));
    let run = start(&name, &out, "60", &[]);
    until_running(&name);
    let mut last = 0;
    until("giving up", || {
        if let Some(pid) = show(&name, "suspension_state").and_then(|r| r["header"]["writer_pid"].as_u64())
            && pid != last
            && Path::new(&format!("/proc/{pid}/exe")).exists()
        {
            last = pid;
            let _ = kill_process(Pid::from_raw(i32::try_from(pid).unwrap()).unwrap(), Signal::KILL);
        }
        (show(&name, "bench")?["content"]["request"] == 3).then_some(())
    });
    let output = run.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    let summary = json(&output);
    let failures = summary["run"]["failures"].to_string();
    assert!(failures.contains("multibody died 8 times in a row"), "{failures}");
    assert_eq!(left_over(&name), Vec::<String>::new());
}

/// Another user can neither read the table nor claim a region nor supervise the bench.
#[test]
fn another_user_is_kept_out() {
    let nobody = 65534;
    if !rustix::process::geteuid().is_root() {
        println!("SKIPPED: only root can become another user");
        return;
    }
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let (name, out) = (own("t-user"), folder.path().join("run"));
    let run = start(&name, &out, "60", &[]);
    until_running(&name);
    // Somewhere that others can read, so that it is not the executable's place that keeps them out.
    let shared = PathBuf::from(format!("/tmp/kingpin-test-{}", std::process::id()));
    std::fs::create_dir(&shared).unwrap();
    std::fs::set_permissions(&shared, std::fs::Permissions::from_mode(0o755)).unwrap();
    let copy = shared.join("kingpin");
    std::fs::copy(kingpin(), &copy).unwrap();
    std::fs::set_permissions(&copy, std::fs::Permissions::from_mode(0o755)).unwrap();
    let base = table::base_from_environment();
    let as_nobody = |arguments: &[&str]| {
        Command::new(&copy)
            .args(arguments)
            .env("KINGPIN_RUNTIME_DIR", &base)
            .uid(nobody)
            .gid(nobody)
            .current_dir("/")
            .output()
            .unwrap()
    };
    let shown = as_nobody(&["table", "show", "rig_status", "--name", &name]);
    let attached = as_nobody(&["attach", &name]);
    let cleaned = as_nobody(&["clean", "--name", &name]);
    let served = as_nobody(&["service", "vehicle", "--bench", &name]);
    std::fs::remove_dir_all(&shared).unwrap();
    for (what, output) in [("show", &shown), ("attach", &attached), ("clean", &cleaned), ("service", &served)]
    {
        let said = String::from_utf8_lossy(&output.stderr).to_lowercase();
        assert!(!output.status.success(), "{what}: {said}");
        assert!(said.contains("permi") || said.contains("belongs to user"), "{what}: {said}");
    }
    assert_eq!(show(&name, "rig_status").unwrap()["header"]["writer_alive"], true);
    kill(u64::from(run.id()), Signal::INT);
    assert_eq!(run.wait_with_output().unwrap().status.code(), Some(130));
    assert_eq!(left_over(&name), Vec::<String>::new());
}

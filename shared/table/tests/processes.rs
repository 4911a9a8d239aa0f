//! Real processes: claims freed by SIGKILL, a writer killed in the middle of a write, permissions across users,
//! waiting across processes. The test executable runs itself again as the other process ([`child_role`]).
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

mod support;

use std::io::{BufRead, BufReader, Write};
use std::os::unix::fs::PermissionsExt;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use support::TestBench;
use table::{
    Bench, CreateOptions, OpenOptions, Read, RegionSpec, Table, TableError, TableInfo, Wait, monotonic_ns,
    remove_bench,
};

const SPECS: [RegionSpec; 1] =
    [RegionSpec { name: "state", version: 1, layout_hash: 0x1234, words: 64, depth: 8 }];
const INFO: TableInfo = TableInfo { run_id: 5, period_ns: 1_000_000, t0_ns: 0 };
const ROLE: &str = "KINGPIN_TABLE_TEST_ROLE";

/// Not a test by itself: what the other process does.
#[test]
fn child_role() {
    let Ok(role) = std::env::var(ROLE) else { return };
    let (role, bench) = role.split_once(' ').unwrap();
    // The lock directory comes by KINGPIN_RUNTIME_DIR.
    let bench = Bench::new(bench).unwrap();
    let open = || Table::open(&bench, &SPECS, &OpenOptions::default());
    match role {
        "claim-and-wait" => {
            let mut writer = open().unwrap().claim_writer(0).unwrap();
            writer.publish(0, &[1; 64]).unwrap();
            say(&format!("epoch {}", writer.epoch()));
            std::thread::sleep(std::time::Duration::from_secs(60));
        }
        "die-in-a-write" => {
            let mut writer = open().unwrap().claim_writer(0).unwrap();
            let head = writer.head();
            writer.write_interrupted(head, &[2; 32]).unwrap();
            say("half written");
            std::thread::sleep(std::time::Duration::from_secs(60));
        }
        "lock-bench" => {
            let _lock = bench.lock().unwrap();
            say("locked");
            std::thread::sleep(std::time::Duration::from_secs(60));
        }
        "echo" => {
            let table = open().unwrap();
            let mut writer = table.claim_writer(0).unwrap();
            say("ready");
            for n in 0..100 {
                writer.publish(n, &[n; 64]).unwrap();
                std::thread::sleep(std::time::Duration::from_micros(200));
            }
        }
        "intrude" => {
            say(&format!("open: {}", open().map_or_else(|e| e.to_string(), |_| "let in".to_owned())));
            say(&match open().map(|table| table.claim_writer(0)) {
                Err(e) | Ok(Err(e)) => format!("claim: {e}"),
                Ok(Ok(_)) => "claim: let in".to_owned(),
            });
        }
        other => panic!("{other}"),
    }
}

fn say(line: &str) {
    let mut out = std::io::stdout();
    writeln!(out, "\n# {line}").unwrap();
    out.flush().unwrap();
}

struct Other {
    process: Child,
    lines: Box<dyn Iterator<Item = String>>,
}

impl Other {
    fn start(role: &str, bench: &Bench) -> Self {
        Self::start_by(Command::new(std::env::current_exe().unwrap()), role, bench)
    }

    fn start_by(mut command: Command, role: &str, bench: &Bench) -> Self {
        let mut process = command
            .args(["--exact", "child_role", "--nocapture"])
            .env(ROLE, format!("{role} {}", bench.name()))
            .env("KINGPIN_RUNTIME_DIR", bench.base())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let lines = BufReader::new(process.stdout.take().unwrap()).lines().map_while(Result::ok);
        Other {
            process,
            lines: Box::new(lines.filter_map(|line| line.strip_prefix("# ").map(str::to_owned))),
        }
    }

    fn line(&mut self) -> String {
        self.lines.next().expect("the other process ended")
    }

    fn pid(&self) -> u32 {
        self.process.id()
    }

    fn kill(&mut self) {
        self.process.kill().unwrap();
        self.process.wait().unwrap();
    }
}

impl Drop for Other {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

fn make(bench: &TestBench) -> Table {
    Table::create_shared(&bench.lock, &SPECS, INFO, &CreateOptions::default()).unwrap()
}

#[test]
fn a_claim_ends_with_its_holder() {
    let bench = TestBench::new();
    let table = make(&bench);
    for epoch in [1, 3, 5] {
        let mut other = if epoch == 1 {
            Other::start("claim-and-wait", &bench.bench)
        } else {
            Other::start("die-in-a-write", &bench.bench) // tick 0 is published already
        };
        other.line();
        match table.claim_writer(0) {
            Err(TableError::Claimed { holder_pid, .. }) => assert_eq!(holder_pid, Some(other.pid())),
            otherwise => panic!("a second live writer: {otherwise:?}"),
        }
        assert_eq!(table.reader(0).header().writer().unwrap().pid, other.pid());
        assert_eq!(table.reader(0).header().epoch(), epoch);
        // Nor may anybody take the segments from under a live writer.
        assert!(matches!(remove_bench(&bench.lock), Err(TableError::Claimed { .. })));
        other.kill();
        assert_eq!(table.claim_writer(0).unwrap().epoch(), epoch + 1);
    }
}

#[test]
fn another_lock_directory_does_not_let_a_second_writer_in() {
    let bench = TestBench::new();
    let table = make(&bench);
    let mut other = Other::start("claim-and-wait", &bench.bench);
    other.line();
    let elsewhere = tempfile::tempdir().unwrap();
    let same = Bench::with_base(bench.bench.name().as_str(), elsewhere.path()).unwrap();
    let claim = Table::open(&same, &SPECS, &OpenOptions::default()).unwrap().claim_writer(0);
    assert!(matches!(claim, Err(TableError::Claimed { holder_pid, .. }) if holder_pid == Some(other.pid())));
    other.kill();
    assert!(table.claim_writer(0).is_ok());
}

#[test]
fn one_supervisor_a_bench() {
    let bench = TestBench::new();
    let second = bench.bench.lock();
    assert!(
        matches!(second, Err(TableError::Claimed { holder_pid, .. }) if holder_pid == Some(std::process::id()))
    );
    assert_eq!(bench.bench.supervisor_pid().unwrap(), Some(std::process::id()));

    let name = format!("{}-b", bench.bench.name());
    let free = Bench::with_base(&name, bench.base.path()).unwrap();
    assert_eq!(free.supervisor_pid().unwrap(), None);
    let mut other = Other::start("lock-bench", &free);
    assert_eq!(other.line(), "locked");
    assert!(
        matches!(free.lock(), Err(TableError::Claimed { holder_pid, .. }) if holder_pid == Some(other.pid()))
    );
    assert_eq!(free.supervisor_pid().unwrap(), Some(other.pid()));
    other.kill();
    assert_eq!(free.supervisor_pid().unwrap(), None);
    assert!(free.lock().is_ok());
    // This process lives, but holds it no more. A child that another test is just starting holds a copy of the
    // lock's file until it executes: hence the patience.
    let released = (0..200).any(|_| {
        std::thread::sleep(std::time::Duration::from_millis(10));
        free.supervisor_pid().unwrap().is_none()
    });
    assert!(released);
}

#[test]
fn a_writer_killed_in_the_middle_of_a_write() {
    let bench = TestBench::new();
    let table = make(&bench);
    let reader = table.reader(0);
    let mut out = [0; 64];
    {
        let mut writer = table.claim_writer(0).unwrap();
        (0..3).for_each(|n| writer.publish(n, &[n; 64]).unwrap());
    }
    let mut other = Other::start("die-in-a-write", &bench.bench);
    assert_eq!(other.line(), "half written");
    other.kill();
    // The half of tick 3 is not there, and what was before stands.
    assert_eq!(reader.read(3, &mut out), Read::NotYet);
    assert_eq!(reader.latest(4, &mut out).map(|l| (l.tick, l.age)), Some((2, 2)));
    assert_eq!(out, [2; 64]);
    // Its successor goes on at a later tick; what it skipped is missing, for good.
    let mut writer = table.claim_writer(0).unwrap();
    assert_eq!((writer.epoch(), writer.head()), (3, 3));
    writer.publish(5, &[5; 64]).unwrap();
    assert_eq!(reader.read(3, &mut out), Read::Missing);
    assert_eq!(reader.read(4, &mut out), Read::Missing);
    assert_eq!(reader.read(5, &mut out), Read::Ready);
    assert_eq!(out, [5; 64]);
}

#[test]
fn the_bell_rings_across_processes_into_a_read_only_mapping() {
    let bench = TestBench::new();
    make(&bench);
    let table = Table::open(&bench.bench, &SPECS, &OpenOptions::default()).unwrap();
    let mut other = Other::start("echo", &bench.bench);
    other.line();
    for n in [0, 50, 99] {
        assert!(table.reader(0).wait_for(n, &Wait::until(monotonic_ns() + 20_000_000_000)), "tick {n}");
    }
    assert_eq!(table.reader(0).head(), 100);
}

fn is_root() -> bool {
    rustix::process::geteuid().is_root()
}

/// This executable, where any user can reach it, run as `nobody`.
fn as_nobody(directory: &Path, gid: u32) -> Command {
    std::fs::set_permissions(directory, std::fs::Permissions::from_mode(0o755)).unwrap();
    let copy = directory.join("test");
    if !copy.exists() {
        std::fs::copy(std::env::current_exe().unwrap(), &copy).unwrap();
        std::fs::set_permissions(&copy, std::fs::Permissions::from_mode(0o755)).unwrap();
    }
    let mut command = Command::new(copy);
    command.uid(65534).gid(gid).current_dir("/");
    command
}

#[test]
fn nobody_else_gets_in() {
    let bench = TestBench::new();
    make(&bench);
    let mode = |path: &Path| std::fs::metadata(path).unwrap().permissions().mode() & 0o7777;
    assert_eq!(mode(&bench.path("state")), 0o600);
    assert_eq!(mode(&bench.bench.directory()), 0o700);
    assert_eq!(mode(&bench.bench.directory().join("bench.lock")), 0o600);
    if !is_root() {
        return println!("not root: cannot try as another user");
    }
    let directory = tempfile::tempdir().unwrap();
    let mut other = Other::start_by(as_nobody(directory.path(), 65534), "intrude", &bench.bench);
    assert!(other.line().starts_with("open: segment kingpin.test-"));
    assert!(other.line().contains("not permitted to this user"));
}

#[test]
fn the_group_may_read_if_configured() {
    const GROUP: u32 = 54321;
    if !is_root() {
        return println!("not root: cannot give a file to another group");
    }
    let bench = TestBench::new();
    Table::create_shared(&bench.lock, &SPECS, INFO, &CreateOptions { group: Some(GROUP) }).unwrap();
    let mode = std::fs::metadata(bench.path("state")).unwrap().permissions().mode();
    assert_eq!(mode & 0o7777, 0o640);
    let directory = tempfile::tempdir().unwrap();
    let mut member = Other::start_by(as_nobody(directory.path(), GROUP), "intrude", &bench.bench);
    assert_eq!(member.line(), "open: let in");
    let claim = member.line();
    assert!(claim.starts_with("claim: ") && !claim.contains("let in"), "{claim}");
    let mut stranger = Other::start_by(as_nobody(directory.path(), 65534), "intrude", &bench.bench);
    assert!(stranger.line().contains("not permitted"));
}

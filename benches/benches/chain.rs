//! The chain rig → vehicle → multibody → rig of the process set against a chain of bare futexes in the same run,
//! and how many simulated seconds a second lockstep gives.
//!
//! The bare chain is three processes that wake each other through futex words in shared memory once a
//! millisecond, with the priorities of the process set and nothing to do: what the kernel takes for three
//! hand-overs. Of the process set the log's timings are taken: from the rig's sample to the published
//! suspension state, as it is and less the time the three steps computed.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout, missing_docs)]

mod support;

use kingpin_benches::{Durations, alternate, print_against_baselines, sized};
use kingpin_tests::support::kingpin;
use record::LogReader;
use runtime::clock;
use runtime::realtime::{self, Wish};
use rustix::thread::futex;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use support::RawMemory;

const HOPS: usize = 3;
const STOP: u32 = u32::MAX;

/// Waits until the word is not `last`; returns its value.
fn await_change(word: &AtomicU32, last: u32) -> u32 {
    loop {
        let now = word.load(Ordering::Acquire);
        if now != last {
            return now;
        }
        let _ = futex::wait(word, futex::Flags::empty(), last, None);
    }
}

fn pass_on(word: &AtomicU32, value: u32) {
    word.store(value, Ordering::Release);
    let _ = futex::wake(word, futex::Flags::empty(), 1);
}

fn priority(hop: usize) -> Wish {
    Wish { priority: Some(60 - hop as i32), ..Wish::default() }
}

/// A follower of the bare chain: woken through word `hop`, wakes the next.
fn follower(path: &Path, hop: usize) {
    realtime::apply(&priority(hop + 1));
    let memory = RawMemory::map(path, 1).unwrap();
    let mut last = 0;
    loop {
        last = await_change(memory.futex(hop), last);
        pass_on(memory.futex(hop + 1), last);
        if last == STOP {
            return;
        }
    }
}

struct Bare {
    memory: RawMemory,
    path: PathBuf,
    children: Vec<Child>,
    count: u32,
}

impl Bare {
    fn start() -> Self {
        let path = PathBuf::from(format!("/dev/shm/kingpin-bench-chain-{}", std::process::id()));
        let memory = RawMemory::map(&path, 1).unwrap();
        let start = |hop: usize| {
            Command::new(std::env::current_exe().unwrap())
                .env("KINGPIN_BENCH_FOLLOWER", format!("{hop} {}", path.display()))
                .stdin(Stdio::null())
                .spawn()
                .unwrap()
        };
        let children = (0..HOPS - 1).map(start).collect();
        Bare { memory, path, children, count: 0 }
    }

    fn block(&mut self, ticks: usize, durations: &mut Durations) {
        let mut next = clock::now() + 1_000_000;
        for _ in 0..ticks {
            clock::sleep_until(next, 20_000);
            let begin = clock::now();
            let last = self.count;
            self.count += 1;
            pass_on(self.memory.futex(0), self.count);
            await_change(self.memory.futex(HOPS - 1), last);
            durations.record_ns((clock::now() - begin) as f64);
            next = (next + 1_000_000).max(clock::now());
        }
    }
}

impl Drop for Bare {
    fn drop(&mut self) {
        pass_on(self.memory.futex(0), STOP);
        for child in &mut self.children {
            let _ = child.wait();
        }
        let _ = std::fs::remove_file(&self.path);
    }
}

fn run_set(arguments: &[&str], duration_s: f64) -> LogReader {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("run");
    let name = format!("bench-chain-{}", std::process::id());
    let done = Command::new(kingpin())
        .args(["run", "slalom_120", "--no-report", "--json", "--name", &name])
        .args(["--duration", &format!("{duration_s:?}"), "--set", "warm_up_s=0.5"])
        .args(arguments)
        .arg("--out")
        .arg(&out)
        .output()
        .unwrap();
    // A trip on a stalled machine ends the run early; what was measured until then counts.
    assert!(out.join("log.mcap").exists(), "{}", String::from_utf8_lossy(&done.stderr));
    LogReader::open(&out).unwrap()
}

/// From the rig's sample to the published suspension state, whole and less what was computed. [ns]
fn chain_of(log: &LogReader, whole: &mut Durations, net: &mut Durations) {
    let region = |name: &str| log.region(name).unwrap();
    let (rig, vehicle, multibody) =
        (region("rig_timing"), region("vehicle_timing"), region("multibody_timing"));
    let word = |region: &record::RegionLog, name: &str| region.column_index(name).unwrap();
    let (start, compute, done) = (word(rig, "start_s"), word(rig, "compute_s"), word(rig, "done_s"));
    for (row, &tick) in multibody.ticks.iter().enumerate().skip(500) {
        let (Some(rig), Some(vehicle)) = (rig.at_tick(tick), vehicle.at_tick(tick)) else { continue };
        let value = |words: &[u64], column: usize| f64::from_bits(words[column]);
        let multibody = multibody.row(row);
        let latency = value(multibody, done) - value(rig, start);
        let computed = value(rig, compute) + value(vehicle, compute) + value(multibody, compute);
        whole.record_ns(latency * 1e9);
        net.record_ns((latency - computed).max(0.0) * 1e9);
    }
}

fn main() {
    if let Ok(follower_of) = std::env::var("KINGPIN_BENCH_FOLLOWER") {
        let (hop, path) = follower_of.split_once(' ').unwrap();
        follower(Path::new(path), hop.parse().unwrap());
        return;
    }
    kingpin();
    let mut bare = Bare::start();
    let mut net = Durations::new("process set, hand-overs only");
    let (blocks, ticks) = sized((5, 4000), (1, 300));
    let duration_s = ticks as f64 * 1e-3 + 1.0;
    let mut warm = true;
    let results = alternate(
        blocks,
        &mut [
            (
                "bare futexes, three hops",
                Box::new(|durations| {
                    let earlier = realtime::apply(&priority(0));
                    assert!(earlier.len() <= 1);
                    bare.block(ticks, durations);
                    realtime::relax();
                }),
            ),
            (
                "process set, with its steps",
                Box::new(|durations| {
                    let mut unused = Durations::new("");
                    let log = run_set(&[], duration_s);
                    chain_of(&log, durations, if std::mem::take(&mut warm) { &mut unused } else { &mut net });
                }),
            ),
        ],
    );
    print_against_baselines(
        "Rig sample to published suspension state, 1 kHz",
        &[(&results[0], 0), (&results[1], 0), (&net, 0)],
    );

    println!("\nLockstep with logging, simulated seconds per second");
    for (name, arguments) in [("one process", "--lockstep=process"), ("process set", "--lockstep=set")] {
        let seconds = sized(40.0, 2.0);
        let folder = tempfile::tempdir().unwrap();
        let done = Command::new(kingpin())
            .args(["run", "growing_slalom_80", "--no-report", "--json", arguments])
            .args([
                "--name",
                "bench-lockstep",
                "--set",
                "warm_up_s=0.5",
                "--duration",
                &format!("{seconds:?}"),
            ])
            .arg("--out")
            .arg(folder.path().join("run"))
            .output()
            .unwrap();
        let summary: serde_json::Value = serde_json::from_slice(&done.stdout).unwrap();
        println!("  {name:<12} {:.1}", summary["run"]["simulated_per_wall"].as_f64().unwrap());
    }
}

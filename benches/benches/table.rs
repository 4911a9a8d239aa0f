//! The table against a bare double buffer with a version counter, in the same run, in alternating blocks:
//! write, read and latest in one process; one-way latency between two processes, spinning and with a wake-up.
//!
//! `cargo bench -p kingpin_benches --bench table`

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a benchmark prints, and may fail loudly")]

mod support;

use kingpin_benches::{
    Contender, Durations, alternate, pin_to_core, print_against_baselines, print_machine, sized, time_batches,
};
use rustix::thread::futex;
use std::hint::{black_box, spin_loop};
use std::num::NonZeroU32;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering, fence};
use support::RawMemory;
use table::{
    Bench, CreateOptions, OpenOptions, Read, RegionReader, RegionSpec, RegionWriter, Table, TableInfo, Wait,
    monotonic_ns, remove_bench,
};

/// The least that can be shared un-torn: two cells and a version; only the newest value is kept.
struct DoubleBuffer<'a>(&'a [AtomicU64]);

impl DoubleBuffer<'_> {
    fn memory(words: usize) -> usize {
        8 + 2 * words
    }

    fn cell(&self, version: u64) -> &[AtomicU64] {
        let words = (self.0.len() - 8) / 2;
        let at = 8 + (version & 1) as usize * words;
        &self.0[at..at + words]
    }

    #[inline]
    fn write(&self, payload: &[u64]) {
        let version = self.0[0].load(Ordering::Relaxed) + 1;
        fence(Ordering::Release);
        for (word, value) in self.cell(version).iter().zip(payload) {
            word.store(*value, Ordering::Relaxed);
        }
        self.0[0].store(version, Ordering::Release);
    }

    #[inline]
    fn version(&self) -> u64 {
        self.0[0].load(Ordering::Acquire)
    }

    #[inline]
    fn read(&self, out: &mut [u64]) -> Option<u64> {
        let version = self.version();
        for (out, word) in out.iter_mut().zip(self.cell(version)) {
            *out = word.load(Ordering::Relaxed);
        }
        fence(Ordering::Acquire);
        (self.0[0].load(Ordering::Relaxed) == version).then_some(version)
    }
}

const INFO: TableInfo = TableInfo { run_id: 1, period_ns: 1_000_000, t0_ns: 0 };
const DEPTH: usize = 4096;

fn in_one_process(words: usize) {
    let name = format!("bench-a-{}", std::process::id());
    let bench = Bench::with_base(&name, lock_directory()).unwrap();
    let lock = bench.lock().unwrap();
    remove_bench(&lock).unwrap();
    let specs = [RegionSpec { name: "state", version: 1, layout_hash: 1, words, depth: DEPTH }];
    let table = Table::create_shared(&lock, &specs, INFO, &CreateOptions::default()).unwrap();
    let mut writer = table.claim_writer(0).unwrap();
    let reader = Table::open(&bench, &specs, &OpenOptions::default()).unwrap().reader(0).clone();
    let raw_path = shm_path("one");
    let raw_memory = RawMemory::map(&raw_path, DoubleBuffer::memory(words)).unwrap();
    let raw = DoubleBuffer(raw_memory.words());

    let payload: Vec<u64> = (0..words as u64).collect();
    let (batches, batch) = (sized(2000, 100), 16);
    let blocks = sized(30, 3);
    let mut tick = 0;

    let mut contenders: [Contender<'_>; 2] = [
        (
            "table write",
            Box::new(|out| {
                time_batches(out, batches, batch, |_| {
                    writer.write(tick, black_box(&payload)).unwrap();
                    tick += 1;
                })
            }),
        ),
        (
            "double buffer write",
            Box::new(|out| time_batches(out, batches, batch, |_| raw.write(black_box(&payload)))),
        ),
    ];
    let writes = alternate(blocks, &mut contenders);
    drop(contenders);
    (0..DEPTH as u64).for_each(|n| writer.write(tick + n, &payload).unwrap());
    let newest = reader.head() - 1;

    let mut out = [vec![0; words], vec![0; words], vec![0; words]];
    let [out_newest, out_latest, out_raw] = &mut out;
    let mut contenders: [Contender<'_>; 3] = [
        (
            "table read, one tick after another",
            Box::new(|durations| {
                time_batches(durations, batches, batch, |i| {
                    let n = newest - (i % 1000) as u64;
                    assert_eq!(reader.read(black_box(n), out_newest), Read::Ready);
                })
            }),
        ),
        (
            "table latest",
            Box::new(|durations| {
                time_batches(durations, batches, batch, |_| {
                    assert!(reader.latest(black_box(newest), black_box(out_latest)).is_some());
                })
            }),
        ),
        (
            "double buffer read",
            Box::new(|durations| {
                time_batches(durations, batches, batch, |_| assert!(raw.read(black_box(out_raw)).is_some()));
            }),
        ),
    ];
    let reads = alternate(blocks, &mut contenders);
    drop(contenders);
    let rows = [(&writes[0], 1), (&writes[1], 1), (&reads[0], 4), (&reads[1], 4), (&reads[2], 4)];
    print_against_baselines(
        &format!("one process, {} B a tick, depth {DEPTH}, per call (of 16)", words * 8),
        &rows,
    );
    let _ = std::fs::remove_file(raw_path);
    drop(writer);
    remove_bench(&lock).unwrap();
}

// ---- Two processes ----

const ROLE: &str = "KINGPIN_BENCH_TABLE_READER";
const WORDS: usize = 128; // 1 KiB
const GIVE_UP_NS: u64 = 20_000_000_000;

const SPECS: [RegionSpec; 2] = [
    RegionSpec { name: "data", version: 1, layout_hash: 1, words: WORDS, depth: DEPTH },
    RegionSpec { name: "done", version: 1, layout_hash: 1, words: 1, depth: 64 },
];

#[derive(Clone, Copy)]
enum Way {
    TableSpin,
    RawSpin,
    TableBell,
    RawFutex,
}
const WAYS: [(Way, &str); 4] = [
    (Way::TableSpin, "table, spinning"),
    (Way::RawSpin, "double buffer, spinning"),
    (Way::TableBell, "table, bell"),
    (Way::RawFutex, "double buffer, bare futex"),
];

fn blocks() -> u64 {
    sized(40, 2)
}
fn messages() -> u64 {
    sized(200, 30)
}

fn sender() {
    let name = format!("bench-b-{}", std::process::id());
    let base = lock_directory();
    let bench = Bench::with_base(&name, &base).unwrap();
    let lock = bench.lock().unwrap();
    remove_bench(&lock).unwrap();
    let table = Table::create_shared(&lock, &SPECS, INFO, &CreateOptions::default()).unwrap();
    let raw_path = shm_path("two");
    let raw_memory = RawMemory::map(&raw_path, DoubleBuffer::memory(WORDS)).unwrap();
    let raw = DoubleBuffer(raw_memory.words());
    let mut writer = table.claim_writer(0).unwrap();
    let done = table.reader(1);

    let mut command = std::process::Command::new(std::env::current_exe().unwrap());
    command.args(std::env::args().skip(1));
    let receiver =
        command.env(ROLE, format!("{name} {}", raw_path.display())).env("KINGPIN_RUNTIME_DIR", &base).spawn();
    let mut receiver = receiver.unwrap();
    pin_to_core(0);
    let mut payload = [0; WORDS];
    let mut tick = 0;
    'blocks: for block in 0..=blocks() {
        for (i, (way, _)) in WAYS.into_iter().enumerate() {
            // The receiver says when it is ready for a block.
            let number = block * WAYS.len() as u64 + i as u64;
            if !done.wait_for(number, &Wait::until(monotonic_ns() + GIVE_UP_NS)) {
                println!("  the receiver does not answer");
                break 'blocks;
            }
            for message in 0..messages() {
                std::thread::sleep(std::time::Duration::from_micros(200));
                payload[1] = message;
                payload[WORDS - 1] = message;
                payload[0] = monotonic_ns();
                match way {
                    Way::TableSpin => writer.write(tick, &payload).unwrap(),
                    Way::TableBell => writer.publish(tick, &payload).unwrap(),
                    Way::RawSpin => raw.write(&payload),
                    Way::RawFutex => {
                        raw.write(&payload);
                        ring_raw(raw_memory.futex(0));
                    }
                }
                if matches!(way, Way::TableSpin | Way::TableBell) {
                    tick += 1;
                }
            }
        }
    }
    let ended = receiver.wait().unwrap();
    let _ = std::fs::remove_file(raw_path);
    drop(writer);
    remove_bench(&lock).unwrap();
    assert!(ended.success(), "the receiver failed");
}

fn ring_raw(word: &AtomicU32) {
    word.fetch_add(1, Ordering::Release);
    let _ = futex::wake(word, futex::Flags::empty(), 1);
}

fn receiver(role: &str) {
    pin_to_core(1);
    let (name, raw_path) = role.split_once(' ').unwrap();
    let table = Table::open(&Bench::new(name).unwrap(), &SPECS, &OpenOptions::default()).unwrap();
    let raw_memory = RawMemory::map(Path::new(raw_path), DoubleBuffer::memory(WORDS)).unwrap();
    let raw = DoubleBuffer(raw_memory.words());
    let mut done = table.claim_writer(1).unwrap();
    let mut results: Vec<_> = WAYS.iter().map(|(_, name)| Durations::new(name)).collect();
    let mut skipped = 0;
    for block in 0..=blocks() {
        for (i, (way, _)) in WAYS.into_iter().enumerate() {
            let number = block * WAYS.len() as u64 + i as u64;
            let mut scratch = Durations::new("warm-up");
            let out = if block == 0 { &mut scratch } else { &mut results[i] };
            let received = match way {
                Way::TableSpin | Way::TableBell => {
                    receive_table(table.reader(0), matches!(way, Way::TableBell), &mut done, number, out)
                }
                Way::RawSpin | Way::RawFutex => {
                    let bell = matches!(way, Way::RawFutex).then(|| raw_memory.futex(0));
                    receive_raw(&raw, bell, &mut done, number, out)
                }
            };
            skipped += messages() - received;
        }
    }
    let rows: Vec<_> = results.iter().zip([1, 1, 3, 3]).collect();
    print_against_baselines(
        &format!(
            "two processes, one way, {} B, every 200 us, cores 0 and 1 (torn: 0 of all, checked)",
            WORDS * 8
        ),
        &rows,
    );
    println!("  overtaken before they were read, not counted: {skipped}");
}

fn receive_table(
    data: &RegionReader,
    bell: bool,
    done: &mut RegionWriter,
    number: u64,
    out: &mut Durations,
) -> u64 {
    let mut payload = [0; WORDS];
    let mut received = 0;
    let mut n = data.head();
    done.publish(number, &[0]).unwrap();
    loop {
        let deadline = monotonic_ns() + GIVE_UP_NS;
        if bell {
            assert!(data.wait_for(n, &Wait::until(deadline)), "no message");
        } else {
            spin_until(deadline, || data.head() > n);
        }
        n = data.head();
        if data.read(n - 1, &mut payload) == Read::Ready {
            received += take(&payload, out);
            if payload[1] == messages() - 1 {
                return received;
            }
        }
    }
}

fn receive_raw(
    raw: &DoubleBuffer<'_>,
    bell: Option<&AtomicU32>,
    done: &mut RegionWriter,
    number: u64,
    out: &mut Durations,
) -> u64 {
    let mut payload = [0; WORDS];
    let mut received = 0;
    let mut version = raw.version();
    done.publish(number, &[0]).unwrap();
    loop {
        let deadline = monotonic_ns() + GIVE_UP_NS;
        if let Some(word) = bell {
            let until = futex::Timespec { tv_sec: (deadline / 1_000_000_000) as i64, tv_nsec: 0 };
            loop {
                let count = word.load(Ordering::Acquire);
                if raw.version() > version {
                    break;
                }
                assert!(monotonic_ns() < deadline, "no message");
                let _ = futex::wait_bitset(word, futex::Flags::empty(), count, Some(&until), NonZeroU32::MAX);
            }
        } else {
            spin_until(deadline, || raw.version() > version);
        }
        if let Some(read) = raw.read(&mut payload) {
            version = read;
            received += take(&payload, out);
            if payload[1] == messages() - 1 {
                return received;
            }
        }
    }
}

fn take(payload: &[u64], out: &mut Durations) -> u64 {
    out.record_ns((monotonic_ns() - payload[0]) as f64);
    assert_eq!(payload[1], payload[WORDS - 1], "torn");
    1
}

fn spin_until(deadline: u64, condition: impl Fn() -> bool) {
    while !condition() {
        spin_loop();
        // The clock is looked at only now and then: it costs more than the spin.
        for _ in 0..1000 {
            if condition() {
                return;
            }
            spin_loop();
        }
        assert!(monotonic_ns() < deadline, "no message");
    }
}

fn lock_directory() -> PathBuf {
    std::env::temp_dir().join(format!("kingpin-bench-{}", rustix::process::geteuid().as_raw()))
}

fn shm_path(what: &str) -> PathBuf {
    PathBuf::from(format!("/dev/shm/kingpin-bench-{}-{what}", std::process::id()))
}

fn main() {
    if let Ok(role) = std::env::var(ROLE) {
        return receiver(&role);
    }
    print_machine();
    in_one_process(64);
    in_one_process(512);
    sender();
}

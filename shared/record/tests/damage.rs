//! Logs whose writer was killed, that were cut off, or whose bytes were changed.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout, missing_docs)]

mod support;

use std::io::{Read, Seek, SeekFrom, Write};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use record::{LogReader, LogWriter, compare, recover};
use support::{header, logged, words, write_log};

const CHILD: &str = "KINGPIN_TEST_LOG";

/// Not a test by itself: the process that gets killed. Writes at 1 kHz with a flush every 50 ticks and tells
/// after each tick how far it is.
#[test]
fn child_that_writes_until_it_is_killed() {
    let Some(path) = std::env::var_os(CHILD) else { return };
    let path = Path::new(&path);
    let mut progress = std::fs::File::create(path.with_extension("progress")).unwrap();
    let mut log = LogWriter::create(path, &header(false)).unwrap();
    let start = Instant::now();
    for tick in 0..60_000_u64 {
        let due = start + Duration::from_millis(tick);
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
        for id in logged() {
            log.write(id, tick, &words(id, tick));
        }
        if tick % 50 == 49 {
            log.flush();
        }
        progress.seek(SeekFrom::Start(0)).unwrap();
        progress.write_all(&tick.to_le_bytes()).unwrap();
    }
}

#[test]
fn a_killed_writer_loses_less_than_100_ms_and_recovery_mends_the_log() {
    for (attempt, milliseconds) in [400, 731, 1013].into_iter().enumerate() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("log.mcap");
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args(["child_that_writes_until_it_is_killed", "--exact"])
            .env(CHILD, &path)
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        std::thread::sleep(Duration::from_millis(milliseconds));
        child.kill().unwrap();
        child.wait().unwrap();
        let mut reached = [0; 8];
        let mut progress = std::fs::File::open(path.with_extension("progress")).unwrap();
        progress.read_exact(&mut reached).unwrap();
        let reached = u64::from_le_bytes(reached);
        assert!(reached > 50, "the child wrote for too short: {reached}");

        let log = LogReader::open(&path).unwrap();
        assert!(!log.files[0].scan.finished);
        for id in logged() {
            let region = log.region(id.region().name).unwrap();
            let last = *region.ticks.last().unwrap();
            let lost = reached.saturating_sub(last);
            println!("kill {attempt}: {} reached {reached}, logged {last}, lost {lost} ticks", region.name);
            assert!(lost <= 100, "lost {lost} ms");
            assert_eq!(region.missing(), []);
            assert_eq!(region.at_tick(last).unwrap(), words(id, last));
        }
        let mended = dir.path().join("mended.mcap");
        let report = recover(&path, &mended).unwrap();
        assert_eq!(report.messages, log.files[0].scan.messages);
        assert!(recover(&path, &mended).is_err(), "never overwritten");
        let again = LogReader::open(&mended).unwrap();
        assert!(again.intact());
        assert_eq!(again.header, header(false));
        assert_eq!(compare(&log, &again), []);
        assert_eq!(
            report.last_tick["vehicle_state"],
            *log.region("vehicle_state").unwrap().ticks.last().unwrap()
        );
    }
}

/// Reads a file that may be anything, and checks what must hold whatever it is.
fn must_not_panic(path: &Path, original_messages: u64) -> u64 {
    let Ok(log) = LogReader::open(path) else { return 0 };
    let scan = &log.files[0].scan;
    assert!(scan.messages <= original_messages, "{} of {original_messages}", scan.messages);
    scan.messages
}

/// xorshift64*: a seeded generator is enough to choose places.
struct Random(u64);
impl Random {
    fn below(&mut self, n: usize) -> usize {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 33) as usize % n
    }
}

/// A small log: three ticks a chunk, so that damage hits every kind of record.
fn small_log(path: &Path) -> (Vec<u8>, u64) {
    let mut log = LogWriter::create(path, &header(false)).unwrap();
    for tick in 0..12 {
        for id in logged().take(4) {
            log.write(id, tick, &words(id, tick));
        }
        log.event(tick, "note", "x");
        if tick % 3 == 2 {
            log.flush();
        }
    }
    let stats = log.finish().unwrap();
    (std::fs::read(path).unwrap(), stats.messages + stats.events)
}

#[test]
fn ten_thousand_damaged_logs_never_panic() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("log.mcap");
    let (bytes, messages) = small_log(&path);
    let mut random = Random(0x5eed_1234_5678_9abc);
    let mut read = [0_u64; 3];
    for case in 0..10_000 {
        let mut damaged = bytes.clone();
        let kind = case % 3;
        match kind {
            0 => damaged.truncate(random.below(bytes.len() + 1)),
            1 => {
                for _ in 0..1 + random.below(8) {
                    let at = random.below(bytes.len());
                    damaged[at] = random.below(256) as u8;
                }
            }
            _ => {
                // A block overwritten, removed, or repeated elsewhere.
                let from = random.below(bytes.len());
                let to = (from + 1 + random.below(300)).min(bytes.len());
                match random.below(3) {
                    0 => damaged[from..to].fill(random.below(256) as u8),
                    1 => drop(damaged.drain(from..to)),
                    _ => {
                        let length =
                            u64::from(random.below(2) == 0) * u64::MAX + random.below(1 << 20) as u64;
                        let end = (from + 8).min(bytes.len());
                        let length = length.to_le_bytes();
                        damaged[from..end].copy_from_slice(&length[..end - from]);
                    }
                }
            }
        }
        // A new file: to overwrite one makes some file systems wait for the disk, ten thousand times.
        std::fs::remove_file(&path).unwrap();
        std::fs::write(&path, &damaged).unwrap();
        read[kind] += must_not_panic(&path, messages);
        if case % 50 == 0 {
            let mended = dir.path().join("mended.mcap");
            if recover(&path, &mended).is_ok() {
                assert!(LogReader::open(&mended).unwrap().intact(), "case {case}");
                std::fs::remove_file(&mended).unwrap();
            }
        }
    }
    let share = read.map(|n| n as f64 / (messages as f64 * 3333.0));
    println!(
        "messages still read: truncated {:.2}, bytes changed {:.2}, blocks {:.2}",
        share[0], share[1], share[2]
    );
    assert!(share[1] > 0.4, "a few changed bytes must not cost everything: {share:?}");
}

#[test]
fn a_damaged_chunk_costs_that_chunk_only() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("log.mcap");
    write_log(&path, 0..400);
    let clean = LogReader::open(&path).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    // The content of a chunk in the middle, then the frame of one, found by its compression's name.
    let is_chunk = |i: usize| bytes[i..].starts_with(b"\x03\0\0\0lz4") && bytes[i - 37] == 6;
    let chunks: Vec<usize> = (37..bytes.len()).filter(|&i| is_chunk(i)).collect();
    let middle = chunks[chunks.len() / 2];
    for (at, what) in [(middle + 100, "content"), (middle - 36, "length")] {
        let mut damaged = bytes.clone();
        damaged[at] ^= 0x10;
        let path = dir.path().join(what);
        std::fs::write(&path, damaged).unwrap();
        let log = LogReader::open(&path).unwrap();
        let region = log.region("vehicle_state").unwrap();
        let missing = region.missing();
        assert_eq!(missing.len(), 1, "{what}: {missing:?}");
        assert!(region.missing_count() <= 100, "{what}: {missing:?}");
        assert_eq!(region.ticks.last(), Some(&399), "{what}: what follows is read");
        assert_eq!(log.header, clean.header);
        assert!(log.files[0].scan.bytes_dropped > 0 && !log.intact());
    }
    // The first chunk holds all definitions: their copy in the index of the finished file serves.
    let mut damaged = bytes.clone();
    damaged[chunks[0] + 100] ^= 0x10;
    let path = dir.path().join("first");
    std::fs::write(&path, damaged).unwrap();
    let log = LogReader::open(&path).unwrap();
    assert_eq!(log.region("vehicle_state").unwrap().ticks.len(), 400);
}

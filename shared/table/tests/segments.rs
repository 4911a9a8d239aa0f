//! What may lie in `/dev/shm`: other layouts, left-overs, rubbish. Each gives a typed error that names both sides.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

mod support;

use std::fs;
use std::os::unix::fs::{FileExt, symlink};
use std::sync::atomic::{AtomicUsize, Ordering};
use support::TestBench;
use table::{
    Bench, CreateOptions, MAGIC, OpenOptions, Read, RegionReader, RegionSpec, Table, TableError, TableInfo,
    list_bench, list_benches, remove_bench, segment_name,
};

const SPEC: RegionSpec =
    RegionSpec { name: "state", version: 2, layout_hash: 0xfeed_beef, words: 8, depth: 8 };
const INFO: TableInfo = TableInfo { run_id: 5, period_ns: 1_000_000, t0_ns: 0 };

fn make(bench: &TestBench, specs: &[RegionSpec]) -> Table {
    Table::create_shared(&bench.lock, specs, INFO, &CreateOptions::default()).unwrap()
}

fn open(bench: &TestBench, spec: RegionSpec) -> Result<Table, TableError> {
    Table::open(&bench.bench, &[spec], &OpenOptions::default())
}

#[test]
fn another_layout_is_refused_naming_both() {
    let bench = TestBench::new();
    make(&bench, &[SPEC]);
    for other in [
        RegionSpec { version: 3, ..SPEC },
        RegionSpec { layout_hash: 0xdead, ..SPEC },
        RegionSpec { words: 16, ..SPEC }, // larger than the segment
        RegionSpec { words: 4, ..SPEC },  // smaller
        RegionSpec { depth: 1 << 20, ..SPEC },
    ] {
        let error = open(&bench, other).unwrap_err();
        assert!(matches!(error, TableError::LayoutMismatch { .. }), "{error:?}");
        let text = error.to_string();
        for part in [
            segment_name(bench.bench.name(), "state"),
            SPEC.layout().to_string(),
            other.layout().to_string(),
            "version 2, layout hash 00000000feedbeef".to_owned(),
        ] {
            assert!(text.contains(&part), "{text:?} lacks {part:?}");
        }
    }
    assert!(open(&bench, SPEC).is_ok());
    // Whoever takes any layout can still look at it.
    assert_eq!(RegionReader::open_any(&bench.bench, "state").unwrap().layout(), SPEC.layout());
}

#[test]
fn left_overs_of_every_kind() {
    let bench = TestBench::new();
    let path = bench.path("state");
    assert!(matches!(open(&bench, SPEC), Err(TableError::NotFound { .. })));

    fs::write(&path, b"").unwrap();
    assert!(matches!(open(&bench, SPEC), Err(TableError::Empty { .. })));
    for bytes in [1, 8, 511] {
        fs::write(&path, vec![0; bytes]).unwrap();
        let error = open(&bench, SPEC).unwrap_err();
        assert!(
            matches!(error, TableError::Size { found_bytes, expected_bytes, .. }
            if found_bytes == bytes as u64 && expected_bytes == (64 + 1 + 8 * 9) * 8),
            "{error:?}"
        );
    }
    fs::write(&path, vec![0; 4096]).unwrap();
    assert!(matches!(open(&bench, SPEC), Err(TableError::NotReady { .. })));
    fs::write(&path, vec![0x41; 4096]).unwrap();
    assert!(matches!(open(&bench, SPEC), Err(TableError::NotATable { .. })));
    fs::remove_file(&path).unwrap();
    symlink("/etc/passwd", &path).unwrap();
    assert!(open(&bench, SPEC).is_err());
    fs::remove_file(&path).unwrap();
    fs::create_dir(&path).unwrap();
    assert!(open(&bench, SPEC).is_err());
    fs::remove_dir(&path).unwrap();
    rustix::fs::mknodat(rustix::fs::CWD, &path, rustix::fs::FileType::Fifo, 0o600.into(), 0).unwrap();
    assert!(open(&bench, SPEC).is_err()); // and does not hang
    fs::remove_file(&path).unwrap();
}

#[test]
fn a_header_that_lies_about_the_size_is_refused() {
    let bench = TestBench::new();
    let table = make(&bench, &[SPEC]);
    let file = fs::OpenOptions::new().read(true).write(true).open(bench.path("state")).unwrap();
    let bytes = file.metadata().unwrap().len();
    let set = |word: u64, value: u64| file.write_all_at(&value.to_ne_bytes(), word * 8).unwrap();
    let any = || RegionReader::open_any(&bench.bench, "state").map(|_| ());
    for (words, depth) in
        [(9, 8), (8, 16), (7, 8), (u64::MAX, 8), (8, u64::MAX), (0, 8), (1 << 61, 1 << 61), (23, 3)]
    {
        set(3, words);
        set(4, depth);
        assert!(matches!(any(), Err(TableError::Size { .. })), "words {words}, depth {depth}");
    }
    set(3, 8);
    set(4, 8);
    any().unwrap();
    // Cut off or grown behind our back, between runs.
    drop(table);
    for other in [bytes - 8, bytes + 8, bytes * 2, 512] {
        file.set_len(other).unwrap();
        let error = open(&bench, SPEC).unwrap_err();
        assert!(
            matches!(error, TableError::Size { found_bytes, expected_bytes, .. }
            if found_bytes == other && expected_bytes == bytes),
            "{error:?}"
        );
    }
}

#[test]
fn left_overs_are_listed_refused_and_removed() {
    let bench = TestBench::new();
    let specs = [SPEC, RegionSpec { name: "other", ..SPEC }];
    {
        let table = make(&bench, &specs);
        table.claim_writer(0).unwrap().publish(4, &[44; 8]).unwrap();
    }
    // Everybody is gone, the table is still there: its last seconds can be read.
    let left = RegionReader::open_any(&bench.bench, "state").unwrap();
    let mut out = [0; 8];
    assert_eq!(left.read(4, &mut out), Read::Ready);
    assert_eq!(out, [44; 8]);
    let found = list_bench(&bench.bench).unwrap();
    assert_eq!(found.iter().map(|f| f.region.as_str()).collect::<Vec<_>>(), ["other", "state"]);
    assert!(list_benches().unwrap().contains(bench.bench.name()));
    match Table::create_shared(&bench.lock, &specs, INFO, &CreateOptions::default()) {
        Err(TableError::LeftOver { segments }) => assert_eq!(segments.len(), 2),
        other => panic!("{other:?}"),
    }
    fs::write(bench.path("zero"), b"").unwrap();
    assert_eq!(remove_bench(&bench.lock).unwrap(), 3);
    assert_eq!(list_bench(&bench.bench).unwrap(), []);
    assert!(!list_benches().unwrap().contains(bench.bench.name()));
    // The old mapping stays valid, and is not the new table.
    let table = make(&bench, &specs);
    assert_eq!(left.read(4, &mut out), Read::Ready);
    assert_eq!(table.reader(0).head(), 0);
}

#[test]
fn adopting_a_running_table() {
    let bench = TestBench::new();
    let first = make(&bench, &[SPEC]);
    let mut writer = first.claim_writer(0).unwrap();
    writer.publish(0, &[1; 8]).unwrap();
    drop(first);
    let second = Table::adopt(&bench.lock, &[SPEC]).unwrap();
    second.set_t0(99).unwrap();
    assert_eq!(writer.reader().header().t0_ns(), Some(99));
    writer.publish(1, &[2; 8]).unwrap();
    assert_eq!(second.reader(0).head(), 2);
}

#[test]
fn a_failed_making_leaves_nothing() {
    let bench = TestBench::new();
    let huge = RegionSpec { name: "huge", words: 1 << 24, depth: 1 << 24, ..SPEC };
    let made = Table::create_shared(&bench.lock, &[SPEC, huge], INFO, &CreateOptions::default());
    assert!(matches!(made, Err(TableError::NoMemory { .. })), "{made:?}");
    assert_eq!(list_bench(&bench.bench).unwrap(), []);
}

#[test]
fn names_that_are_too_long_or_wrong() {
    let base = tempfile::tempdir().unwrap();
    for bad in ["", &"x".repeat(41), &"x".repeat(300), "../etc", "Upper", "a.b", "ä"] {
        assert!(matches!(Bench::with_base(bad, base.path()), Err(TableError::BenchName { .. })), "{bad}");
    }
    let longest = Bench::with_base(&"x".repeat(40), base.path()).unwrap();
    let lock = longest.lock().unwrap();
    let name: &'static str = "r23456789_123456789_123456789_123456789_123456789_123456789_1234";
    let specs = [RegionSpec { name, ..SPEC }];
    Table::create_shared(&lock, &specs, INFO, &CreateOptions::default()).unwrap();
    assert_eq!(remove_bench(&lock).unwrap(), 1);
    let too_long =
        RegionSpec { name: "r23456789_123456789_123456789_123456789_123456789_123456789_12345", ..SPEC };
    let made = Table::create_shared(&lock, &[too_long], INFO, &CreateOptions::default());
    assert!(matches!(made, Err(TableError::Spec { .. })));
    assert!(matches!(Table::create_local(&[SPEC, SPEC], INFO), Err(TableError::Spec { .. })));
}

#[test]
fn lock_directories_that_others_could_write_to_are_refused() {
    use std::os::unix::fs::PermissionsExt;
    let base = tempfile::tempdir().unwrap();
    let set = |mode| fs::set_permissions(base.path(), fs::Permissions::from_mode(mode)).unwrap();
    let bench = Bench::with_base("locks", base.path()).unwrap();
    set(0o777);
    assert!(matches!(bench.lock(), Err(TableError::UnsafeDirectory { .. })));
    set(0o755);
    assert!(bench.lock().is_ok());
    let linked = base.path().join("link");
    symlink("/tmp", &linked).unwrap();
    let bench = Bench::with_base("locks", linked).unwrap();
    assert!(matches!(bench.lock(), Err(TableError::UnsafeDirectory { .. })));
}

/// Many take and remove the same lock: never do two hold it, and nothing is left in the end.
#[test]
fn a_lock_whose_file_is_removed_has_one_holder_at_a_time_and_leaves_nothing() {
    let base = tempfile::tempdir().unwrap();
    let bench = Bench::with_base("one", base.path()).unwrap();
    let (holders, taken, refused) = (AtomicUsize::new(0), AtomicUsize::new(0), AtomicUsize::new(0));
    std::thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| {
                while taken.load(Ordering::Relaxed) < 5000 {
                    match bench.lock() {
                        Ok(lock) => {
                            assert_eq!(holders.fetch_add(1, Ordering::SeqCst), 0, "two holders");
                            taken.fetch_add(1, Ordering::Relaxed);
                            // Long enough for another who waited for the removed file to come in.
                            (0..20_000).for_each(|_| std::hint::spin_loop());
                            holders.fetch_sub(1, Ordering::SeqCst);
                            drop(lock);
                        }
                        Err(TableError::Claimed { .. }) => drop(refused.fetch_add(1, Ordering::Relaxed)),
                        Err(other) => panic!("{other}"),
                    }
                }
            });
        }
    });
    assert!(refused.load(Ordering::Relaxed) > 100, "they never met");
    assert!(!bench.directory().exists());
}

/// What was killed leaves its locks; who cleans takes them, but not those that are held.
#[test]
fn removing_a_bench_removes_its_locks_too() {
    let bench = TestBench::new();
    let table = make(&bench, &[SPEC]);
    let lock = bench.bench.directory().join("region.state.lock");
    let writer = table.claim_writer(0).unwrap();
    remove_bench(&bench.lock).unwrap();
    assert!(lock.exists(), "it is held");
    drop(writer);
    assert!(!lock.exists(), "who ends in order takes it along");
    fs::write(&lock, "1 1").unwrap(); // as a killed writer leaves it
    remove_bench(&bench.lock).unwrap();
    assert!(!lock.exists());
}

#[test]
fn the_magic_is_what_the_format_says() {
    let bench = TestBench::new();
    make(&bench, &[SPEC]);
    let bytes = fs::read(bench.path("state")).unwrap();
    assert_eq!(bytes[..8], MAGIC.to_ne_bytes());
    assert_eq!(bytes.len(), (64 + 1 + 8 * 9) * 8);
}

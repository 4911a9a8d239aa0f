//! The hot path allocates nothing: write, ring, read, latest, head and every stage of a wait, in optimised builds too.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

mod support;

use assert_no_alloc::{AllocDisabler, assert_no_alloc, reset_violation_count, violation_count};
use std::hint::black_box;
use table::{CreateOptions, Read, RegionSpec, Table, TableInfo, Wait, monotonic_ns};

#[global_allocator]
static ALLOCATOR: AllocDisabler = AllocDisabler;

const SPECS: [RegionSpec; 1] =
    [RegionSpec { name: "state", version: 1, layout_hash: 1, words: 64, depth: 8 }];
const INFO: TableInfo = TableInfo { run_id: 1, period_ns: 1_000_000, t0_ns: 0 };

fn exercise(table: &Table) {
    let mut writer = table.claim_writer(0).unwrap();
    let reader = table.reader(0).clone();
    let mut out = [0; 64];
    reset_violation_count();
    assert_no_alloc(|| {
        for n in 0..100 {
            writer.write(n, &[n; 64]).unwrap();
            writer.ring();
            assert!(writer.write(n, &[n; 64]).is_err());
            assert_eq!(reader.read(n, &mut out), Read::Ready);
            assert_eq!(reader.read(n + 1, &mut out), Read::NotYet);
            assert!(reader.latest(n + 3, black_box(&mut out)).is_some());
            assert!(reader.wait_for(n, &Wait::until(0)));
            let now = monotonic_ns();
            assert!(!reader.wait_for(n + 1, &Wait::due(now + 40_000, 20_000, 20_000, now + 100_000)));
            black_box((reader.head(), reader.header().t0_ns()));
        }
    });
    assert_eq!(violation_count(), 0);
}

// One test, because the count of violations is the process's.
#[test]
fn hot_path_allocates_nothing() {
    reset_violation_count();
    assert_no_alloc(|| drop(black_box(vec![1u8; 100])));
    assert!(violation_count() > 0, "the check does not see an allocation");

    exercise(&Table::create_local(&SPECS, INFO).unwrap());
    let bench = support::TestBench::new();
    exercise(&Table::create_shared(&bench.lock, &SPECS, INFO, &CreateOptions::default()).unwrap());
}

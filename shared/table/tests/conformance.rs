//! One suite, every home: what a table promises, checked on process-local and on shared memory alike.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

mod support;

use std::sync::atomic::{AtomicU64, Ordering};
use support::TestBench;
use table::{
    CreateOptions, Latest, OpenOptions, Read, Refused, RegionSpec, Table, TableError, TableInfo, Wait,
    monotonic_ns,
};

const SPECS: [RegionSpec; 2] = [
    RegionSpec { name: "first", version: 3, layout_hash: 0xabc, words: 5, depth: 4 },
    RegionSpec { name: "second", version: 1, layout_hash: 0xdef, words: 1, depth: 16 },
];
const INFO: TableInfo = TableInfo { run_id: 77, period_ns: 500_000, t0_ns: 0 };

/// A table as its maker sees it, and as a reader does.
struct Sides {
    maker: Table,
    reader: Option<Table>,
    _bench: Option<TestBench>,
}

impl Sides {
    fn reader(&self) -> &Table {
        self.reader.as_ref().unwrap_or(&self.maker)
    }
}

fn local() -> Sides {
    Sides { maker: Table::create_local(&SPECS, INFO).unwrap(), reader: None, _bench: None }
}

fn shared() -> Sides {
    let bench = TestBench::new();
    let maker = Table::create_shared(&bench.lock, &SPECS, INFO, &CreateOptions::default()).unwrap();
    let reader = Table::open(&bench.bench, &SPECS, &OpenOptions::default()).unwrap();
    Sides { maker, reader: Some(reader), _bench: Some(bench) }
}

macro_rules! suite {
    ($($check:ident),* $(,)?) => {
        mod on_local_memory { $( #[test] fn $check() { super::$check(&super::local()); } )* }
        mod on_shared_memory { $( #[test] fn $check() { super::$check(&super::shared()); } )* }
    };
}

suite!(
    header_is_as_made,
    empty_table_is_empty,
    history_by_tick,
    published_ticks_never_change,
    one_writer_and_epochs,
    start_is_set_once_for_all,
    waiting_for_a_tick,
    readers_in_threads_see_whole_ticks,
    killed_in_a_write,
);

fn header_is_as_made(sides: &Sides) {
    let table = sides.reader();
    assert_eq!((table.len(), table.index_of("second"), table.index_of("third")), (2, Some(1), None));
    for (spec, region) in SPECS.iter().zip(table.readers()) {
        assert_eq!(region.name(), spec.name);
        assert_eq!(region.layout(), spec.layout());
        assert_eq!((region.words(), region.depth()), (spec.words, spec.depth));
        assert_eq!(region.header().info(), INFO);
        assert_eq!((region.header().epoch(), region.header().writer()), (0, None));
    }
}

fn empty_table_is_empty(sides: &Sides) {
    for region in sides.reader().readers() {
        let mut out = vec![0; region.words()];
        assert_eq!(region.head(), 0);
        assert_eq!(region.read(0, &mut out), Read::NotYet);
        assert_eq!(region.latest(0, &mut out), None);
    }
}

fn history_by_tick(sides: &Sides) {
    let mut writer = sides.maker.claim_writer(0).unwrap();
    let reader = sides.reader().reader(0);
    let mut out = [0; 5];
    for n in [10, 11, 13, 14] {
        writer.write(n, &[n, n + 1, n + 2, n + 3, n + 4]).unwrap();
    }
    assert_eq!(reader.read(10, &mut out), Read::Overwritten);
    assert_eq!(reader.read(11, &mut out), Read::Ready);
    assert_eq!(out, [11, 12, 13, 14, 15]);
    assert_eq!(reader.read(12, &mut out), Read::Missing);
    assert_eq!(reader.read(15, &mut out), Read::NotYet);
    assert_eq!(reader.read(0, &mut out), Read::Overwritten);
    assert_eq!(reader.latest(20, &mut out), Some(Latest { tick: 14, age: 6 }));
    assert_eq!(out[0], 14);
    assert_eq!(sides.reader().reader(1).head(), 0, "the other region is untouched");
}

fn published_ticks_never_change(sides: &Sides) {
    let mut writer = sides.maker.claim_writer(1).unwrap();
    writer.publish(5, &[50]).unwrap();
    assert_eq!(writer.write(5, &[51]), Err(Refused { tick: 5, head: 6 }));
    drop(writer);
    // Nor by the next writer.
    let mut writer = sides.maker.claim_writer(1).unwrap();
    assert_eq!(writer.write(4, &[41]), Err(Refused { tick: 4, head: 6 }));
    let mut out = [0];
    assert_eq!(sides.reader().reader(1).read(5, &mut out), Read::Ready);
    assert_eq!(out, [50]);
}

fn one_writer_and_epochs(sides: &Sides) {
    let first = sides.reader().claim_writer(0).unwrap();
    assert_eq!(first.epoch(), 1);
    let header = sides.maker.reader(0).header();
    assert_eq!(header.writer().unwrap(), table::this_process());
    match sides.maker.claim_writer(0) {
        Err(TableError::Claimed { what, holder_pid }) => {
            assert!(what.contains("first"), "{what}");
            assert_eq!(holder_pid, Some(std::process::id()));
        }
        other => panic!("a second writer was let in: {other:?}"),
    }
    let other_region = sides.maker.claim_writer(1).unwrap();
    assert_eq!(other_region.epoch(), 1);
    drop(first);
    assert_eq!(header.writer(), None);
    assert_eq!(sides.maker.claim_writer(0).unwrap().epoch(), 2);
    assert_eq!(sides.reader().reader(0).header().epoch(), 2);
}

fn start_is_set_once_for_all(sides: &Sides) {
    assert_eq!(sides.reader().reader(1).header().t0_ns(), None);
    sides.maker.set_t0(123_456_789).unwrap();
    for region in sides.reader().readers() {
        assert_eq!(region.header().t0_ns(), Some(123_456_789));
    }
    if let Some(reader) = &sides.reader {
        assert!(matches!(reader.set_t0(1), Err(TableError::NotOwner)));
    }
}

fn waiting_for_a_tick(sides: &Sides) {
    let mut writer = sides.maker.claim_writer(1).unwrap();
    let reader = sides.reader().reader(1);
    let ms = 1_000_000;
    let start = monotonic_ns();
    assert!(!reader.wait_for(0, &Wait::until(start + 3 * ms)), "nothing is published");
    assert!(monotonic_ns() >= start + 3 * ms);
    std::thread::scope(|scope| {
        // Asleep on the bell; asleep before the spin; in the spin.
        let far = start + 60_000 * ms;
        for wait in [Wait::until(far), Wait::due(far, ms, ms, far), Wait::due(start, 0, 60_000 * ms, far)] {
            scope.spawn(move || assert!(reader.wait_for(7, &wait), "{wait:?}"));
        }
        for n in 0..8 {
            std::thread::sleep(std::time::Duration::from_millis(2));
            writer.publish(n, &[n]).unwrap();
        }
    });
    assert!(monotonic_ns() < start + 60_000 * ms, "woken, not timed out");
    assert!(reader.wait_for(3, &Wait::until(0)), "published long ago, deadline long past");
}

fn readers_in_threads_see_whole_ticks(sides: &Sides) {
    const TICKS: u64 = 20_000;
    let mut writer = sides.maker.claim_writer(1).unwrap();
    let ready = AtomicU64::new(0);
    std::thread::scope(|scope| {
        for _ in 0..2 {
            let (reader, ready) = (sides.reader().reader(1).clone(), &ready);
            scope.spawn(move || {
                let mut out = [0];
                let mut n = 0;
                while n < TICKS {
                    match reader.read(n, &mut out) {
                        Read::Ready => {
                            assert_eq!(out, [n * 3]);
                            ready.fetch_add(1, Ordering::Relaxed);
                            n += 1;
                        }
                        Read::NotYet => {
                            assert!(reader.wait_for(n, &Wait::until(monotonic_ns() + 20_000_000_000)))
                        }
                        Read::Overwritten => n = reader.head() - 1,
                        Read::Missing => panic!("tick {n} was written"),
                    }
                }
            });
        }
        for n in 0..TICKS {
            writer.publish(n, &[n * 3]).unwrap();
        }
    });
    assert!(ready.load(Ordering::Relaxed) >= 2, "each reader got the last tick at least");
}

fn killed_in_a_write(sides: &Sides) {
    let reader = sides.reader().reader(0);
    let mut out = [0; 5];
    let mut writer = sides.maker.claim_writer(0).unwrap();
    writer.write(0, &[9; 5]).unwrap();
    writer.write_interrupted(1, &[8; 2]).unwrap();
    assert_eq!(reader.read(1, &mut out), Read::NotYet);
    assert_eq!(reader.latest(1, &mut out), Some(Latest { tick: 0, age: 1 }));
    drop(writer);
    let mut writer = sides.maker.claim_writer(0).unwrap();
    assert_eq!((writer.epoch(), writer.head()), (2, 1));
    writer.write(3, &[7; 5]).unwrap();
    assert_eq!(reader.read(1, &mut out), Read::Missing);
    assert_eq!(reader.read(2, &mut out), Read::Missing);
    assert_eq!(reader.read(3, &mut out), Read::Ready);
    assert_eq!(reader.read(0, &mut out), Read::Ready);
}

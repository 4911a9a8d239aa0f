//! Torn reads under real threads. One writer goes round a ring of depth 2 as fast as it can, a reader reads the newest
//! tick as fast as it can, 512 B each. What counts is not the number of reads but the number of collisions: reads whose
//! words were being overwritten while they were copied. With the re-check none may be torn; without it some are.
//!
//! By default until a million collisions, or 6 s; `KINGPIN_TORN_COLLISIONS=100000000`: until that many.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};
use table::slot::{Guards, Read, Ring, Sound, ring_words};

const WORDS: usize = 64;
const DEPTH: usize = 2;
/// No payload has it.
const UNTOUCHED: u64 = u64::MAX;

#[derive(Debug, Default, Clone, Copy)]
struct Tally {
    reads: u64,
    ready: u64,
    /// Reads that copied words which were being overwritten.
    collisions: u64,
    /// `Ready`, but with words of two ticks.
    torn: u64,
}

/// Runs until `done` or `reads_max` reads.
fn collide<G: Guards + Sync>(reads_max: u64, done: impl Fn(&Tally) -> bool) -> Tally {
    let memory: Vec<AtomicU64> = (0..ring_words(WORDS, DEPTH)).map(|_| AtomicU64::new(0)).collect();
    let stop = AtomicBool::new(false);
    let mut tally = Tally::default();
    std::thread::scope(|scope| {
        scope.spawn(|| {
            let ring: Ring<'_, AtomicU64, G> = Ring::new(&memory, WORDS, DEPTH);
            let mut payload = [0; WORDS];
            let mut n = 0;
            while !stop.load(Ordering::Relaxed) {
                payload.fill(n);
                ring.write(n, &payload).unwrap();
                n += 1;
            }
        });
        let ring: Ring<'_, AtomicU64, G> = Ring::new(&memory, WORDS, DEPTH);
        while tally.reads < reads_max && !done(&tally) {
            let Some(n) = ring.head().checked_sub(1) else { continue };
            let mut out = [UNTOUCHED; WORDS];
            tally.reads += 1;
            match ring.read(n, &mut out) {
                Read::Ready => {
                    tally.ready += 1;
                    tally.torn += u64::from(out.iter().any(|word| *word != n));
                }
                Read::Overwritten => tally.collisions += u64::from(out[0] != UNTOUCHED),
                Read::NotYet | Read::Missing => panic!("tick {n} is below the head and was written"),
            }
        }
        stop.store(true, Ordering::Relaxed);
    });
    tally
}

struct NoRecheck;
impl Guards for NoRecheck {
    const RECHECK: bool = false;
}

// One test, so that its two halves do not take the cores from each other.
#[test]
fn no_read_is_torn_in_a_million_collisions_but_some_are_without_the_recheck() {
    let tally = collide::<NoRecheck>(200_000_000, |t| t.torn >= 1000);
    println!("without the re-check: {tally:?}");
    assert!(tally.torn > 0, "the test cannot see a torn read: {tally:?}");

    let asked: Option<u64> = std::env::var("KINGPIN_TORN_COLLISIONS").ok().map(|n| n.parse().unwrap());
    let wanted = asked.unwrap_or(1_000_000);
    // A busy machine rarely runs both threads at once; then as many as come in a few seconds, unless asked for.
    let end = asked.is_none().then(|| Instant::now() + Duration::from_secs(6));
    let tally = collide::<Sound>(u64::MAX, |t| {
        t.collisions >= wanted
            || t.torn > 0
            || t.reads % 4096 == 4095 && end.is_some_and(|end| Instant::now() > end)
    });
    println!("with the re-check: {tally:?}");
    assert_eq!(tally.torn, 0, "{tally:?}");
    assert!(tally.ready > 0, "{tally:?}");
    if std::thread::available_parallelism().map_or(1, usize::from) >= 2 {
        assert!(tally.collisions >= wanted.min(1000), "the test says nothing: {tally:?}");
    }
}

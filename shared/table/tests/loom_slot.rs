//! Model check of the slot protocol with loom: every interleaving and every stale value that the C11 memory model
//! allows, for one writer and one reader of a ring of depth 2 with 2 words. The code checked is the code shipped
//! (`table::slot` is generic over the atomic type). Each guard is then taken away in turn, and the model must fail.
//!
//! Runs as an ordinary test: `cargo test --release -p table --test loom_slot`.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use loom::sync::atomic::{AtomicU64, Ordering};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64 as Count, Ordering::Relaxed};
use table::slot::{Guards, Read, Ring, Sound, Word, ring_words};

/// The modelled word, and beside it what was stored last, for the writer's own use (see `Word::load_own`).
struct Modelled(AtomicU64, Count);

impl Word for Modelled {
    fn load(&self, order: Ordering) -> u64 {
        self.0.load(order)
    }
    fn load_own(&self) -> u64 {
        self.1.load(Relaxed)
    }
    fn store(&self, value: u64, order: Ordering) {
        self.0.store(value, order);
        self.1.store(value, Relaxed);
    }
    fn fence(order: Ordering) {
        loom::sync::atomic::fence(order);
    }
}

const WORDS: usize = 2;
const DEPTH: usize = 2;

fn memory() -> Arc<Vec<Modelled>> {
    Arc::new((0..ring_words(WORDS, DEPTH)).map(|_| Modelled(AtomicU64::new(0), Count::new(0))).collect())
}

fn ring<G: Guards>(memory: &[Modelled]) -> Ring<'_, Modelled, G> {
    Ring::new(memory, WORDS, DEPTH)
}

/// What the writer of an epoch says in tick `n`: both words tell tick and epoch, differently.
fn payload(n: u64, epoch: u64) -> [u64; WORDS] {
    [100 * n + epoch, 7000 + 100 * n + epoch]
}

/// Explores all executions of `writer` beside `reader`. Returns how many there were.
fn explore<G: Guards + 'static>(writer: fn(Ring<'_, Modelled, G>), reader: fn(Ring<'_, Modelled, G>)) -> u64 {
    let executions = Arc::new(Count::new(0));
    let counted = executions.clone();
    let mut model = loom::model::Builder::new();
    model.preemption_bound = None;
    model.check(move || {
        counted.fetch_add(1, Relaxed);
        let memory = memory();
        let theirs = memory.clone();
        let thread = loom::thread::spawn(move || writer(ring(&theirs)));
        reader(ring(&memory));
        thread.join().unwrap();
    });
    executions.load(Relaxed)
}

/// Reads tick `n` once, which `epoch` alone publishes, and which is not skipped.
fn read_checked<G: Guards>(ring: &Ring<'_, Modelled, G>, n: u64, epoch: u64) {
    let mut out = [0; WORDS];
    match ring.read(n, &mut out) {
        Read::Ready => assert_eq!(out, payload(n, epoch), "tick {n}"),
        Read::Missing => panic!("tick {n} was written and is called missing"),
        Read::NotYet | Read::Overwritten => {}
    }
}

/// The writer goes round the ring while a reader reads its first tick.
fn lapping_a_read<G: Guards + 'static>() -> u64 {
    explore::<G>(
        |ring| (0..3).for_each(|n| ring.write(n, &payload(n, 1)).unwrap()),
        |ring| read_checked(&ring, 0, 1),
    )
}

/// The writer goes round the ring while a reader reads the newest tick.
fn lapping_the_latest<G: Guards + 'static>() -> u64 {
    explore::<G>(
        |ring| (0..3).for_each(|n| ring.write(n, &payload(n, 1)).unwrap()),
        |ring| {
            let mut out = [0; WORDS];
            if let Some(latest) = ring.latest(9, &mut out) {
                assert_eq!(out, payload(latest.tick, 1));
                assert_eq!(latest.age, 9 - latest.tick);
            }
        },
    )
}

fn dies_in_tick_1<G: Guards>(ring: Ring<'_, Modelled, G>) {
    ring.write(0, &payload(0, 1)).unwrap();
    ring.write_interrupted(1, &payload(1, 1)[..1]).unwrap();
    ring.write(2, &payload(2, 2)).unwrap();
    ring.write(3, &payload(3, 2)).unwrap();
    ring.write(5, &payload(5, 2)).unwrap();
}

/// The writer dies in the middle of tick 1; its successor goes on at tick 2. Tick 1 never comes.
fn killed_in_a_write<G: Guards + 'static>() -> u64 {
    explore::<G>(dies_in_tick_1, |ring| {
        let mut out = [0; WORDS];
        let read = ring.read(1, &mut out);
        assert_ne!(read, Read::Ready, "tick 1 was never finished: {out:?}");
    })
}

/// The same; the successor's ticks 3 and 5 go into the slot in which its predecessor died, over each other.
fn after_a_kill_in_a_write<G: Guards + 'static>() -> u64 {
    explore::<G>(dies_in_tick_1, |ring| read_checked(&ring, 3, 2))
}

/// The writer dies after finishing tick 0 but before publishing it; its successor writes tick 0 anew. Whoever reads it
/// gets what was published, and nothing of what was not: same stamps, other words (ABA).
fn killed_before_the_head<G: Guards + 'static>() -> u64 {
    explore::<G>(
        |ring| {
            ring.write_unpublished(0, &payload(0, 1)).unwrap();
            ring.write(0, &payload(0, 2)).unwrap();
            assert!(ring.write(0, &payload(0, 3)).is_err());
        },
        |ring| {
            let mut out = [0; WORDS];
            if ring.read(0, &mut out) == Read::Ready {
                assert_eq!(out, payload(0, 2));
            }
        },
    )
}

#[test]
fn the_protocol_holds() {
    for (name, executions) in [
        ("lapping a read", lapping_a_read::<Sound>()),
        ("lapping the latest", lapping_the_latest::<Sound>()),
        ("killed in a write", killed_in_a_write::<Sound>()),
        ("after a kill in a write", after_a_kill_in_a_write::<Sound>()),
        ("killed before the head", killed_before_the_head::<Sound>()),
    ] {
        println!("{name}: {executions} executions");
        assert!(executions > 5, "{name}: only {executions} executions: the model does not explore");
    }
}

macro_rules! each_guard_is_needed {
    ($($test:ident: without $guard:ident, $scenario:ident fails;)*) => {$(
        #[test]
        fn $test() {
            struct Mutant;
            impl Guards for Mutant {
                const $guard: bool = false;
            }
            let model = std::thread::spawn(|| $scenario::<Mutant>());
            let Err(cause) = model.join() else { panic!("the model does not notice the missing guard") };
            let cause = cause.downcast_ref::<String>().expect("a failed assertion");
            assert!(cause.contains("left"), "failed for another reason: {cause}");
        }
    )*};
}

each_guard_is_needed! {
    no_write_fence: without WRITE_FENCE, lapping_a_read fails;
    relaxed_head_store: without HEAD_RELEASE, lapping_the_latest fails;
    no_fence_after_the_head_load: without HEAD_FENCE, lapping_the_latest fails;
    no_read_fence: without READ_FENCE, lapping_a_read fails;
    no_recheck: without RECHECK, lapping_a_read fails;
    no_gate: without GATE, killed_before_the_head fails;
}

//! The ring of one region: one writer, many readers, history by tick.
//!
//! Memory `m` after the region's header: `m[0]` = head = newest complete tick + 1; then `depth` slots of
//! `[stamp, words...]`. Stamp: 0 never written, 2n+1 busy with tick n, 2n+2 done. All zero = a valid empty ring.
//!
//! The writer never waits and never changes a published tick. A reader makes one bounded attempt, as a sequence
//! lock does [Boehm, "Can seqlocks get along with programming language memory models?", MSPC 2012], gated by the
//! head: a tick at or above the head is not read, so what a killed writer left half-done is never seen, whatever
//! its successor writes there.
//!
//! All readers' loads are `Relaxed` with a fence, because only relaxed loads are sound on memory mapped read-only.
//!
//! Generic over the atomic type, so that loom can model exactly this code (`tests/loom_slot.rs`), and over
//! [`Guards`], so that tests can show what each guard is for. Correct while ticks stay below 2^62.

use std::sync::atomic::{self, AtomicU64, Ordering};

/// What the ring needs of an atomic word: std's, or a model checker's.
pub trait Word: Sized {
    /// Atomic load.
    fn load(&self, order: Ordering) -> u64;
    /// Relaxed load of the head by the one who alone stores it: always what was stored last. Apart from `load` because
    /// loom 0.7 keeps only the last access of a word to find races with, so that a writer's own load just before its
    /// store hides the readers' loads from it, and whole scenarios stay unexplored.
    fn load_own(&self) -> u64 {
        self.load(Ordering::Relaxed)
    }
    /// Atomic store.
    fn store(&self, value: u64, order: Ordering);
    /// Memory fence of the same memory model.
    fn fence(order: Ordering);
}

impl Word for AtomicU64 {
    #[inline(always)]
    fn load(&self, order: Ordering) -> u64 {
        AtomicU64::load(self, order)
    }
    #[inline(always)]
    fn store(&self, value: u64, order: Ordering) {
        AtomicU64::store(self, value, order);
    }
    #[inline(always)]
    fn fence(order: Ordering) {
        atomic::fence(order);
    }
}

/// Which guards of the protocol stand. Only [`Sound`] is for use; tests switch single guards off to show that the
/// model checker and the stress test notice.
pub trait Guards {
    /// Release fence between the busy stamp and the words.
    const WRITE_FENCE: bool = true;
    /// Release order of the head store.
    const HEAD_RELEASE: bool = true;
    /// Acquire fence after the head load.
    const HEAD_FENCE: bool = true;
    /// Acquire fence between the words and the second stamp load.
    const READ_FENCE: bool = true;
    /// Second stamp load.
    const RECHECK: bool = true;
    /// Ticks at or above the head are not read.
    const GATE: bool = true;
}

/// Every guard in place.
#[derive(Debug, Clone, Copy)]
pub struct Sound;
impl Guards for Sound {}

/// Outcome of one attempt to read one tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Read {
    /// The tick's words are in the output.
    Ready,
    /// Not published yet.
    NotYet,
    /// Skipped, or its writer died in it: it will never come.
    Missing,
    /// Older than the history, or overwritten during the read. The output may be garbage.
    Overwritten,
}

/// A write to a tick that is already published.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Refused {
    /// The tick that was to be written.
    pub tick: u64,
    /// The first tick that may be written.
    pub head: u64,
}

impl std::fmt::Display for Refused {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "tick {} is already published (the first free tick is {})", self.tick, self.head)
    }
}
impl std::error::Error for Refused {}

/// The newest published tick, as found by [`Ring::latest`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Latest {
    /// The tick.
    pub tick: u64,
    /// `now` minus the tick, in ticks; 0 if the tick is ahead of `now`.
    pub age: u64,
}

/// `u64` words that a ring of `depth` slots of `words` payload words takes.
pub const fn ring_words(words: usize, depth: usize) -> usize {
    1 + depth * (1 + words)
}

/// A ring over borrowed memory. Making one costs nothing; it holds no state of its own.
#[derive(Debug)]
pub struct Ring<'a, A: Word = AtomicU64, G: Guards = Sound> {
    memory: &'a [A],
    words: usize,
    mask: u64,
    guards: std::marker::PhantomData<G>,
}

impl<'a, A: Word, G: Guards> Ring<'a, A, G> {
    /// A ring over `memory`, which has `ring_words(words, depth)` words; `depth` is a power of two, at least 2.
    #[inline]
    pub fn new(memory: &'a [A], words: usize, depth: usize) -> Self {
        assert!(depth.is_power_of_two() && depth >= 2, "ring depth {depth}");
        assert_eq!(memory.len(), ring_words(words, depth), "ring memory");
        Ring { memory, words, mask: depth as u64 - 1, guards: std::marker::PhantomData }
    }

    #[inline]
    fn slot(&self, n: u64) -> (&'a A, &'a [A]) {
        let stride = 1 + self.words;
        let at = 1 + (n & self.mask) as usize * stride;
        let slot = &self.memory[at..at + stride];
        (&slot[0], &slot[1..])
    }

    /// Publishes `payload` as tick `n`. Ticks may be skipped, never repeated. Only the region's one writer calls this.
    ///
    /// # Errors
    /// [`Refused`] if tick `n` or a later one is published already.
    #[inline]
    pub fn write(&self, n: u64, payload: &[u64]) -> Result<(), Refused> {
        self.write_from(self.memory[0].load_own(), n, payload)
    }

    /// As [`Ring::write`], by the writer's own word on the first tick that may be written: a head that somebody else has
    /// spoilt is put right by this.
    ///
    /// # Errors
    /// [`Refused`] if `n` is below `next`.
    #[inline]
    pub fn write_from(&self, next: u64, n: u64, payload: &[u64]) -> Result<(), Refused> {
        self.fill(next, n, payload)?;
        let (stamp, _) = self.slot(n);
        stamp.store(2 * n + 2, Ordering::Relaxed);
        // Publishes the stamp and the words.
        let order = if G::HEAD_RELEASE { Ordering::Release } else { Ordering::Relaxed };
        self.memory[0].store(n + 1, order);
        Ok(())
    }

    /// The first half of a write: the busy stamp and the words, as many as `payload` has.
    fn fill(&self, next: u64, n: u64, payload: &[u64]) -> Result<(), Refused> {
        debug_assert!(n < 1 << 62);
        if n < next {
            return Err(Refused { tick: n, head: next });
        }
        let (stamp, words) = self.slot(n);
        assert!(payload.len() <= words.len(), "payload of {} words, slot of {}", payload.len(), words.len());
        stamp.store(2 * n + 1, Ordering::Relaxed);
        if G::WRITE_FENCE {
            A::fence(Ordering::Release); // no word before the busy stamp
        }
        for (word, value) in words.iter().zip(payload) {
            word.store(*value, Ordering::Relaxed);
        }
        Ok(())
    }

    /// Leaves tick `n` as a writer killed in the middle of a write leaves it: busy, with only `payload` (which may be
    /// shorter than the slot) stored. For tests and fault campaigns.
    ///
    /// # Errors
    /// As [`Ring::write`].
    #[doc(hidden)]
    pub fn write_interrupted(&self, n: u64, payload: &[u64]) -> Result<(), Refused> {
        self.fill(self.memory[0].load_own(), n, payload)
    }

    /// Leaves tick `n` as a writer killed just before publishing leaves it: done, but above the head. For tests.
    ///
    /// # Errors
    /// As [`Ring::write`].
    #[doc(hidden)]
    pub fn write_unpublished(&self, n: u64, payload: &[u64]) -> Result<(), Refused> {
        self.fill(self.memory[0].load_own(), n, payload)?;
        self.slot(n).0.store(2 * n + 2, Ordering::Relaxed);
        Ok(())
    }

    /// Newest published tick + 1; 0 if none.
    #[inline]
    pub fn head(&self) -> u64 {
        let head = self.memory[0].load(Ordering::Relaxed);
        if G::HEAD_FENCE {
            A::fence(Ordering::Acquire);
        }
        head
    }

    /// Stamp of the slot that tick `n` has or had.
    #[inline]
    fn stamp(&self, n: u64) -> u64 {
        self.slot(n).0.load(Ordering::Relaxed)
    }

    /// Whether tick `n` lies further behind the head than the history is long. Of a head whose own tick is not in the ring,
    /// because somebody has spoilt it, that says nothing.
    #[inline]
    fn is_outlived(&self, n: u64, head: u64) -> bool {
        head.saturating_sub(n) > self.mask + 1 && self.stamp(head - 1) == head.wrapping_mul(2)
    }

    /// Whether tick `n` or a later one is published. A spoilt head that is too high is not believed.
    #[inline]
    pub fn is_published(&self, n: u64) -> bool {
        let head = self.head();
        n < head && (head - n <= self.mask + 1 || self.stamp(n) >= done_stamp(n) || self.is_outlived(n, head))
    }

    /// The head as the slots bear it out: a head whose tick is not there was spoilt; then the newest tick that is. Goes
    /// through the whole ring in that case: not for the 1 ms path.
    #[inline]
    pub fn sound_head(&self) -> u64 {
        let head = self.head();
        if head == 0 || self.stamp(head - 1) == head.wrapping_mul(2) { head } else { self.head_of_slots() }
    }

    #[cold]
    fn head_of_slots(&self) -> u64 {
        let done = (0..=self.mask).map(|n| self.stamp(n)).filter(|stamp| stamp % 2 == 0);
        // A stamp in a slot that is not its tick's is spoilt, too; one that happens to fit its slot is believed.
        let sound = done.filter(|stamp| *stamp > 0 && self.stamp(stamp / 2 - 1) == *stamp);
        sound.max().unwrap_or(0) / 2
    }

    /// One bounded attempt to read tick `n` into `out`, which has exactly the region's words.
    #[inline]
    pub fn read(&self, n: u64, out: &mut [u64]) -> Read {
        let head = self.head();
        if G::GATE && n >= head {
            return Read::NotYet; // the gate: no ABA across epochs
        }
        if self.is_outlived(n, head) {
            return Read::Overwritten;
        }
        let (stamp, words) = self.slot(n);
        assert_eq!(out.len(), words.len(), "output of a read");
        let before = stamp.load(Ordering::Relaxed);
        let done = done_stamp(n);
        if before > done {
            return Read::Overwritten;
        }
        if before < done {
            return Read::Missing; // skipped, or its writer died in it
        }
        for (out, word) in out.iter_mut().zip(words) {
            *out = word.load(Ordering::Relaxed);
        }
        if G::READ_FENCE {
            A::fence(Ordering::Acquire);
        }
        if !G::RECHECK || stamp.load(Ordering::Relaxed) == before { Read::Ready } else { Read::Overwritten }
    }

    /// Reads the newest published tick; `now` is the caller's tick, for the age. At most two attempts: `None` if
    /// nothing is published, or if the writer went round the whole ring during each of them. Under a head whose tick is
    /// not there, spoilt by somebody, the ticks up to `now` are tried, [`BEHIND_SPOILT_HEAD`] of them.
    #[inline]
    pub fn latest(&self, now: u64, out: &mut [u64]) -> Option<Latest> {
        for _ in 0..2 {
            let tick = self.head().checked_sub(1)?;
            match self.read(tick, out) {
                Read::Ready => return Some(Latest { tick, age: now.saturating_sub(tick) }),
                Read::Missing => return self.latest_up_to(now, out),
                Read::NotYet | Read::Overwritten => {}
            }
        }
        None
    }

    #[cold]
    fn latest_up_to(&self, now: u64, out: &mut [u64]) -> Option<Latest> {
        let mut ticks = (now.saturating_sub(BEHIND_SPOILT_HEAD - 1)..=now).rev();
        let tick = ticks.find(|&tick| self.read(tick, out) == Read::Ready)?;
        Some(Latest { tick, age: now - tick })
    }
}

/// Ticks that [`Ring::latest`] tries behind a spoilt head: enough for what is a few ticks late, few enough for the 1 ms path.
const BEHIND_SPOILT_HEAD: u64 = 4;

/// Stamp of tick `n`, done.
#[inline]
fn done_stamp(n: u64) -> u64 {
    n.wrapping_mul(2).wrapping_add(2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spoilt_head_or_stamp_is_not_believed_by_a_successor_and_put_right_by_the_writer() {
        let memory = memory(2, 4);
        let ring: Ring<'_> = Ring::new(&memory, 2, 4);
        assert_eq!(ring.sound_head(), 0);
        (0..7).for_each(|n| ring.write(n, &[n, n]).unwrap());
        assert_eq!(ring.sound_head(), 7);
        for spoilt in [3, 8, 1 << 40, u64::MAX] {
            memory[0].store(spoilt, Ordering::Relaxed);
            assert_eq!(ring.sound_head(), 7, "head {spoilt}");
        }
        ring.write_from(7, 7, &[7, 7]).unwrap();
        assert_eq!((ring.head(), ring.read(7, &mut [0; 2])), (8, Read::Ready));
        assert!(ring.write_from(8, 7, &[7, 7]).is_err());
        // The newest tick's stamp spoilt, the head with it: the one before is the newest that is there.
        memory[1 + 3 * 3].store((1 << 50) + 4, Ordering::Relaxed);
        memory[0].store(1 << 50, Ordering::Relaxed);
        assert_eq!(ring.sound_head(), 7);
    }

    #[test]
    fn readers_find_the_ticks_under_a_head_that_is_spoilt() {
        let memory = memory(2, 4);
        let ring: Ring<'_> = Ring::new(&memory, 2, 4);
        (0..7).for_each(|n| ring.write(n, &[n, n + 10]).unwrap());
        let mut out = [0; 2];
        for spoilt in [12, 1 << 40, u64::MAX] {
            memory[0].store(spoilt, Ordering::Relaxed);
            assert!(ring.is_published(6), "head {spoilt}");
            assert!(!ring.is_published(7), "head {spoilt}: nobody may step on a tick that is not there");
            assert_eq!((ring.read(6, &mut out), out), (Read::Ready, [6, 16]), "head {spoilt}");
            assert_eq!(ring.read(2, &mut out), Read::Overwritten, "head {spoilt}");
            assert_ne!(ring.read(7, &mut out), Read::Ready, "head {spoilt}");
            for (now, found) in [(6, 6), (8, 6), (9, 6), (5, 5)] {
                let latest = ring.latest(now, &mut out);
                let expected = Some(Latest { tick: found, age: now - found });
                assert_eq!(latest, expected, "head {spoilt}, at tick {now}");
            }
            assert_eq!(ring.latest(10, &mut out), None, "head {spoilt}: too long ago");
        }
        // A head that is sound: who was lapped does not wait, wherever the writer skipped.
        ring.write_from(7, 7, &[0; 2]).unwrap();
        ring.write_from(8, 102, &[0; 2]).unwrap();
        assert!(
            ring.is_published(7) && ring.is_published(8) && ring.is_published(102) && !ring.is_published(103)
        );
    }

    fn memory(words: usize, depth: usize) -> Vec<AtomicU64> {
        (0..ring_words(words, depth)).map(|_| AtomicU64::new(0)).collect()
    }

    #[test]
    fn history_gaps_and_refusals() {
        let memory = memory(3, 4);
        let ring: Ring<'_> = Ring::new(&memory, 3, 4);
        let mut out = [0; 3];
        assert_eq!(ring.read(0, &mut out), Read::NotYet);
        assert_eq!(ring.latest(9, &mut out), None);
        for n in [0, 1, 3, 4] {
            ring.write(n, &[n, n + 10, n + 20]).unwrap();
        }
        assert_eq!(ring.head(), 5);
        assert_eq!(ring.read(0, &mut out), Read::Overwritten); // by tick 4
        assert_eq!(ring.read(1, &mut out), Read::Ready);
        assert_eq!(out, [1, 11, 21]);
        assert_eq!(ring.read(2, &mut out), Read::Missing);
        assert_eq!(ring.read(5, &mut out), Read::NotYet);
        assert_eq!(ring.latest(7, &mut out), Some(Latest { tick: 4, age: 3 }));
        assert_eq!(out, [4, 14, 24]);
        assert_eq!(ring.latest(2, &mut out), Some(Latest { tick: 4, age: 0 }));
        assert_eq!(ring.write(4, &[0; 3]), Err(Refused { tick: 4, head: 5 }));
        assert_eq!(ring.write(0, &[0; 3]), Err(Refused { tick: 0, head: 5 }));
        ring.write(100, &[100; 3]).unwrap();
        assert_eq!(ring.read(96, &mut out), Read::Overwritten);
        assert_eq!(ring.read(97, &mut out), Read::Missing); // its slot still holds tick 1
        assert_eq!(ring.read(1, &mut out), Read::Overwritten);
    }

    #[test]
    fn what_a_killed_writer_leaves_is_never_read() {
        let memory = memory(2, 2);
        let ring: Ring<'_> = Ring::new(&memory, 2, 2);
        let mut out = [0; 2];
        ring.write(0, &[7, 7]).unwrap();
        ring.write_interrupted(1, &[8]).unwrap();
        assert_eq!(ring.read(1, &mut out), Read::NotYet);
        assert_eq!(ring.latest(1, &mut out), Some(Latest { tick: 0, age: 1 }));
        ring.write(2, &[9, 9]).unwrap(); // its successor goes on with tick 2
        assert_eq!(ring.read(1, &mut out), Read::Missing);
        ring.write_unpublished(3, &[1, 1]).unwrap();
        assert_eq!(ring.read(3, &mut out), Read::NotYet);
        ring.write(3, &[2, 2]).unwrap(); // not published, so free
        assert_eq!(ring.read(3, &mut out), Read::Ready);
        assert_eq!(out, [2, 2]);
    }
}

//! The bell: one futex word a region, rung by its writer after publishing, waited on by any number of readers.
//!
//! Waiting on a read-only mapping works (`FUTEX_WAIT_BITSET` only reads the word). The futex is not process-private.
//! Deadlines are absolute `CLOCK_MONOTONIC` times, so a wait has a bound however often the bell rings.
//! No lost wake-up: the word is loaded before the condition is checked, and changes after the data are published.

use rustix::io::Errno;
use rustix::thread::futex;
use std::num::NonZeroU32;
use std::sync::atomic::{AtomicU32, Ordering, fence};

/// Now on `CLOCK_MONOTONIC`. \[ns\]
#[inline]
pub fn monotonic_ns() -> u64 {
    let t = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
    t.tv_sec as u64 * 1_000_000_000 + t.tv_nsec as u64
}

/// When to sleep, spin and give up, in a wait. Absolute times on `CLOCK_MONOTONIC`. \[ns\]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Wait {
    /// Sleep until then (or until the bell rings), if it is not past yet.
    pub spin_from_ns: u64,
    /// Then spin until then; nothing later than `spin_from_ns` = do not spin.
    pub spin_until_ns: u64,
    /// Then sleep on the bell until then, at the latest.
    pub deadline_ns: u64,
}

impl Wait {
    /// Sleeps on the bell, without spinning, until `deadline_ns`.
    pub fn until(deadline_ns: u64) -> Self {
        Wait { spin_from_ns: 0, spin_until_ns: 0, deadline_ns }
    }

    /// For data due at `due_ns`: sleeps to `lead_ns` before, spins to `tail_ns` after, then sleeps to `deadline_ns`.
    pub fn due(due_ns: u64, lead_ns: u64, tail_ns: u64, deadline_ns: u64) -> Self {
        Wait { spin_from_ns: due_ns.saturating_sub(lead_ns), spin_until_ns: due_ns + tail_ns, deadline_ns }
    }
}

/// A bell over its futex word.
#[derive(Debug, Clone, Copy)]
pub struct Bell<'a>(&'a AtomicU32);

impl<'a> Bell<'a> {
    /// Over a futex word.
    pub fn new(word: &'a AtomicU32) -> Self {
        Bell(word)
    }

    /// Wakes every waiter. One system call.
    #[inline]
    pub fn ring(&self) {
        // One writer: no read-modify-write needed, and none would be possible for anybody else.
        self.0.store(self.0.load(Ordering::Relaxed).wrapping_add(1), Ordering::Release);
        // Fails only for a bad address, which a live reference is not; waiters have their deadline in any case.
        let _ = futex::wake(self.0, futex::Flags::empty(), i32::MAX as u32);
    }

    /// How often the bell has rung, modulo 2^32.
    #[inline]
    pub fn count(&self) -> u32 {
        let count = self.0.load(Ordering::Relaxed);
        fence(Ordering::Acquire);
        count
    }

    /// Waits until `condition` holds, which the writer makes true before it rings. `false`: the deadline passed and
    /// the condition still does not hold. The condition is checked at least once, even past the deadline.
    pub fn wait(&self, wait: &Wait, mut condition: impl FnMut() -> bool) -> bool {
        // Arrived already? Checked first: a sleep here would lose the frame.
        if condition() {
            return true;
        }
        let spin_from_ns = wait.spin_from_ns.min(wait.deadline_ns);
        if monotonic_ns() < spin_from_ns && self.sleep(spin_from_ns, &mut condition) {
            return true;
        }
        let spin_until_ns = wait.spin_until_ns.min(wait.deadline_ns);
        while monotonic_ns() < spin_until_ns {
            // The clock costs tens of nanoseconds: look at the data several times in between.
            for _ in 0..8 {
                if condition() {
                    return true;
                }
                std::hint::spin_loop();
            }
        }
        self.sleep(wait.deadline_ns, &mut condition)
    }

    /// Sleeps on the futex until the condition holds or the time comes.
    fn sleep(&self, until_ns: u64, condition: &mut impl FnMut() -> bool) -> bool {
        let until = futex::Timespec {
            tv_sec: (until_ns / 1_000_000_000).min(i64::MAX as u64) as i64,
            tv_nsec: (until_ns % 1_000_000_000) as _,
        };
        loop {
            let count = self.count();
            if condition() {
                return true;
            }
            match futex::wait_bitset(self.0, futex::Flags::empty(), count, Some(&until), NonZeroU32::MAX) {
                Ok(()) | Err(Errno::AGAIN | Errno::INTR) => {}
                Err(Errno::TIMEDOUT) => return condition(),
                // Not on Linux as we know it; but then poll rather than burn the core.
                Err(_) => std::thread::sleep(std::time::Duration::from_micros(50)),
            }
            if monotonic_ns() >= until_ns {
                return condition();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::AtomicBool;

    #[test]
    fn a_wait_ends_at_its_deadline_and_sees_what_came_before() {
        let word = AtomicU32::new(u32::MAX);
        let bell = Bell::new(&word);
        let start = monotonic_ns();
        assert!(!bell.wait(&Wait::until(start + 2_000_000), || false));
        assert!(monotonic_ns() >= start + 2_000_000);
        assert!(!bell.wait(&Wait::due(start + 3_000_000, 500_000, 500_000, start + 4_000_000), || false));
        assert!(monotonic_ns() >= start + 4_000_000);
        assert!(bell.wait(&Wait::until(0), || true)); // deadline past, data there
        bell.ring();
        assert_eq!(bell.count(), 0); // wraps
    }

    #[test]
    fn no_wake_up_is_lost() {
        let (word, turn) = (AtomicU32::new(0), AtomicU32::new(0));
        let stop = AtomicBool::new(false);
        std::thread::scope(|scope| {
            for me in 0..2 {
                let (word, turn, stop) = (&word, &turn, &stop);
                // Two threads take turns by one bell (each rings only in its turn): a lost wake-up costs 10 s.
                scope.spawn(move || {
                    let bell = Bell::new(word);
                    for round in 0..5_000u32 {
                        let mine = 2 * round + me;
                        let wait = Wait::until(monotonic_ns() + 10_000_000_000);
                        let came = bell.wait(&wait, || {
                            stop.load(Ordering::Relaxed) || turn.load(Ordering::Acquire) == mine
                        });
                        if !came || stop.load(Ordering::Relaxed) {
                            stop.store(true, Ordering::Relaxed);
                            return;
                        }
                        turn.store(mine + 1, Ordering::Release);
                        bell.ring();
                    }
                });
            }
        });
        assert!(!stop.load(Ordering::Relaxed), "a wait passed its deadline");
        assert_eq!(turn.load(Ordering::Relaxed), 10_000);
    }
}

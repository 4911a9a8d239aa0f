//! The one clock: CLOCK_MONOTONIC in nanoseconds, and sleeping to an absolute time.
//!
//! Only the runtime and the services read it; models get their time as an argument. A sleep ends early by
//! `SPIN_NS` and spins the rest, because a timer wake-up costs tens of microseconds here and a short
//! bounded spin hides most of them without tripping real-time throttling.

use rustix::thread::ClockId;
use rustix::time::Timespec;
use std::sync::atomic::{AtomicI64, Ordering};

/// Nanoseconds of CLOCK_MONOTONIC.
pub type Nanos = u64;

/// Nanoseconds in a second.
pub const SECOND: Nanos = 1_000_000_000;

/// Now.
pub fn now() -> Nanos {
    let t = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
    t.tv_sec as u64 * SECOND + t.tv_nsec as u64
}

/// Steps of the wall clock that a fault campaign pretends. [ns]
static WALL_STEP_NS: AtomicI64 = AtomicI64::new(0);

/// Nanoseconds of the wall clock since 1970, for file names and log headers only.
pub fn wall_now() -> Nanos {
    let t = rustix::time::clock_gettime(rustix::time::ClockId::Realtime);
    let now = t.tv_sec.max(0) as u64 * SECOND + t.tv_nsec as u64;
    now.saturating_add_signed(WALL_STEP_NS.load(Ordering::Relaxed))
}

/// Makes this process's wall clock step, as a time server or an operator does. For fault campaigns.
pub fn step_wall(step_s: f64) {
    WALL_STEP_NS.fetch_add((step_s * SECOND as f64) as i64, Ordering::Relaxed);
}

/// Sleeps to the absolute time `until`, spinning the last `spin` nanoseconds. Returns at once when past.
pub fn sleep_until(until: Nanos, spin: Nanos) {
    let wake = until.saturating_sub(spin);
    while now() < wake {
        let request = Timespec { tv_sec: (wake / SECOND) as i64, tv_nsec: (wake % SECOND) as _ };
        // An interrupted sleep (a signal) is taken up again by the loop.
        let _ = rustix::thread::clock_nanosleep_absolute(ClockId::Monotonic, &request);
    }
    while now() < until {
        std::hint::spin_loop();
    }
}

/// The grid of ticks: tick n starts at t0 + n·T. A restart never moves it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Grid {
    /// Start of tick 0, CLOCK_MONOTONIC. [ns]
    pub t0: Nanos,
    /// Period. [ns]
    pub period: Nanos,
}

impl Grid {
    /// Start of tick `n`, or a fraction of the period into it.
    pub fn at(&self, n: u64, fraction: f64) -> Nanos {
        self.t0 + n * self.period + (fraction * self.period as f64) as u64
    }

    /// The tick that is running at `time`; 0 before the start.
    pub fn tick_at(&self, time: Nanos) -> u64 {
        time.saturating_sub(self.t0) / self.period
    }

    /// Seconds from the start of tick `n` to `time`, negative before it.
    pub fn since(&self, n: u64, time: Nanos) -> f64 {
        (time as i128 - self.at(n, 0.0) as i128) as f64 * 1e-9
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_grid_is_exact_after_a_day() {
        let grid = Grid { t0: 5 * SECOND, period: 250_000 };
        let n = 24 * 3600 * 4000;
        assert_eq!(grid.at(n, 0.0), 5 * SECOND + 24 * 3600 * SECOND);
        assert_eq!(grid.tick_at(grid.at(n, 0.0)), n);
        assert_eq!(grid.tick_at(grid.at(n, 0.0) - 1), n - 1);
        assert_eq!(grid.tick_at(0), 0);
    }

    #[test]
    fn a_sleep_never_ends_early() {
        for delay in [0, 50_000, 2_000_000] {
            let until = now() + delay;
            sleep_until(until, 30_000);
            assert!(now() >= until);
        }
        sleep_until(now() - SECOND, 0);
    }
}

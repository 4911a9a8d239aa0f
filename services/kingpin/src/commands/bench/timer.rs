//! Bare timer wake-ups, as `cyclictest` measures them: sleep to an absolute time, see how late it became.
//! Every period of the grid is one sample. Those overslept count, too, each with the time from its own start to
//! when the thread ran again: a stall of five periods is five late ones, else a stall would hide most of itself
//! ("coordinated omission" [Tene, How NOT to measure latency, 2015]).

use hdrhistogram::Histogram;
use runtime::clock::{self, Nanos};
use runtime::realtime::{self, Wish};

/// A distribution of times. [ns]
#[derive(Debug, Clone)]
pub struct Times {
    histogram: Histogram<u64>,
}

impl Default for Times {
    fn default() -> Self {
        // Three digits, to 1000 s.
        let histogram = Histogram::new_with_bounds(1, 1_000_000_000_000, 3);
        Times { histogram: histogram.unwrap_or_else(|_| unreachable!("valid bounds")) }
    }
}

impl Times {
    /// One more.
    pub fn record_ns(&mut self, ns: f64) {
        if ns.is_finite() {
            self.histogram.saturating_record(ns.max(0.0) as u64);
        }
    }

    /// A wake-up so late after its time, and the periods overslept before it.
    pub fn record_with_overslept_ns(&mut self, lateness_ns: f64, overslept: u64, period_ns: f64) {
        (0..=overslept).for_each(|back| self.record_ns(lateness_ns + back as f64 * period_ns));
    }

    /// All of another.
    pub fn add(&mut self, other: &Times) {
        // Same bounds: cannot fail.
        let _ = self.histogram.add(&other.histogram);
    }

    /// How many.
    pub fn len(&self) -> u64 {
        self.histogram.len()
    }

    /// Value that the fraction `quantile` of all does not exceed. [ns]
    pub fn quantile_ns(&self, quantile: f64) -> f64 {
        self.histogram.value_at_quantile(quantile) as f64
    }

    /// Fraction beyond a time, at the steps of the histogram: for a figure.
    pub fn tail(&self) -> (Vec<f64>, Vec<f64>) {
        let all = self.len().max(1) as f64;
        let mut above = self.len();
        let (mut time_us, mut fraction) = (Vec::new(), Vec::new());
        for step in self.histogram.iter_recorded() {
            above -= step.count_at_value();
            time_us.push((step.value_iterated_to() as f64 * 1e-3).max(0.01));
            fraction.push((above as f64 / all).max(0.5 / all));
        }
        (time_us, fraction)
    }
}

/// How to measure.
#[derive(Debug, Clone, Copy)]
pub struct Timer {
    /// Core to be pinned to.
    pub core: Option<usize>,
    /// SCHED_FIFO priority.
    pub priority: Option<i32>,
    /// Period. [ns]
    pub period_ns: Nanos,
    /// Wake up this much early and spin the rest. [ns]
    pub spin_ns: Nanos,
}

/// Lateness in so many periods, in a thread of its own.
pub fn measure(timer: Timer, count: usize) -> Times {
    let thread = std::thread::spawn(move || {
        let wish = Wish { core: timer.core, priority: timer.priority, lock_memory: false };
        realtime::apply(&wish);
        let mut times = Times::default();
        let mut next = clock::now() + timer.period_ns;
        while times.len() < count as u64 {
            clock::sleep_until(next, timer.spin_ns);
            let lateness = clock::now() - next;
            let overslept = (lateness / timer.period_ns).min(count as u64 - times.len() - 1);
            let since_last = lateness.saturating_sub(overslept * timer.period_ns);
            times.record_with_overslept_ns(since_last as f64, overslept, timer.period_ns as f64);
            next += (overslept + 1) * timer.period_ns;
        }
        times
    });
    thread.join().unwrap_or_default()
}

//! Benchmarks, each against a baseline in the same run. Here: what they share.
//!
//! Goals: distributions (p50, p99.9, max), the baseline measured in alternating blocks so that both see the same
//! machine load, and a ratio. Non-goals: absolute figures that hold on another machine, pass or fail by time.
//! Run with `cargo bench -p kingpin_benches --bench NAME`; under `cargo test` each runs small, so that none rots.

#![allow(clippy::print_stdout, reason = "printing is what benchmarks are for")]

use hdrhistogram::Histogram;
use std::time::{SystemTime, UNIX_EPOCH};

/// Whether this is a real run (`cargo bench`), not a smoke test (`cargo test`).
pub fn is_full_run() -> bool {
    std::env::args().any(|argument| argument == "--bench")
}

/// `full` in a real run, `small` in a smoke test.
pub fn sized<T>(full: T, small: T) -> T {
    if is_full_run() { full } else { small }
}

/// A distribution of durations.
#[derive(Debug, Clone)]
pub struct Durations {
    /// What was timed.
    pub name: String,
    /// In picoseconds, because batches of short operations are divided.
    histogram: Histogram<u64>,
}

impl Durations {
    /// None yet.
    pub fn new(name: &str) -> Self {
        // Three digits, to 1000 s.
        let histogram = Histogram::new_with_bounds(1, 1_000_000_000_000_000, 3).ok();
        Durations {
            name: name.to_owned(),
            histogram: histogram.unwrap_or_else(|| unreachable!("valid bounds")),
        }
    }

    /// One duration. \[ns\]
    pub fn record_ns(&mut self, ns: f64) {
        self.histogram.saturating_record((ns * 1000.0) as u64);
    }

    /// Value that the fraction `quantile` of all durations does not exceed. \[ns\]
    pub fn quantile_ns(&self, quantile: f64) -> f64 {
        self.histogram.value_at_quantile(quantile) as f64 / 1000.0
    }

    /// Longest. \[ns\]
    pub fn max_ns(&self) -> f64 {
        self.histogram.max() as f64 / 1000.0
    }

    /// How many.
    pub fn len(&self) -> u64 {
        self.histogram.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.histogram.is_empty()
    }
}

/// Prints p50, p99.9 and max of each row, and the ratios of its p50 and p99.9 to the baseline's. `rows`: a row and the
/// index of its baseline (its own index: it is one).
pub fn print_against_baselines(title: &str, rows: &[(&Durations, usize)]) {
    println!("\n{title}");
    println!(
        "  {:<34} {:>9} {:>11} {:>11} {:>11} {:>14}",
        "", "samples", "p50", "p99.9", "max", "p50, p99.9 vs."
    );
    for (i, (row, baseline)) in rows.iter().enumerate() {
        let base = rows[*baseline].0;
        let ratio = |q: f64| row.quantile_ns(q) / base.quantile_ns(q).max(1e-3);
        let against = if i == *baseline {
            "baseline".to_owned()
        } else {
            format!("{:.2}x {:.2}x", ratio(0.5), ratio(0.999))
        };
        println!(
            "  {:<34} {:>9} {:>11} {:>11} {:>11} {:>14}",
            row.name,
            row.len(),
            format_ns(row.quantile_ns(0.5)),
            format_ns(row.quantile_ns(0.999)),
            format_ns(row.max_ns()),
            against
        );
    }
}

/// A duration with a fitting unit.
pub fn format_ns(ns: f64) -> String {
    if ns < 1e3 {
        format!("{ns:.1} ns")
    } else if ns < 1e6 {
        format!("{:.2} us", ns / 1e3)
    } else {
        format!("{:.2} ms", ns / 1e6)
    }
}

/// One contender: its name, and what runs one block of it and records each duration.
pub type Contender<'a> = (&'a str, Box<dyn FnMut(&mut Durations) + 'a>);

/// Runs the contenders in alternating blocks, one warm-up round first (not counted), and returns their distributions
/// in the same order.
pub fn alternate(blocks: usize, contenders: &mut [Contender<'_>]) -> Vec<Durations> {
    let mut results: Vec<_> = contenders.iter().map(|(name, _)| Durations::new(name)).collect();
    for block in 0..=blocks {
        for ((name, run), result) in contenders.iter_mut().zip(&mut results) {
            if block == 0 {
                run(&mut Durations::new(name));
            } else {
                run(result);
            }
        }
    }
    results
}

/// Times `batches` batches of `batch` calls of `operation`, which gets a running number; records nanoseconds a call.
pub fn time_batches(out: &mut Durations, batches: usize, batch: usize, mut operation: impl FnMut(usize)) {
    for i in 0..batches {
        let start = table::monotonic_ns();
        for k in 0..batch {
            operation(i * batch + k);
        }
        out.record_ns((table::monotonic_ns() - start) as f64 / batch as f64);
    }
}

/// Pins the calling thread to one core, if there is such a core and it is allowed.
pub fn pin_to_core(core: usize) -> bool {
    let mut set = rustix::thread::CpuSet::new();
    set.set(core);
    rustix::thread::sched_setaffinity(None, &set).is_ok()
}

/// Cores, load and kernel, for the head of a result.
pub fn print_machine() {
    let read = |path: &str| std::fs::read_to_string(path).unwrap_or_default().trim().to_owned();
    let load: Vec<_> = read("/proc/loadavg").split(' ').take(2).map(str::to_owned).collect();
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let time = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |t| t.as_secs());
    println!(
        "machine: {cores} cores, load {}, Linux {}, unix time {time}{}",
        load.join(" "),
        read("/proc/sys/kernel/osrelease"),
        if is_full_run() { "" } else { " (small run: figures mean little)" }
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_of_a_known_distribution() {
        let mut durations = Durations::new("x");
        (1..=1000).for_each(|ns| durations.record_ns(f64::from(ns)));
        assert!((durations.quantile_ns(0.5) - 500.0).abs() < 1.0);
        assert!((durations.quantile_ns(0.999) - 999.0).abs() < 1.0);
        assert!((durations.max_ns() - 1000.0).abs() < 1.0);
        assert_eq!(durations.len(), 1000);
    }

    #[test]
    fn blocks_alternate_and_the_warm_up_does_not_count() {
        let order = std::cell::RefCell::new(String::new());
        let mut contenders: [Contender<'_>; 2] = [
            (
                "a",
                Box::new(|out| {
                    order.borrow_mut().push('a');
                    out.record_ns(1.0);
                }),
            ),
            ("b", Box::new(|_| order.borrow_mut().push('b'))),
        ];
        let results = alternate(2, &mut contenders);
        assert_eq!((results[0].len(), results[1].len()), (2, 0));
        drop(contenders);
        assert_eq!(order.into_inner(), "ababab");
    }
}

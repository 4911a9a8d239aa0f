//! What is asked of the bench at which tick: arm, start, stop, end. A pure function of the tick, so that
//! lockstep runs are equal however they are driven.

use regions::{Bench, NO_TICK, Payload};

/// Requests of [`Bench::request`].
pub mod request {
    /// Nothing yet.
    pub const NONE: u64 = 0;
    /// Get ready.
    pub const ARM: u64 = 1;
    /// Fade in and run.
    pub const START: u64 = 2;
    /// Fade out and stop.
    pub const STOP: u64 = 3;
    /// Acknowledge a trip.
    pub const ACKNOWLEDGE: u64 = 4;
    /// Off.
    pub const OFF: u64 = 5;
}

/// When what is asked for. All in ticks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RunPlan {
    /// Arm at.
    pub arm: u64,
    /// Start at.
    pub start: u64,
    /// Stop at.
    pub stop: u64,
    /// First tick that is no longer part of the run.
    pub end: u64,
    tail: u64,
}

impl RunPlan {
    /// A run of `ticks` ticks of `period_s`, then the soft stop of `stop_fade_s`.
    pub fn new(ticks: u64, period_s: f64, stop_fade_s: f64) -> Self {
        let ticks_in = |seconds: f64| (seconds / period_s).round() as u64;
        let tail = ticks_in(stop_fade_s + 0.1);
        RunPlan { arm: ticks_in(0.05), start: ticks_in(0.1), stop: ticks, end: ticks + tail, tail }
    }

    /// A run that waits for its operator: nothing is asked for until [`RunPlan::run_from`].
    pub fn operated(mut self) -> Self {
        (self.arm, self.start) = (u64::MAX, u64::MAX);
        self.never_stop();
        self
    }

    /// The operator started at `n`: the run stops by itself `ticks` later.
    pub fn run_from(&mut self, n: u64, ticks: u64) {
        self.stop = n + ticks;
        self.end = self.stop + self.tail;
    }

    /// The operator stopped, or the bench tripped: it goes on until somebody ends it.
    pub fn never_stop(&mut self) {
        (self.stop, self.end) = (u64::MAX, u64::MAX);
    }

    /// Ends the run early: stop at `n`, end when the soft stop is over.
    pub fn stop_at(&mut self, n: u64) {
        if n < self.stop {
            self.stop = n;
            self.end = n + self.tail;
        }
    }

    /// What the bench region says at tick `n`, but for the state of the services.
    pub fn at(&self, n: u64) -> Bench {
        let mut bench = Bench::absent();
        bench.tick = n;
        bench.end_tick = if n >= self.stop { self.end } else { NO_TICK };
        bench.manoeuvre_start_tick = 0;
        let asked = [(self.arm, request::ARM), (self.start, request::START), (self.stop, request::STOP)];
        for (when, what) in asked {
            if n >= when {
                bench.request = what;
                bench.request_count += 1;
            }
        }
        bench.alive = [1; 4];
        bench
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn requests_come_in_order_and_the_end_is_known_from_the_stop_on() {
        let mut plan = RunPlan::new(1000, 1e-3, 0.5);
        let requests: Vec<_> = (0..plan.end).map(|n| plan.at(n).request).collect();
        assert!(requests.is_sorted());
        assert_eq!(plan.at(0).request, request::NONE);
        assert_eq!((plan.at(999).end_tick, plan.at(1000).end_tick), (NO_TICK, 1600));
        plan.stop_at(300);
        assert_eq!((plan.at(300).request, plan.at(300).end_tick), (request::STOP, 900));
        plan.stop_at(800);
        assert_eq!(plan.end, 900, "a second stop does not put the end off");
    }
}

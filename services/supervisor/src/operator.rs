//! Who presses the buttons: the plan's arm, start and stop, and, where that is asked for, the hand that
//! acknowledges, arms and starts again after the rig itself was restarted or tripped.
//!
//! Real hardware waits for a person. The automatic hand is for unattended runs of the virtual rig only.

use assembly::plan::{RunPlan, request};
use regions::{Bench, RigStatus};

/// Time between two attempts. [s]
const RETRY_S: f64 = 0.05;

const IDLE: u64 = 1;
const ARMED: u64 = 2;
const RUNNING: u64 = 4;
const TRIPPED: u64 = 8;

/// The buttons of a bench, tick by tick.
#[derive(Debug, Clone)]
pub struct Operator {
    /// What is planned.
    pub plan: RunPlan,
    rearm: bool,
    planned: u64,
    request: u64,
    count: u64,
    ran: bool,
    asked_at: u64,
    retry_ticks: u64,
}

impl Operator {
    /// At the beginning of a run. `rearm`: also after a restart or a trip of the rig.
    pub fn new(plan: RunPlan, period_s: f64, rearm: bool) -> Self {
        Operator {
            plan,
            rearm,
            planned: request::NONE,
            request: request::NONE,
            count: 0,
            ran: false,
            asked_at: 0,
            retry_ticks: (RETRY_S / period_s).round().max(1.0) as u64,
        }
    }

    /// In the middle of a run, after the last word of an earlier supervisor.
    pub fn resume(&mut self, last: &Bench) {
        (self.request, self.count) = (last.request, last.request_count);
        self.ran = true;
        // Nothing is planned for an operated run.
        let planned = if self.plan.start == u64::MAX { request::NONE } else { request::START };
        self.planned = if last.request == request::STOP { request::STOP } else { planned };
        if last.end_tick != regions::NO_TICK {
            self.plan.stop = self.plan.stop.min(last.tick);
            self.plan.end = last.end_tick;
        }
    }

    /// What the bench region says at tick `n`, but for the state of the services; `status` is the rig's last word.
    pub fn step(&mut self, n: u64, status: &RigStatus) -> Bench {
        let mut bench = self.plan.at(n);
        if bench.request > self.planned {
            self.planned = bench.request;
            self.ask(bench.request, n);
        }
        self.ran |= status.state == RUNNING;
        let wanted = self.planned == request::START && (self.rearm || !self.ran);
        if wanted && n >= self.asked_at + self.retry_ticks {
            match status.state {
                IDLE => self.ask(request::ARM, n),
                ARMED => self.ask(request::START, n),
                TRIPPED if self.rearm && status.force_fade_ratio == 0.0 => self.ask(request::ACKNOWLEDGE, n),
                _ => {}
            }
        }
        (bench.request, bench.request_count) = (self.request, self.count);
        bench
    }

    fn ask(&mut self, request: u64, n: u64) {
        self.request = request;
        self.count += 1;
        self.asked_at = n;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use regions::Payload;

    fn status(state: u64) -> RigStatus {
        RigStatus { state, force_fade_ratio: 0.0, ..RigStatus::absent() }
    }

    #[test]
    fn without_mishaps_it_is_the_plan() {
        let plan = RunPlan::new(1000, 1e-3, 0.5);
        let mut operator = Operator::new(plan, 1e-3, true);
        for n in 0..plan.end {
            let state = if n > 120 { RUNNING } else { 3 };
            assert_eq!(operator.step(n, &status(state)), plan.at(n), "tick {n}");
        }
    }

    #[test]
    fn a_rig_that_comes_back_idle_is_armed_and_started_again_if_wished() {
        for rearm in [false, true] {
            let mut operator = Operator::new(RunPlan::new(10_000, 1e-3, 0.5), 1e-3, rearm);
            for n in 0..500 {
                operator.step(n, &status(RUNNING));
            }
            let asked = |bench: Bench| (bench.request, bench.request_count);
            assert_eq!(asked(operator.step(500, &status(RUNNING))), (request::START, 2));
            let expected = if rearm { (request::ARM, 3) } else { (request::START, 2) };
            assert_eq!(asked(operator.step(501, &status(IDLE))), expected);
            let expected = if rearm { (request::START, 4) } else { (request::START, 2) };
            assert_eq!(asked(operator.step(551, &status(ARMED))), expected);
            let expected = if rearm { (request::ACKNOWLEDGE, 5) } else { (request::START, 2) };
            assert_eq!(asked(operator.step(700, &status(TRIPPED))), expected);
        }
    }
}

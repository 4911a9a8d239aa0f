//! Faults in lockstep: the schedule becomes a plan by tick, and the run is made twice: the same seed must give
//! the same log, bit for bit.

use super::round::{Made, Round};
use super::schedule::{Injection, fault_ticks, order};
use assembly::ServiceKind;
use config::ResolvedBench;
use config::campaign::{FaultKind, Target};
use std::path::Path;
use std::sync::atomic::AtomicBool;
use supervisor::fault::{Action, PlannedFault};
use supervisor::{Mode, Observer, Run};

/// Behind a fault of which the bench holds, until it runs again: 10 fresh ticks, 0.2 s resuming. [s]
const HOLD_S: f64 = 0.4;
/// Behind a restart of the rig or a trip: the ramp, acknowledging, arming, a second of fading in. [s]
const RESTART_S: f64 = 1.6;
/// Before the first fault. [s]
const LEAD_S: f64 = 2.0;

/// The faults by tick, and how long the run must be. [s]
pub fn plan(injections: &[Injection], resolved: &ResolvedBench) -> (Vec<PlannedFault>, Vec<Made>, f64) {
    let timing = &resolved.scenario.timing;
    let period_s = timing.period_s();
    let in_ticks = |seconds: f64| (seconds / period_s).round() as u64;
    let mut tick = in_ticks(LEAD_S);
    let (mut plan, mut all) = (Vec::new(), Vec::new());
    for injection in injections {
        tick += in_ticks(injection.settle_s);
        let ticks = fault_ticks(&injection.kind, period_s);
        let target = match injection.target {
            Target::Vehicle => ServiceKind::Vehicle,
            Target::Multibody => ServiceKind::Multibody,
            _ => ServiceKind::Rig,
        };
        let action =
            match &injection.kind {
                FaultKind::Kill { .. } => Some(Action::Kill { away_ticks: ticks }),
                FaultKind::Stop { .. } => Some(Action::Stop { away_ticks: ticks }),
                FaultKind::TornWrite { .. } => Some(Action::TornWrite { away_ticks: ticks }),
                FaultKind::Late { .. } => Some(Action::Late { ticks }),
                FaultKind::Can { .. } => injection.can.map(|(value, _)| Action::Can { ticks, value }),
                _ => order(injection, period_s, timing.output_phase)
                    .map(|(kind, ticks, value)| Action::Order { kind, ticks, value }),
            };
        let Some(action) = action else {
            all.push(Made::skipped(injection.clone(), "this bench has no CAN service"));
            continue;
        };
        plan.push(PlannedFault { tick, target, action });
        let mut made = Made::skipped(injection.clone(), "");
        made.skipped = None;
        made.tick = tick;
        made.at_ns = tick * timing.period_ns();
        let restart = target == ServiceKind::Rig || matches!(injection.kind, FaultKind::Sensor { .. });
        let back = tick + ticks;
        made.back_ns = Some(back * timing.period_ns());
        tick = back + in_ticks(if restart { RESTART_S } else { HOLD_S });
        // Whether it runs by then is seen in the log: see `running`.
        made.running_tick = Some(tick);
        all.push(made);
    }
    (plan, all, tick as f64 * period_s + 0.5)
}

/// Says of each fault whether the bench ran again in time, by the log's phases.
pub fn running(made: &mut [Made], phases: &[super::judge::Phase]) {
    for one in made {
        if let Some(tick) = one.running_tick {
            let row = phases.partition_point(|p| p.tick < tick);
            let fine = phases.get(row).is_some_and(|p| p.state == super::judge::RUNNING);
            one.running_tick = fine.then_some(tick);
        }
    }
}

/// Runs it. The round is not judged yet.
pub fn round(
    resolved: &ResolvedBench,
    bench: &table::Bench,
    directory: &Path,
    plan: &[PlannedFault],
    made: Vec<Made>,
    interrupt: &AtomicBool,
    observer: &mut dyn Observer,
) -> Round {
    let mut faults = Vec::new();
    let run = Run {
        bench: bench.clone(),
        resolved: resolved.clone(),
        directory: directory.to_owned(),
        mode: Mode::LockstepProcess,
        restart_delay_ns: 0,
        rearm: true,
        faults: true,
        fault_plan: plan.to_vec(),
        operated: false,
        versions: super::super::run::versions(),
    };
    match std::fs::create_dir_all(directory) {
        Ok(()) => {
            if let Err(error) = supervisor::run(&run, interrupt, observer) {
                faults.push(error.to_string());
            }
        }
        Err(error) => faults.push(format!("{}: {error}", directory.display())),
    }
    Round { directory: directory.to_owned(), made, seen: None, faults }
}

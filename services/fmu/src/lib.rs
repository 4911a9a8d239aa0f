//! The FMU service: one of the scenario's FMUs in a process of its own.
//!
//! An FMU is foreign code: what it breaks is this process only. A step that never comes back is ended by a watchdog
//! thread, which ends the process; the supervisor starts it again, and the FMU begins anew at the tick that is running.
//! In real time it follows the vehicle: it steps when `vehicle_state` is there, and the vehicle takes what it put out
//! in the next tick, there or not.

use assembly::manifest::{Drive, Manifest};
use assembly::service::{EndWatch, ServiceError, open_table, wait_for_start};
use assembly::{FmuFault, FmuNode, fmu_model};
use fmu::{Cost, FmuError, Runner, Stepper};
use runtime::clock::{self, Grid, Nanos, SECOND};
use runtime::lockstep::{self, Patience};
use runtime::paced;
use runtime::realtime::{self, Wish};
use runtime::{Bound, Model};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use table::Bench;

/// Steps on held inputs when the car's state of the tick is not there by then. [fraction of T]
const LATEST_START: f64 = 0.6;
/// How far its priority is below the rig's.
const BELOW_RIG: i32 = 3;

/// How an FMU service ended badly.
#[derive(Debug)]
pub enum FmuServiceError {
    /// As any service.
    Service(ServiceError),
    /// The FMU failed in the run.
    Failed(String),
}

impl std::fmt::Display for FmuServiceError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Service(error) => write!(f, "{error}"),
            Self::Failed(text) => f.write_str(text),
        }
    }
}

impl std::error::Error for FmuServiceError {}

/// Times the steps, and tells the watchdog when one began.
struct Watched {
    runner: Runner,
    since: Arc<AtomicU64>,
}

impl Stepper for Watched {
    fn step(
        &mut self,
        time_s: f64,
        step_s: f64,
        inputs: &[f64],
        outputs: &mut [f64],
    ) -> Result<Cost, FmuError> {
        let begin = clock::now();
        self.since.store(begin, Ordering::Release);
        let stepped = self.runner.step(time_s, step_s, inputs, outputs);
        self.since.store(0, Ordering::Release);
        let seconds = (clock::now() - begin) as f64 * 1e-9;
        stepped.map(|cost| Cost { seconds, ..cost })
    }
}

/// Ends the process when a step lasts longer than `hang_ns`.
fn watch_for_hanging(name: String, since: Arc<AtomicU64>, hang_ns: Nanos) {
    // A refused thread leaves the FMU unwatched; the bench still holds without it.
    let _ = std::thread::Builder::new().name("watchdog".into()).spawn(move || {
        loop {
            clock::sleep_until(clock::now() + hang_ns / 4, 0);
            let began = since.load(Ordering::Acquire);
            let lasted = clock::now().saturating_sub(began);
            if began != 0 && lasted > hang_ns {
                let ms = lasted / 1_000_000;
                // The process is about to end: standard error is the service's log.
                let _ = std::io::Write::write_all(
                    &mut std::io::stderr(),
                    format!("FMU {name}: a step did not come back for {ms} ms: its process is ended\n")
                        .as_bytes(),
                );
                std::process::exit(1);
            }
        }
    });
}

/// Runs FMU `index` of a bench to the end of the run. Notes of what the host refused go to `note`.
///
/// # Errors
/// [`FmuServiceError`].
pub fn run(bench: &Bench, index: usize, mut note: impl FnMut(&str)) -> Result<(), FmuServiceError> {
    let service = FmuServiceError::Service;
    let manifest = Manifest::read(&bench.directory()).map_err(|e| service(ServiceError::Manifest(e)))?;
    let resolved = &manifest.resolved;
    let scenario = &resolved.scenario;
    let Some(wanted) = scenario.fmu.iter().flatten().nth(index) else { return Ok(()) };
    let table = open_table(bench, &manifest).map_err(|e| service(ServiceError::Table(e)))?;
    let lock = manifest.drive == Drive::Lockstep;
    let priority = scenario.realtime.priority.map(|p| (i32::from(p) - BELOW_RIG).max(1));
    let wish = Wish {
        core: wanted.core.map(usize::from),
        priority: if lock { None } else { priority },
        lock_memory: false,
    };
    let mut refused = realtime::apply(&wish);
    // Started again in the run: the FMU begins at the tick that is running.
    let grid = |t0| Grid { t0, period: scenario.timing.period_ns() };
    let started = table.reader(regions::RegionId::Bench as usize).header().t0_ns();
    let first = if lock { 0 } else { started.map_or(0, |t0| grid(t0).tick_at(clock::now())) };
    let (part, runner) = fmu_model(resolved, index, &bench.directory(), !lock, first)
        .map_err(|e| service(ServiceError::Assembly(e)))?;
    let since = Arc::new(AtomicU64::new(0));
    let hang_ns = (wanted.hang_s * SECOND as f64) as Nanos;
    watch_for_hanging(wanted.name.clone(), Arc::clone(&since), hang_ns);
    let fault = FmuFault::default();
    let model: Box<dyn Model> =
        Box::new(FmuNode::new(part, Box::new(Watched { runner, since }), fault.clone()));
    let tick = |e| service(ServiceError::Tick(e));
    let mut bound: Bound<dyn Model> = Bound::new(model, &table, lock).map_err(tick)?;
    refused.extend(realtime::apply(&Wish {
        lock_memory: scenario.realtime.lock_memory && !lock,
        ..Wish::default()
    }));
    for line in refused {
        note(&line);
    }
    let t0 = wait_for_start(&table).map_err(tick)?;
    let mut watch = EndWatch::new(&table, scenario.timing.period_s());
    // What failed once is of no use any more: a new process, if the supervisor wants one.
    let mut end = |n: u64| watch.ended(n, manifest.drive) || fault.told().is_some();
    if lock {
        let limit_ns = (scenario.limits.lockstep_wait_max_s * SECOND as f64) as Nanos;
        lockstep::follow(&mut bound, 0, Patience { spin_ns: 0, limit_ns }, &mut end).map_err(tick)?;
    } else {
        let plan = paced::FollowPlan {
            latest_start: LATEST_START,
            done_by: wanted.budget_s / scenario.timing.period_s(),
            spin_lead_ns: 0,
            spin_tail_ns: 0,
            due: 0.1,
            used_at: 1.0,
            catch_up_max: u64::from(scenario.limits.catch_up_max_ticks),
        };
        let grid = grid(t0);
        let first = first.max(table.reader(regions::FMUS[index] as usize).head());
        let timing = regions::FMU_TIMINGS[index];
        paced::follow(&mut bound, &table, timing, grid, first, plan, &mut end).map_err(tick)?;
    }
    match fault.told() {
        Some(text) => Err(FmuServiceError::Failed(text)),
        None => Ok(()),
    }
}

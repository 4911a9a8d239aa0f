//! Lockstep in this process: the chain in one thread, the logger in another, a table in ordinary memory.

use crate::fault::{FaultChain, FaultError};
use crate::{Observer, Operator, Outcome, Run, RunError, Watchers};
use assembly::manifest::Drive;
use assembly::{ServiceKind, build, build_can};
use regions::{Payload, RegionId};
use runtime::lockstep::Chain;
use runtime::{Bound, clock, region_specs};
use std::sync::atomic::{AtomicBool, Ordering};
use table::{Table, TableInfo};

/// Ticks between two looks at the logger, the interrupt and the observer.
const LOOK: u64 = 256;

/// What steps the bench.
enum Driver<'a> {
    Plain(Chain),
    Faulty(Box<FaultChain<'a>>),
}

impl Driver<'_> {
    fn tick(&mut self, n: u64) -> Result<(), RunError> {
        match self {
            Driver::Plain(chain) => chain.tick(n).map_err(RunError::Tick),
            Driver::Faulty(chain) => chain.tick(n).map_err(of_fault),
        }
    }
}

fn of_fault(error: FaultError) -> RunError {
    match error {
        FaultError::Assembly(error) => RunError::Assembly(error),
        FaultError::Tick(error) => RunError::Tick(error),
    }
}

pub(crate) fn run(
    run: &Run,
    interrupt: &AtomicBool,
    observer: &mut dyn Observer,
) -> Result<Outcome, RunError> {
    let scenario = &run.resolved.scenario;
    let period_s = scenario.timing.period_s();
    let manifest = run.manifest(Drive::Lockstep);
    let info = TableInfo { run_id: manifest.run_id, period_ns: scenario.timing.period_ns(), t0_ns: 1 };
    let specs = region_specs(period_s);
    let table = Table::create_local(&specs, info).map_err(RunError::Table)?;

    let bind = |kind| -> Result<_, RunError> {
        let model = build(kind, &run.resolved).map_err(RunError::Assembly)?;
        Bound::new(model, &table, true).map_err(RunError::Tick)
    };
    let mut driver = if run.faults {
        let chain = FaultChain::new(&run.resolved, &table, &run.fault_plan).map_err(of_fault)?;
        Driver::Faulty(Box::new(chain))
    } else {
        let mut models =
            vec![bind(ServiceKind::Rig)?, bind(ServiceKind::Vehicle)?, bind(ServiceKind::Multibody)?];
        let mut order = vec![(0, 0), (1, 0), (2, 0), (0, 1)];
        if let Some(model) = build_can(&run.resolved, None, false).map_err(RunError::Assembly)? {
            models.push(Bound::new(model, &table, true).map_err(RunError::Tick)?);
            order.push((3, 0));
        }
        Driver::Plain(Chain::new(models, order))
    };
    let mut bench = table.claim_writer(RegionId::Bench as usize).map_err(RunError::Table)?;
    let schedule = params::Schedule::new(&run.resolved).map_err(RunError::Parameters)?;
    let mut parameters = table.claim_writer(RegionId::Parameters as usize).map_err(RunError::Table)?;
    let mut operator = Operator::new(run.plan(), period_s, run.rearm);
    let mut watchers = Watchers::new(&table);

    // A log that cannot be made at the beginning is told before anything runs.
    let mut first = Some(logger::create_log(&manifest, info.t0_ns).map_err(RunError::Log)?);
    let make = Box::new(move || match first.take() {
        Some(log) => Ok(log),
        None => logger::create_log(&manifest, info.t0_ns),
    });
    let mut log = logger::Logger::new(&table, make).map_err(RunError::Table)?;
    if run.resolved.can.is_some() {
        log.must_have(RegionId::Can);
    }
    let abandoned = AtomicBool::new(false);
    let credit = specs[RegionId::RigStatus as usize].depth as u64 / 2;

    let begin = clock::now();
    let (ran, interrupted) = std::thread::scope(|scope| {
        let thread = scope.spawn(|| logger::run(log, 100_000, || abandoned.load(Ordering::Relaxed)));
        let mut interrupted = false;
        let mut n = 0;
        let mut ran = Ok(());
        while n < operator.plan.end {
            if n.is_multiple_of(LOOK) {
                watchers.look();
                // The chain never laps the logger: what it could overwrite is at most half read.
                while n + LOOK > watchers.logged.read_tick + credit && !thread.is_finished() {
                    clock::sleep_until(clock::now() + 50_000, 0);
                    watchers.look();
                }
                observer.progress(n, operator.plan.end, &watchers.status);
                if interrupt.load(Ordering::Relaxed) && !interrupted {
                    interrupted = true;
                    operator.plan.stop_at(n);
                }
            }
            let words = if run.rearm {
                // By the rig's word on the tick before: the same in every run.
                watchers.look();
                operator.step(n, &watchers.status)
            } else {
                operator.plan.at(n)
            };
            // Sole writer of the region, in order: cannot be refused.
            let _ = bench.write(n, words.words());
            let _ = parameters.write(n, crate::live::at(&schedule, n).words());
            if let Err(error) = driver.tick(n) {
                ran = Err(error);
                abandoned.store(true, Ordering::Relaxed);
                break;
            }
            n += 1;
        }
        let finished = thread.join();
        if finished.is_err() {
            observer.note("the logger thread died: the log ends early");
        }
        (ran, interrupted)
    });
    ran?;
    watchers.look();
    Ok(Outcome {
        ticks: operator.plan.end,
        wall_s: (clock::now() - begin) as f64 * 1e-9,
        period_s,
        interrupted,
        last_status: watchers.status,
        restarts: [0; 4],
        given_up: None,
        logged: watchers.logged,
    })
}

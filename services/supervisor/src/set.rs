//! The process set, paced or in lockstep: table, services, watching, restarting, ending; and taking over a
//! bench whose supervisor died.

use crate::children::Change;
use crate::desk::Desk;
use crate::{Attach, Children, Observer, Operator, Outcome, Run, RunError, Watchers};
use assembly::manifest::{Drive, Manifest};
use regions::{ALL, Bench as BenchRegion, Payload, RegionId, Timing};
use runtime::clock::{self, Grid, Nanos, SECOND};
use runtime::realtime::{self, Wish};
use runtime::region_specs;
use std::sync::atomic::{AtomicBool, Ordering};
use table::{BenchLock, CreateOptions, RegionSpec, RegionWriter, Table, TableInfo};

/// Longest wait for the services to get ready. [ns]
const READY_MAX_NS: Nanos = 60 * SECOND;
/// Time between setting the start and tick 0. [ns]
const START_IN_NS: Nanos = 50_000_000;
/// Longest time between two looks of the supervisor; a death wakes it at once. [ns]
const LOOK_NS: Nanos = 5_000_000;
/// How far the supervisor's priority is below the rig's.
pub const BELOW_SERVICES: i32 = 10;
/// Longest wait for the services to end, behind the end of the run. [ns]
const END_MAX_NS: Nanos = 10 * SECOND;

/// Services of the FMUs, in the scenario's order.
const FMU_SERVICES: [&str; 4] = ["fmu_0", "fmu_1", "fmu_2", "fmu_3"];

/// Removes what a run keeps in memory and in the bench's directory, however the run ends.
struct Cleaner<'a> {
    lock: &'a BenchLock,
    children: Option<Children>,
}

impl Drop for Cleaner<'_> {
    fn drop(&mut self) {
        realtime::relax();
        if let Some(children) = &mut self.children {
            children.kill();
        }
        let _ = crate::remove_left_overs(self.lock);
    }
}

pub(crate) fn run(
    run: &Run,
    drive: Drive,
    interrupt: &AtomicBool,
    observer: &mut dyn Observer,
) -> Result<Outcome, RunError> {
    assembly::check_fmus(&run.resolved, drive == Drive::Paced).map_err(RunError::Assembly)?;
    let lock = run.bench.lock().map_err(RunError::Table)?;
    // Under the lock there is no other supervisor: what lies there is left over from a crash.
    clear_left_overs(&lock, observer)?;
    let scenario = &run.resolved.scenario;
    let period_s = scenario.timing.period_s();
    let period_ns = scenario.timing.period_ns();
    let manifest = run.manifest(drive);
    let specs = region_specs(period_s);
    let mut cleaner = Cleaner { lock: &lock, children: None };
    let info = TableInfo { run_id: manifest.run_id, period_ns, t0_ns: 0 };
    let table =
        Table::create_shared(&lock, &specs, info, &CreateOptions::default()).map_err(RunError::Table)?;
    manifest.write(&run.bench.directory()).map_err(RunError::Manifest)?;
    let mut bench = table.claim_writer(RegionId::Bench as usize).map_err(RunError::Table)?;

    if drive == Drive::Paced {
        raise(run);
    }
    let executable = std::env::current_exe().map_err(|e| RunError::Io("kingpin".into(), e))?;
    let output = run.directory.join("services.txt");
    let fmus = run.resolved.fmus.len().min(FMU_SERVICES.len());
    let can: &[&'static str] = if run.resolved.can.is_some() { &["can"] } else { &[] };
    let optional = [can, &FMU_SERVICES[..fmus]].concat();
    let children =
        Children::start(executable, run.bench.name().as_str(), &output, run.restart_delay_ns, &optional)
            .map_err(|e| RunError::Io(output.clone(), e))?;
    let children = cleaner.children.insert(children);
    wait_until_ready(&table, children, drive, &output, interrupt, &FMU_SERVICES[..fmus])?;
    for line in said(&output).lines() {
        observer.note(line);
    }

    let mut plan = run.plan();
    if run.operated && drive == Drive::Paced {
        plan = plan.operated();
    }
    let mut operator = Operator::new(plan, period_s, run.rearm);
    let mut watchers = Watchers::new(&table);
    let begin = clock::now();
    let headers = Headers { table: &table, specs: &specs };
    let rearm = run.rearm;
    let mut supervision =
        Supervision { operator: &mut operator, bench: &mut bench, headers, rearm, observer, interrupt };
    let (interrupted, given_up) = match drive {
        Drive::Paced => {
            let mut note = |line: &str| supervision.observer.note(line);
            let mut desk = Desk::new(&table, &run.bench, &run.resolved, run.operated, &mut note)?;
            desk.publish(0);
            supervision.publish(0, children, &watchers, &desk);
            let t0 = clock::now() + START_IN_NS;
            table.set_t0(t0).map_err(RunError::Table)?;
            let grid = Grid { t0, period: period_ns };
            supervision.paced(children, &mut watchers, grid, manifest.run_id, &mut desk)
        }
        Drive::Lockstep => {
            let schedule = params::Schedule::new(&run.resolved).map_err(RunError::Parameters)?;
            let parameters = table.claim_writer(RegionId::Parameters as usize).map_err(RunError::Table)?;
            table.set_t0(1).map_err(RunError::Table)?;
            let credit = specs[RegionId::RigStatus as usize].depth as u64 / 2;
            supervision.lockstep(children, &mut watchers, credit, &schedule, parameters)
        }
    };
    let outcome = (interrupted, given_up, begin);
    Ok(end(children, &mut watchers, observer, period_s, outcome))
}

/// Below the services, so that it never delays them, but above everything else: a dead service is to be there again
/// soon on a busy host too. Processes inherit it; services then take their own priority, the logger none.
fn raise(run: &Run) {
    let wanted = run.resolved.scenario.realtime.priority;
    let priority = wanted.map(|p| (i32::from(p) - BELOW_SERVICES).max(1));
    // What the host refuses the services say themselves.
    let _ = realtime::apply(&Wish { priority, ..Wish::default() });
}

/// Removes what a crashed run left, after its last seconds are saved beside its log.
fn clear_left_overs(lock: &BenchLock, observer: &mut dyn Observer) -> Result<(), RunError> {
    if !table::list_bench(lock.bench()).map_err(RunError::Table)?.is_empty() {
        // Whoever still writes there is asked first: a live bench's blackbox is not ours to save.
        match table::writers_alive(lock.bench()).map_err(RunError::Table)? {
            Some((region, pid)) => return Err(RunError::StillRunning { region, pid }),
            None => observer.note(&crate::save_before_cleaning(lock)),
        }
    }
    let left = crate::remove_left_overs(lock).map_err(RunError::Table)?;
    if left > 0 {
        observer.note(&format!("removed {left} segments left over from an earlier run of this bench"));
    }
    Ok(())
}

/// Takes over a running bench whose supervisor died, and sees it to its end.
pub(crate) fn attach(
    attach: &Attach,
    interrupt: &AtomicBool,
    observer: &mut dyn Observer,
) -> Result<(Run, Outcome), RunError> {
    let lock = attach.bench.lock().map_err(RunError::Table)?;
    let no_run = |why: String| RunError::NothingToAttach { bench: attach.bench.name().to_string(), why };
    let manifest =
        Manifest::read(&attach.bench.directory()).map_err(|e| no_run(format!("it has no manifest ({e})")))?;
    if manifest.drive == Drive::Lockstep {
        return Err(no_run("a lockstep run ends with its supervisor".to_owned()));
    }
    let scenario = &manifest.resolved.scenario;
    let period_s = scenario.timing.period_s();
    let table = Table::adopt(&lock, &region_specs(period_s)).map_err(RunError::Table)?;
    let t0 = table.info().map_or(0, |info| info.t0_ns);
    let alive =
        |id: RegionId| table.reader(id as usize).header().writer().filter(|&writer| table::is_alive(writer));
    let running =
        [RegionId::RigMeasurement, RegionId::VehicleState, RegionId::SuspensionState, RegionId::LoggerStatus]
            .map(alive);
    let can = manifest.resolved.can.is_some().then_some(("can", RegionId::Can));
    let fmus = FMU_SERVICES.into_iter().zip(regions::FMUS).take(manifest.resolved.fmus.len());
    let optional: Vec<_> = can.into_iter().chain(fmus).map(|(service, id)| (service, alive(id))).collect();
    if t0 == 0 || running.iter().all(Option::is_none) {
        return Err(no_run(format!(
            "none of its services runs any more; `kingpin blackbox --name {0}` saves its last seconds, \
             `kingpin clean --name {0}` removes what it left",
            attach.bench.name()
        )));
    }
    let mut bench = table.claim_writer(RegionId::Bench as usize).map_err(RunError::Table)?;
    let mut last = BenchRegion::absent();
    let spoken = bench.reader().latest(bench.head(), last.words_mut());
    let run = Run::of_manifest(attach, &manifest);
    raise(&run);
    let grid = Grid { t0, period: scenario.timing.period_ns() };
    let mut plan = run.plan();
    // Only an operated run's manoeuvre begins at another tick than the first.
    let operated = spoken.is_some() && last.manoeuvre_start_tick != 0;
    if operated {
        plan = plan.operated();
        if last.manoeuvre_start_tick != regions::NO_TICK {
            plan.run_from(last.manoeuvre_start_tick, scenario.ticks());
        }
    }
    let mut operator = Operator::new(plan, period_s, attach.rearm);
    if spoken.is_some() {
        operator.resume(&last);
    }
    let executable = std::env::current_exe().map_err(|e| RunError::Io("kingpin".into(), e))?;
    let output = run.directory.join("services.txt");
    let children = Children::adopt(
        executable,
        attach.bench.name().as_str(),
        &output,
        attach.restart_delay_ns,
        running,
        if spoken.is_some() { last.restarts } else { [0; 4] },
        &optional,
    );
    let now = grid.tick_at(clock::now());
    let alone_s = now.saturating_sub(last.tick) as f64 * period_s;
    let adopted: Vec<_> = crate::SERVICES.iter().zip(running).filter_map(|(s, r)| r.map(|_| *s)).collect();
    observer.note(&format!(
        "took over bench {} at tick {now}: {} running, {alone_s:.2} s without a supervisor",
        attach.bench.name(),
        adopted.join(", ")
    ));
    let mut cleaner = Cleaner { lock: &lock, children: None };
    let children = cleaner.children.insert(children);
    let mut watchers = Watchers::new(&table);
    let begin = clock::now();
    let rearm = attach.rearm;
    let specs = region_specs(period_s);
    let headers = Headers { table: &table, specs: &specs };
    let mut supervision =
        Supervision { operator: &mut operator, bench: &mut bench, headers, rearm, observer, interrupt };
    operator_link::remove_left_over(&lock);
    let mut note = |line: &str| supervision.observer.note(line);
    let mut desk = Desk::new(&table, &attach.bench, &manifest.resolved, operated, &mut note)?;
    let (interrupted, given_up) =
        supervision.paced(children, &mut watchers, grid, manifest.run_id, &mut desk);
    let outcome = end(children, &mut watchers, observer, period_s, (interrupted, given_up, begin));
    Ok((run, outcome))
}

/// The services end by themselves: they know the end. The logger is last.
fn end(
    children: &mut Children,
    watchers: &mut Watchers,
    observer: &mut dyn Observer,
    period_s: f64,
    (interrupted, given_up, begin): (bool, Option<String>, Nanos),
) -> Outcome {
    let limit = clock::now() + END_MAX_NS;
    while !children.all_ended() && given_up.is_none() && clock::now() < limit {
        for change in children.watch(true) {
            observer.note(&change.to_string());
        }
        children.wait(LOOK_NS);
    }
    let wall_s = (clock::now() - begin) as f64 * 1e-9;
    watchers.look();
    Outcome {
        ticks: watchers.rig.head(),
        wall_s,
        period_s,
        interrupted,
        last_status: watchers.status,
        restarts: children.restarts(),
        given_up,
        logged: watchers.logged,
    }
}

/// What the services said so far.
fn said(output: &std::path::Path) -> String {
    std::fs::read(output).map(|bytes| String::from_utf8_lossy(&bytes).into_owned()).unwrap_or_default()
}

/// Waits until every region of the services has a writer: they claim last, when they are ready.
fn wait_until_ready(
    table: &Table,
    children: &mut Children,
    drive: Drive,
    output: &std::path::Path,
    interrupt: &AtomicBool,
    further: &[&'static str],
) -> Result<(), RunError> {
    let limit = clock::now() + READY_MAX_NS;
    loop {
        // Timing regions are claimed by paced services after the start; the logger claims its own after it too.
        let unclaimed: Vec<_> = ALL
            .iter()
            .map(|&id| (id, id.region()))
            .filter(|(id, region)| {
                (crate::SERVICES.contains(&region.writer) || further.contains(&region.writer))
                    && region.layout.name != Timing::LAYOUT.name
                    && *id != RegionId::LoggerStatus
            })
            .filter(|(id, _)| table.reader(*id as usize).header().writer().is_none())
            .map(|(_, region)| region.name)
            .collect();
        if unclaimed.is_empty() {
            return Ok(());
        }
        if let Some((service, how, _)) = children.early_death() {
            return Err(RunError::ServiceEnded { service, how, said: said(output) });
        }
        if clock::now() > limit || (interrupt.load(Ordering::Relaxed) && drive == Drive::Paced) {
            return Err(RunError::NotReady { unclaimed });
        }
        children.wait(2_000_000);
    }
}

/// The headers of the table, which only the supervisor may write.
struct Headers<'a> {
    table: &'a Table,
    specs: &'a [RegionSpec],
}

impl Headers<'_> {
    /// Puts right what somebody has spoilt; says which.
    fn look(&self, run_id: u64, grid: Grid, observer: &mut dyn Observer) {
        let info = TableInfo { run_id, period_ns: grid.period, t0_ns: grid.t0 };
        for region in self.table.repair(self.specs, &info).unwrap_or_default() {
            observer.note(&format!("the header of region {region} was spoilt from outside and is put right"));
        }
    }
}

struct Supervision<'a> {
    operator: &'a mut Operator,
    bench: &'a mut RegionWriter,
    headers: Headers<'a>,
    rearm: bool,
    observer: &'a mut dyn Observer,
    interrupt: &'a AtomicBool,
}

impl Supervision<'_> {
    fn publish(&mut self, n: u64, children: &Children, watchers: &Watchers, desk: &Desk) {
        if n >= self.bench.head() {
            let mut words = self.operator.step(n, &watchers.status);
            desk.dress(&mut words);
            words.alive = children.alive();
            words.restarts = children.restarts();
            // Sole writer, and `n` is not yet published.
            let _ = self.bench.write(n, words.words());
        }
    }

    /// One look at the services at tick `n`. Returns the verdict if one was given up.
    fn watch(&mut self, n: u64, children: &mut Children) -> Option<String> {
        let mut verdict = None;
        // Vehicle and multibody are done with the last tick before it is over: who ends in order then has seen the end.
        let ending = n + 1 >= self.operator.plan.end;
        for change in children.watch(ending) {
            let line = change.to_string();
            self.observer.note(&line);
            if matches!(change, Change::GivenUp { .. }) {
                verdict = Some(line);
            }
        }
        verdict
    }

    fn paced(
        &mut self,
        children: &mut Children,
        watchers: &mut Watchers,
        grid: Grid,
        run_id: u64,
        desk: &mut Desk,
    ) -> (bool, Option<String>) {
        let (mut interrupted, mut given_up) = (false, None);
        loop {
            children.wait(LOOK_NS);
            let n = grid.tick_at(clock::now());
            if n >= self.operator.plan.end {
                // The last word on the end must be there for whoever restarts now.
                let end = self.operator.plan.end.max(self.bench.head());
                self.publish(end, children, watchers, desk);
                return (interrupted, given_up);
            }
            if given_up.is_none() {
                given_up = self.watch(n, children);
                if given_up.is_some() {
                    self.operator.plan.stop_at(n);
                }
            }
            watchers.look();
            self.headers.look(run_id, grid, self.observer);
            if self.interrupt.load(Ordering::Relaxed) && !interrupted {
                interrupted = true;
                self.operator.plan.stop_at(n);
            }
            if watchers.status.state == TRIPPED && !self.rearm && !desk.operated() {
                // Latched: nothing more to be had from this run but the record of how it got there.
                self.operator.plan.stop_at(n);
            }
            let mut note = |line: &str| self.observer.note(line);
            desk.look(n, clock::now(), watchers.status.state, &mut self.operator.plan, &mut note);
            self.publish(n, children, watchers, desk);
            // Without an end in sight the bar is always full.
            let end = if self.operator.plan.end == u64::MAX { n } else { self.operator.plan.end };
            self.observer.progress(n, end, &watchers.status);
        }
    }

    fn lockstep(
        &mut self,
        children: &mut Children,
        watchers: &mut Watchers,
        credit: u64,
        schedule: &params::Schedule,
        mut parameters: RegionWriter,
    ) -> (bool, Option<String>) {
        let mut interrupted = false;
        loop {
            watchers.look();
            let n = self.bench.head();
            if self.interrupt.load(Ordering::Relaxed) && !interrupted {
                interrupted = true;
                self.operator.plan.stop_at(n);
            }
            let until = (watchers.logged.read_tick + credit).min(self.operator.plan.end);
            for tick in n..until {
                // By the plan alone: what the rig said when this was written would depend on scheduling.
                let mut words = self.operator.plan.at(tick);
                words.alive = children.alive();
                let _ = self.bench.write(tick, words.words());
                let _ = parameters.write(tick, crate::live::at(schedule, tick).words());
            }
            if until > n {
                self.bench.ring();
                parameters.ring();
            }
            let end = self.operator.plan.end;
            self.observer.progress(watchers.rig.head(), end, &watchers.status);
            if watchers.rig.head() >= end {
                return (interrupted, None);
            }
            // In lockstep a death ends the run: a restart would make it depend on when it happened.
            if let Some((service, how, clean)) = children.early_death()
                && watchers.rig.head() < end
                && !(clean && n >= end)
            {
                let line = format!("service {service} died ({how}): a lockstep run cannot go on without it");
                self.observer.note(&line);
                return (interrupted, Some(line));
            }
            clock::sleep_until(clock::now() + 1_000_000, 0);
        }
    }
}

/// Code of the latched safe state in the rig's status.
const TRIPPED: u64 = 8;

//! The process set, paced or in lockstep: table, services, watching, restarting, ending.

use crate::children::Change;
use crate::desk::Desk;
use crate::{Children, Observer, Outcome, Run, RunError, RunPlan, Watchers};
use assembly::manifest::{Drive, Manifest};
use regions::{ALL, Payload, RegionId};
use runtime::clock::{self, Grid, Nanos, SECOND};
use runtime::region_specs;
use std::sync::atomic::{AtomicBool, Ordering};
use table::{BenchLock, CreateOptions, RegionWriter, Table, TableInfo};

/// Longest wait for the services to get ready. [ns]
const READY_MAX_NS: Nanos = 60 * SECOND;
/// Time between setting the start and tick 0. [ns]
const START_IN_NS: Nanos = 50_000_000;
/// Time between two looks of the supervisor. [ns]
const LOOK_NS: Nanos = 5_000_000;
/// Longest wait for the services to end, behind the end of the run. [ns]
const END_MAX_NS: Nanos = 10 * SECOND;

/// Removes what a run keeps in memory and in the bench's directory, however the run ends.
struct Cleaner<'a> {
    lock: &'a BenchLock,
    children: Option<Children>,
}

impl Drop for Cleaner<'_> {
    fn drop(&mut self) {
        if let Some(children) = &mut self.children {
            children.kill();
        }
        let _ = table::remove_bench(self.lock);
        operator_link::remove_left_over(self.lock);
        Manifest::remove(&self.lock.bench().directory());
    }
}

pub(crate) fn run(
    run: &Run,
    drive: Drive,
    interrupt: &AtomicBool,
    observer: &mut dyn Observer,
) -> Result<Outcome, RunError> {
    let lock = run.bench.lock().map_err(RunError::Table)?;
    // Under the lock there is no other supervisor: what lies there is left over from a crash.
    let left = table::remove_bench(&lock).map_err(RunError::Table)?;
    if left > 0 {
        observer.note(&format!("removed {left} segments left over from an earlier run of this bench"));
    }
    operator_link::remove_left_over(&lock);
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

    let executable = std::env::current_exe().map_err(|e| RunError::Io("kingpin".into(), e))?;
    let output = run.directory.join("services.txt");
    let children = Children::start(executable, run.bench.name().as_str(), &output, run.restart_delay_ns)
        .map_err(|e| RunError::Io(output.clone(), e))?;
    let children = cleaner.children.insert(children);
    wait_until_ready(&table, children, drive, &output, interrupt)?;
    for line in said(&output).lines() {
        observer.note(line);
    }

    let mut plan = run.plan();
    if run.operated && drive == Drive::Paced {
        plan = plan.operated();
    }
    let mut watchers = Watchers::new(&table);
    let begin = clock::now();
    let mut supervision = Supervision { plan: &mut plan, bench: &mut bench, observer, interrupt };
    let (interrupted, given_up) = match drive {
        Drive::Paced => {
            let mut note = |line: &str| supervision.observer.note(line);
            let mut desk = Desk::new(&table, &run.bench, &run.resolved, run.operated, &mut note)?;
            desk.publish(0);
            supervision.publish(0, children, Some(&desk));
            let t0 = clock::now() + START_IN_NS;
            table.set_t0(t0).map_err(RunError::Table)?;
            supervision.paced(children, &mut watchers, Grid { t0, period: period_ns }, &mut desk)
        }
        Drive::Lockstep => {
            let schedule = params::Schedule::new(&run.resolved).map_err(RunError::Parameters)?;
            let parameters = table.claim_writer(RegionId::Parameters as usize).map_err(RunError::Table)?;
            table.set_t0(1).map_err(RunError::Table)?;
            let credit = specs[RegionId::RigStatus as usize].depth as u64 / 2;
            supervision.lockstep(children, &mut watchers, credit, &schedule, parameters)
        }
    };
    // The services end by themselves: they know the end. The logger is last.
    let limit = clock::now() + END_MAX_NS;
    while !children.all_ended() && given_up.is_none() && clock::now() < limit {
        for change in children.watch(true) {
            observer.note(&describe(&change));
        }
        clock::sleep_until(clock::now() + LOOK_NS, 0);
    }
    let wall_s = (clock::now() - begin) as f64 * 1e-9;
    watchers.look();
    Ok(Outcome {
        ticks: watchers.rig.head(),
        wall_s,
        period_s,
        interrupted,
        last_status: watchers.status,
        restarts: children.restarts(),
        given_up,
        logged: watchers.logged,
    })
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
) -> Result<(), RunError> {
    let limit = clock::now() + READY_MAX_NS;
    loop {
        // Timing regions are claimed by paced services after the start; the logger claims its own after it too.
        let unclaimed: Vec<_> = ALL
            .iter()
            .map(|&id| (id, id.region()))
            .filter(|(id, region)| {
                region.writer != "supervisor"
                    && region.layout.name != "Timing"
                    && *id != RegionId::LoggerStatus
            })
            .filter(|(id, _)| table.reader(*id as usize).header().writer().is_none())
            .map(|(_, region)| region.name)
            .collect();
        if unclaimed.is_empty() {
            return Ok(());
        }
        if let Some((service, how)) = children.early_death() {
            return Err(RunError::ServiceEnded { service, how, said: said(output) });
        }
        if clock::now() > limit || (interrupt.load(Ordering::Relaxed) && drive == Drive::Paced) {
            return Err(RunError::NotReady { unclaimed });
        }
        clock::sleep_until(clock::now() + 2_000_000, 0);
    }
}

fn describe(change: &Change) -> String {
    match change {
        Change::Died { service, how } => format!("service {service} died ({how})"),
        Change::Restarted { service } => format!("service {service} was started again"),
        Change::GivenUp { service, how } => {
            format!("service {service} died too often ({how}) and is given up: the run ends")
        }
    }
}

struct Supervision<'a> {
    plan: &'a mut RunPlan,
    bench: &'a mut RegionWriter,
    observer: &'a mut dyn Observer,
    interrupt: &'a AtomicBool,
}

impl Supervision<'_> {
    fn publish(&mut self, n: u64, children: &Children, desk: Option<&Desk>) {
        if n >= self.bench.head() {
            let mut words = self.plan.at(n);
            if let Some(desk) = desk {
                desk.dress(&mut words);
            }
            words.alive = children.alive();
            words.restarts = children.restarts();
            // Sole writer, and `n` is not yet published.
            let _ = self.bench.write(n, words.words());
        }
    }

    /// One look at the services. Returns the verdict if one was given up.
    fn watch(&mut self, children: &mut Children) -> Option<String> {
        let mut verdict = None;
        for change in children.watch(false) {
            let line = describe(&change);
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
        desk: &mut Desk,
    ) -> (bool, Option<String>) {
        let (mut interrupted, mut given_up) = (false, None);
        loop {
            clock::sleep_until(clock::now() + LOOK_NS, 0);
            let n = grid.tick_at(clock::now());
            if n >= self.plan.end {
                // The last word on the end must be there for whoever restarts now.
                self.publish(self.plan.end, children, Some(desk));
                return (interrupted, given_up);
            }
            watchers.look();
            if self.interrupt.load(Ordering::Relaxed) && !interrupted {
                interrupted = true;
                self.plan.stop_at(n);
            }
            if watchers.status.state == TRIPPED && !desk.operated() {
                // Latched: nothing more to be had from this run but the record of how it got there.
                self.plan.stop_at(n);
            }
            if given_up.is_none() {
                given_up = self.watch(children);
                if given_up.is_some() {
                    self.plan.stop_at(n);
                }
            }
            let mut note = |line: &str| self.observer.note(line);
            desk.look(n, clock::now(), watchers.status.state, self.plan, &mut note);
            self.publish(n, children, Some(desk));
            // Without an end in sight the bar is always full.
            let end = if self.plan.end == u64::MAX { n } else { self.plan.end };
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
                self.plan.stop_at(n);
            }
            let until = (watchers.logged.read_tick + credit).min(self.plan.end);
            for tick in n..until {
                self.publish(tick, &*children, None);
                let _ = parameters.write(tick, crate::live::at(schedule, tick).words());
            }
            if until > n {
                self.bench.ring();
                parameters.ring();
            }
            self.observer.progress(watchers.rig.head(), self.plan.end, &watchers.status);
            if watchers.rig.head() >= self.plan.end {
                return (interrupted, None);
            }
            // In lockstep a death ends the run: a restart would make it depend on when it happened.
            if let Some((service, how)) = children.early_death()
                && watchers.rig.head() < self.plan.end
                && !(how == "exit status 0" && n >= self.plan.end)
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

//! A tick service as a process: read the manifest, build the model, attach, claim, wait for the start, run.
//!
//! Everything that can fail for the user's sake fails before the claim; a claimed region says "ready".

use crate::manifest::{Drive, Manifest, ManifestError};
use crate::{AssemblyError, ServiceKind, build_in};
use regions::{Bench as BenchRegion, NO_TICK, Payload, RegionId};
use runtime::clock::{self, Grid, Nanos, SECOND};
use runtime::lockstep::Patience;
use runtime::realtime::Wish;
use runtime::{Bound, Hooks, Model, TickError, lockstep, paced, realtime, region_specs};
use table::{Bench, OpenOptions, RegionReader, Table, TableError};

/// How long a service waits for the supervisor to start the run. [ns]
const START_MAX_NS: Nanos = 120 * SECOND;

/// Without a sign of the supervisor for this long, services that have no hardware end by themselves. [s]
const ORPHAN_S: f64 = 12.0;

/// Why a service ended badly.
#[derive(Debug)]
pub enum ServiceError {
    /// No manifest.
    Manifest(ManifestError),
    /// The configuration cannot be built.
    Assembly(AssemblyError),
    /// The table refused.
    Table(TableError),
    /// The run broke off.
    Tick(TickError),
}

impl std::fmt::Display for ServiceError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            ServiceError::Manifest(e) => write!(f, "{e}"),
            ServiceError::Assembly(e) => write!(f, "{e}"),
            ServiceError::Table(e) => write!(f, "{e}"),
            ServiceError::Tick(e) => write!(f, "{e}"),
        }
    }
}

impl std::error::Error for ServiceError {}

/// Watches the bench region for the end of the run.
pub struct EndWatch {
    reader: RegionReader,
    words: BenchRegion,
    orphan_ticks: u64,
    looked_at: u64,
}

impl EndWatch {
    /// On a table with a period. [s]
    pub fn new(table: &Table, period_s: f64) -> Self {
        EndWatch {
            reader: table.reader(RegionId::Bench as usize).clone(),
            words: BenchRegion::absent(),
            orphan_ticks: (ORPHAN_S / period_s) as u64,
            looked_at: 0,
        }
    }

    /// Whether tick `n` is not part of the run any more. Paced runs also end when the supervisor is gone.
    pub fn ended(&mut self, n: u64, drive: Drive) -> bool {
        // The bench region changes every few ticks at most; one look a tick is plenty.
        self.looked_at = n;
        match self.reader.latest(n, self.words.words_mut()) {
            Some(latest) => {
                (self.words.end_tick != NO_TICK && n >= self.words.end_tick)
                    || (drive == Drive::Paced && latest.age > self.orphan_ticks)
            }
            None => false,
        }
    }
}

/// The table of a bench as its manifest describes it.
///
/// # Errors
/// [`TableError`].
pub fn open_table(bench: &Bench, manifest: &Manifest) -> Result<Table, TableError> {
    let period_s = manifest.resolved.scenario.timing.period_s();
    Table::open(bench, &region_specs(period_s), &OpenOptions::default())
}

/// Waits until the supervisor has set the start of tick 0. [ns]
///
/// # Errors
/// [`TickError::NeverStarted`].
pub fn wait_for_start(table: &Table) -> Result<Nanos, TickError> {
    let begin = clock::now();
    loop {
        if let Some(t0) = table.reader(RegionId::Bench as usize).header().t0_ns() {
            return Ok(t0);
        }
        let waited = clock::now() - begin;
        if waited > START_MAX_NS {
            return Err(TickError::NeverStarted { waited_s: waited as f64 * 1e-9 });
        }
        clock::sleep_until(clock::now() + 500_000, 0);
    }
}

/// Runs a tick service to its end. Notes of what the host refused go to `note`.
///
/// # Errors
/// [`ServiceError`].
pub fn serve(kind: ServiceKind, bench: &Bench, mut note: impl FnMut(&str)) -> Result<(), ServiceError> {
    let manifest = Manifest::read(&bench.directory()).map_err(ServiceError::Manifest)?;
    let scenario = &manifest.resolved.scenario;
    let table = open_table(bench, &manifest).map_err(ServiceError::Table)?;
    let lock = manifest.drive == Drive::Lockstep;
    let wanted = &scenario.realtime;
    let core = match kind {
        ServiceKind::Rig => wanted.cores.rig,
        ServiceKind::Vehicle => wanted.cores.vehicle,
        ServiceKind::Multibody => wanted.cores.multibody,
    };
    // In lockstep a real-time priority would only starve the logger it waits for.
    let wish = Wish {
        core: core.map(usize::from),
        priority: if lock { None } else { wanted.priority.map(|p| i32::from(p) + kind.priority_offset()) },
        lock_memory: false,
    };
    // Priority and core before the model is built: a restart must not wait for everybody else on a busy host.
    let mut refused = realtime::apply(&wish);
    let model =
        build_in(kind, &manifest.resolved, Some(&bench.directory())).map_err(ServiceError::Assembly)?;
    let mut bound: Bound<dyn Model> = Bound::new(model, &table, lock).map_err(ServiceError::Tick)?;
    refused.extend(realtime::apply(&Wish { lock_memory: wanted.lock_memory && !lock, ..Wish::default() }));
    for line in refused {
        note(&line);
    }
    let t0 = wait_for_start(&table).map_err(ServiceError::Tick)?;
    let restored = bound.restore(&table);
    if manifest.faults {
        bound.set_hooks(Hooks::new(&table, kind as u64));
    }
    let mut watch = EndWatch::new(&table, scenario.timing.period_s());
    let end = |n: u64| watch.ended(n, manifest.drive);
    let grid = Grid { t0, period: scenario.timing.period_ns() };
    let timing = &scenario.timing;
    let done = match manifest.drive {
        Drive::Lockstep => {
            let limit_ns = (scenario.limits.lockstep_wait_max_s * SECOND as f64) as Nanos;
            let first = restored.map_or(0, |n| n + 1);
            lockstep::follow(&mut bound, first, Patience { spin_ns: 0, limit_ns }, end)
        }
        Drive::Paced if kind == ServiceKind::Rig => {
            let plan = paced::LeadPlan { output_phase: timing.output_phase, spin_ns: SPIN_NS };
            // A restarted rig never publishes the past; it goes on with the tick that is running.
            let first = table.reader(RegionId::RigMeasurement as usize).head();
            paced::lead(&mut bound, &table, RegionId::RigTiming, grid, first, plan, end)
        }
        Drive::Paced => {
            let (region, latest_start, due, writes) = match kind {
                ServiceKind::Vehicle => {
                    (RegionId::VehicleTiming, timing.vehicle_latest_start, 0.02, RegionId::VehicleState)
                }
                _ => (
                    RegionId::MultibodyTiming,
                    timing.multibody_latest_start,
                    0.05,
                    RegionId::SuspensionState,
                ),
            };
            let plan = paced::FollowPlan {
                latest_start,
                done_by: timing.output_phase - latest_start,
                spin_lead_ns: 0,
                spin_tail_ns: SPIN_NS,
                due,
                used_at: timing.output_phase,
                catch_up_max: u64::from(scenario.limits.catch_up_max_ticks),
            };
            // Never started before, or died before its first checkpoint: from what nobody has published yet.
            let first = restored.map_or_else(|| table.reader(writes as usize).head(), |n| n + 1);
            paced::follow(&mut bound, &table, region, grid, first, plan, end)
        }
    };
    done.map(drop).map_err(ServiceError::Tick)
}

/// Bounded spin around the times aimed at; well under what real-time throttling takes offence at. [ns]
pub const SPIN_NS: Nanos = 20_000;

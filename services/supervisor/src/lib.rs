//! The supervisor: makes the table, starts the services, watches them, restarts the dead, ends the run.
//!
//! It stands outside the loop. The rig needs it for nothing but the wish to start and stop: when it dies,
//! the rig goes on, stops safely when nobody has come for ten seconds, and the others end.
//!
//! [`run`] drives one run to its end: paced or in lockstep as the process set ([`set`]), or in lockstep in
//! this process ([`chain`]).

mod chain;
mod children;
mod desk;
pub mod fault;
mod live;
mod operator;
mod set;

pub use assembly::plan::{RunPlan, request};
pub use children::{Change, Children, DEATHS_MAX, SERVICES, YOUNG_MAX, YOUNG_NS};
pub use live::at as parameters_at;
pub use operator::Operator;
pub use set::BELOW_SERVICES;

use assembly::manifest::{Drive, Manifest, ManifestError};
use assembly::{AssemblyError, service::ServiceError};
use config::ResolvedBench;
use regions::{LoggerStatus, Payload, RegionId, RigStatus};
use runtime::TickError;
use runtime::clock::{self, Nanos};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use table::{RegionReader, Table, TableError};

/// How a run is to be driven.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// The process set by the wall clock.
    Paced,
    /// Lockstep in this process.
    LockstepProcess,
    /// Lockstep as the process set.
    LockstepSet,
}

/// A run to be made.
#[derive(Debug)]
pub struct Run {
    /// Name of the bench.
    pub bench: table::Bench,
    /// Resolved configuration.
    pub resolved: ResolvedBench,
    /// Directory for the run's files; exists.
    pub directory: PathBuf,
    /// How.
    pub mode: Mode,
    /// Wait this long before starting a dead service again. [ns]
    pub restart_delay_ns: Nanos,
    /// Acknowledge, arm and start again after the rig was restarted or tripped: unattended runs of the virtual rig.
    pub rearm: bool,
    /// Whether the services obey the orders of a fault campaign.
    pub faults: bool,
    /// What is done to the services in lockstep in this process, by tick.
    pub fault_plan: Vec<fault::PlannedFault>,
    /// Versions for the log's header.
    pub versions: BTreeMap<String, String>,
    /// Arming, starting, stopping and acknowledging are left to an operator (paced runs).
    pub operated: bool,
}

/// A bench to be taken over from a dead supervisor.
#[derive(Debug, Clone)]
pub struct Attach {
    /// The bench.
    pub bench: table::Bench,
    /// As [`Run::rearm`].
    pub rearm: bool,
    /// As [`Run::restart_delay_ns`].
    pub restart_delay_ns: Nanos,
}

/// Who wants to see how a run goes.
pub trait Observer {
    /// Ticks done of all.
    fn progress(&mut self, done: u64, all: u64, status: &RigStatus);
    /// Something worth a line.
    fn note(&mut self, line: &str);
}

/// How a run ended.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// Ticks run.
    pub ticks: u64,
    /// Wall time from tick 0 to the end. [s]
    pub wall_s: f64,
    /// Period. [s]
    pub period_s: f64,
    /// Ended early on request.
    pub interrupted: bool,
    /// The rig's last word.
    pub last_status: RigStatus,
    /// Restarts by service.
    pub restarts: [u64; 4],
    /// A service that was given up, and how it died.
    pub given_up: Option<String>,
    /// The logger's last word.
    pub logged: LoggerStatus,
}

/// Why a run could not be made.
#[derive(Debug)]
pub enum RunError {
    /// The bench is in use, or its memory cannot be had.
    Table(TableError),
    /// The configuration cannot be built.
    Assembly(AssemblyError),
    /// Files.
    Io(PathBuf, std::io::Error),
    /// The manifest.
    Manifest(ManifestError),
    /// The log.
    Log(record::LogError),
    /// A service ended before the run began.
    ServiceEnded {
        /// Which.
        service: &'static str,
        /// How.
        how: String,
        /// What it said.
        said: String,
    },
    /// The services did not get ready in time.
    NotReady {
        /// Regions nobody claimed.
        unclaimed: Vec<&'static str>,
    },
    /// The bench has no supervisor, but its services still run.
    StillRunning {
        /// A region that is written.
        region: String,
        /// By whom.
        pid: u32,
    },
    /// There is no run to take over.
    NothingToAttach {
        /// The bench.
        bench: String,
        /// Why.
        why: String,
    },
    /// Lockstep broke off.
    Tick(TickError),
    /// A service in this process.
    Service(ServiceError),
    /// The scenario's changes of live parameters.
    Parameters(Vec<params::Refusal>),
}

impl std::fmt::Display for RunError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            RunError::Table(e) => write!(f, "{e}"),
            RunError::Assembly(e) => write!(f, "{e}"),
            RunError::Io(path, e) => write!(f, "{}: {e}", path.display()),
            RunError::Manifest(e) => write!(f, "{e}"),
            RunError::Log(e) => write!(f, "{e}"),
            RunError::ServiceEnded { service, how, said } => {
                write!(f, "service {service} ended before the run began ({how})\n{said}")
            }
            RunError::NotReady { unclaimed } => {
                write!(f, "services not ready: nobody claimed {}", unclaimed.join(", "))
            }
            RunError::StillRunning { region, pid } => write!(
                f,
                "the bench lost its supervisor but still runs (process {pid} writes {region}): take it over with \
                 `kingpin attach`, or wait until it has stopped by itself"
            ),
            RunError::NothingToAttach { bench, why } => {
                write!(f, "bench {bench} cannot be taken over: {why}")
            }
            RunError::Tick(e) => write!(f, "{e}"),
            RunError::Service(e) => write!(f, "{e}"),
            RunError::Parameters(refused) => {
                let lines: Vec<_> = refused.iter().map(|r| format!("scenario: {r}")).collect();
                f.write_str(&lines.join("\n"))
            }
        }
    }
}

impl std::error::Error for RunError {}

/// Makes a run from beginning to end. `interrupt` asks for an early, soft stop.
///
/// # Errors
/// [`RunError`]; nothing is left behind in shared memory.
pub fn run(run: &Run, interrupt: &AtomicBool, observer: &mut dyn Observer) -> Result<Outcome, RunError> {
    match run.mode {
        Mode::LockstepProcess => chain::run(run, interrupt, observer),
        Mode::Paced => set::run(run, Drive::Paced, interrupt, observer),
        Mode::LockstepSet => set::run(run, Drive::Lockstep, interrupt, observer),
    }
}

/// Takes over a running bench whose supervisor died, and sees it to its end. Also returns the run that it was.
///
/// # Errors
/// [`RunError`]; a bench that is in order, or has nothing left that runs, is left as it is.
pub fn attach(
    attach: &Attach,
    interrupt: &AtomicBool,
    observer: &mut dyn Observer,
) -> Result<(Run, Outcome), RunError> {
    set::attach(attach, interrupt, observer)
}

/// Saves the last seconds of a table that a crash left, beside the crashed run's log. What was done, in a line.
pub fn save_before_cleaning(lock: &table::BenchLock) -> String {
    match logger::blackbox::save(lock.bench(), None) {
        Ok(saved) => saved.to_string(),
        Err(error) => format!("nothing of what an earlier run left in memory could be saved: {error}"),
    }
}

/// Removes all that a bench left: shared memory, the operator's link, the manifest. Returns the number of segments.
///
/// # Errors
/// If a segment cannot be removed; the rest goes all the same.
pub fn remove_left_overs(lock: &table::BenchLock) -> Result<usize, TableError> {
    let segments = table::remove_bench(lock);
    operator_link::remove_left_over(lock);
    Manifest::remove(&lock.bench().directory());
    segments
}

impl Run {
    /// The run that a manifest describes.
    fn of_manifest(attach: &Attach, manifest: &Manifest) -> Self {
        Run {
            bench: attach.bench.clone(),
            resolved: manifest.resolved.clone(),
            directory: manifest.directory.clone(),
            mode: Mode::Paced,
            restart_delay_ns: attach.restart_delay_ns,
            rearm: attach.rearm,
            faults: manifest.faults,
            fault_plan: Vec::new(),
            // Whether an operator starts it stands in the table, not in the manifest.
            operated: false,
            versions: manifest.versions.clone(),
        }
    }

    fn manifest(&self, drive: Drive) -> Manifest {
        let wall_start_ns = clock::wall_now();
        Manifest {
            bench: self.bench.name().as_str().to_owned(),
            run_id: match drive {
                // Numbers that differ from run to run stay out of lockstep logs.
                Drive::Lockstep => 1,
                Drive::Paced => wall_start_ns,
            },
            drive,
            faults: self.faults,
            directory: self.directory.clone(),
            wall_start_ns,
            monotonic_start_ns: clock::now(),
            versions: self.versions.clone(),
            resolved: self.resolved.clone(),
        }
    }

    fn plan(&self) -> RunPlan {
        let scenario = &self.resolved.scenario;
        RunPlan::new(scenario.ticks(), scenario.timing.period_s(), self.resolved.rig.limits.stop_fade_s)
    }
}

/// Eyes on the rig and the logger.
struct Watchers {
    rig: RegionReader,
    logger: RegionReader,
    status: RigStatus,
    logged: LoggerStatus,
}

impl Watchers {
    fn new(table: &Table) -> Self {
        let mut status = RigStatus::absent();
        status.tick = 0;
        Watchers {
            rig: table.reader(RegionId::RigStatus as usize).clone(),
            logger: table.reader(RegionId::LoggerStatus as usize).clone(),
            status,
            logged: LoggerStatus::absent(),
        }
    }

    fn look(&mut self) {
        self.rig.latest(self.rig.head(), self.status.words_mut());
        self.logger.latest(self.logger.head(), self.logged.words_mut());
    }
}

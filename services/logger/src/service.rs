//! The logger as a process.

use crate::{Finished, Logger, run};
use assembly::manifest::{Drive, Manifest};
use assembly::service::{ServiceError, open_table, wait_for_start};
use record::{LogError, LogHeader, LogWriter, Source, text_hash};
use regions::RegionId;
use runtime::clock::Nanos;
use runtime::realtime::{self, Wish};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use table::Bench;

/// Time between two looks at the table when there is nothing new. [ns]
const POLL_NS: Nanos = 4_000_000;
/// The same in lockstep, where the run waits for the logger. [ns]
const POLL_LOCKSTEP_NS: Nanos = 100_000;

/// What each log file of a run says of it. `t0_ns`: start of tick 0, CLOCK_MONOTONIC.
pub fn create_header(manifest: &Manifest, t0_ns: Nanos) -> LogHeader {
    let resolved = &manifest.resolved;
    let lockstep = manifest.drive == Drive::Lockstep;
    let configuration = resolved.canonical_json();
    let mut versions = manifest.versions.clone();
    versions.insert("configuration_sha256".to_owned(), resolved.hash());
    LogHeader {
        bench: manifest.bench.clone(),
        scenario: resolved.scenario.name.clone(),
        run_id: manifest.run_id,
        period_ns: resolved.scenario.timing.period_ns(),
        // In lockstep times are n·T, whenever the run was made.
        wall_start_ns: if lockstep { 0 } else { wall_at(manifest, t0_ns) },
        monotonic_start_ns: if lockstep { 0 } else { t0_ns },
        lockstep,
        seed: resolved.scenario.seed,
        versions,
        configuration_hash: text_hash(&configuration),
        decimation: None,
        configuration,
        sources: resolved
            .sources
            .iter()
            .map(|source| Source { name: source.name.clone(), text: source.text.clone() })
            .collect(),
    }
}

/// Makes the next log file of a run. `t0_ns`: start of tick 0, CLOCK_MONOTONIC.
///
/// # Errors
/// [`LogError`] when the file cannot be made.
pub fn create_log(manifest: &Manifest, t0_ns: Nanos) -> Result<LogWriter, LogError> {
    let header = create_header(manifest, t0_ns);
    // The directory may have been removed meanwhile. If it cannot be made again, making the file says why.
    let _ = std::fs::create_dir_all(&manifest.directory);
    LogWriter::create(&LogWriter::next_path(&manifest.directory), &header)
}

/// Wall clock at tick 0: the same for every file of a run, whenever its logger started.
fn wall_at(manifest: &Manifest, t0_ns: Nanos) -> Nanos {
    let passed = t0_ns as i128 - manifest.monotonic_start_ns as i128;
    (manifest.wall_start_ns as i128 + passed).max(0) as Nanos
}

/// Why a logger ended badly.
#[derive(Debug)]
pub enum LoggerError {
    /// Attaching failed.
    Service(ServiceError),
    /// The log could not be made.
    Log(LogError),
}

impl std::fmt::Display for LoggerError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            LoggerError::Service(e) => write!(f, "{e}"),
            LoggerError::Log(e) => write!(f, "{e}"),
        }
    }
}

impl std::error::Error for LoggerError {}

/// Runs the logger of a bench to the end of the run; SIGTERM ends it in order.
///
/// # Errors
/// [`LoggerError`].
pub fn serve(bench: &Bench, mut note: impl FnMut(&str)) -> Result<Finished, LoggerError> {
    let manifest =
        Manifest::read(&bench.directory()).map_err(|e| LoggerError::Service(ServiceError::Manifest(e)))?;
    let table = open_table(bench, &manifest).map_err(|e| LoggerError::Service(ServiceError::Table(e)))?;
    // The supervisor's priority, inherited, is for getting started only.
    realtime::relax();
    let core = manifest.resolved.scenario.realtime.cores.logger.map(usize::from);
    for line in realtime::apply(&Wish { core, priority: None, lock_memory: false }) {
        note(&line);
    }
    let stop = Arc::new(AtomicBool::new(false));
    // Without the handler SIGTERM just kills: the log then ends at its last flush.
    let _ = signal_hook::flag::register(signal_hook::consts::SIGTERM, Arc::clone(&stop));
    // A file at its size limit is a full disk, not an end: the write is refused instead.
    let _ = signal_hook::flag::register(signal_hook::consts::SIGXFSZ, Arc::new(AtomicBool::new(false)));
    let t0 = wait_for_start(&table).map_err(|e| LoggerError::Service(ServiceError::Tick(e)))?;
    let poll = if manifest.drive == Drive::Lockstep { POLL_LOCKSTEP_NS } else { POLL_NS };
    let lockstep = manifest.drive == Drive::Lockstep;
    let fmus = manifest.resolved.fmus.len();
    let with_can = manifest.drive == Drive::Lockstep && manifest.resolved.can.is_some();
    let make = Box::new(move || create_log(&manifest, t0));
    let mut logger = Logger::new(&table, make).map_err(|e| LoggerError::Service(ServiceError::Table(e)))?;
    if with_can {
        logger.must_have(RegionId::Can);
    }
    if lockstep {
        for id in regions::FMUS.iter().take(fmus) {
            logger.must_have(*id);
        }
    }
    Ok(run(logger, poll, || stop.load(Ordering::Relaxed)))
}

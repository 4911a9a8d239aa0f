//! What was done in one run of the bench, and what was seen of it from outside.

use super::schedule::Injection;
use std::path::PathBuf;

/// A fault that was made.
#[derive(Debug, Clone)]
pub struct Made {
    /// What was to be done.
    pub injection: Injection,
    /// Tick in which it began.
    pub tick: u64,
    /// When it began, after the start of tick 0. [ns]
    pub at_ns: u64,
    /// When the service was attached again (or its successor). [ns]
    pub back_ns: Option<u64>,
    /// Tick at which the bench was seen running again.
    pub running_tick: Option<u64>,
    /// Start, attach and end of a process that does nothing else, measured just before. [ns]
    pub bare_ns: Option<u64>,
    /// Why it was not made at all.
    pub skipped: Option<String>,
    /// Ticks into whose memory was written: what the log says of them is not what was published.
    pub scribbled: Vec<u64>,
    /// The header that was written into was right again before long.
    pub put_right: bool,
}

impl Made {
    /// Not made.
    pub fn skipped(injection: Injection, why: impl Into<String>) -> Self {
        Made {
            injection,
            tick: 0,
            at_ns: 0,
            back_ns: None,
            running_tick: None,
            bare_ns: None,
            skipped: Some(why.into()),
            scribbled: Vec::new(),
            put_right: true,
        }
    }
}

/// Regions that are written every tick, whose completeness is judged.
pub const DENSE: [regions::RegionId; 4] = [
    regions::RegionId::RigMeasurement,
    regions::RegionId::VehicleState,
    regions::RegionId::SuspensionState,
    regions::RegionId::RigStatus,
];

/// What an observer who reads the table saw published.
#[derive(Debug, Clone, Default)]
pub struct Seen {
    /// Per region of [`DENSE`] the ticks that were there to be read, ascending.
    pub ticks: [Vec<u64>; DENSE.len()],
    /// Ticks that the observer itself was too slow for.
    pub unseen: u64,
}

/// One run of the bench.
#[derive(Debug, Clone)]
pub struct Round {
    /// Its files.
    pub directory: PathBuf,
    /// The faults, in order.
    pub made: Vec<Made>,
    /// What was seen from outside; `None` in lockstep.
    pub seen: Option<Seen>,
    /// What was wrong with the run as a whole: it did not begin, did not end, left something over.
    pub faults: Vec<String>,
}

//! The logger: a reader of the table that writes the log. It may lag seconds, die and come back.
//!
//! It keeps its place in each region by tick and reads the history, so it adds nothing to the 1 ms path. A
//! restarted logger goes on from the last tick its predecessor had flushed, in a file of its own: the set
//! of both has no gap as long as it was away for less than the table's history.
//!
//! Events (state changes, trips, late commands, restarts, losses) are derived here from the regions, so
//! that they cannot disagree with them.

pub mod blackbox;
mod files;
mod service;

pub use files::{Files, MakeLog};
pub use service::{create_header, create_log, serve};

use regions::{ALL, Bench, LoggerStatus, NO_TICK, Parameters, Payload, RegionId, RigStatus};
use runtime::clock::{self, Nanos};
use table::{Read, RegionReader, RegionWriter, Table, TableError};

/// Flush interval: what a killed logger loses at most. [ns]
pub const FLUSH_NS: Nanos = 50_000_000;

/// Silence behind the end of the run after which nothing more is waited for. [ns]
const END_NS: Nanos = 2 * clock::SECOND;
/// Silence of a run without an end (its supervisor died) after which nothing more is waited for. [ns]
const ORPHAN_NS: Nanos = 15 * clock::SECOND;

/// Most ticks of one region read in one go, so that no region falls behind the others.
const BATCH: u64 = 256;

/// Parameters that change many times a second: they are in the region, not among the events.
const STEERED: &str = "human.steering";

/// Regions that are written every tick: what the log's completeness is judged by.
const DENSE: [RegionId; 4] =
    [RegionId::RigMeasurement, RegionId::VehicleState, RegionId::SuspensionState, RegionId::RigStatus];

struct Track {
    id: RegionId,
    reader: RegionReader,
    next: u64,
    words: Box<[u64]>,
    dense: bool,
}

/// What is watched for events.
#[derive(Default)]
struct Watch {
    state: Option<u64>,
    trip_code: u64,
    late_commands: u64,
    restarts: [u64; 4],
    lost: u64,
    requests: u64,
    parameters: Option<Parameters>,
}

/// A logger at work.
pub struct Logger {
    tracks: Vec<Track>,
    log: Files,
    status_writer: RegionWriter,
    status: LoggerStatus,
    sequence: u64,
    end_tick: u64,
    flushed: Nanos,
    watch: Watch,
}

/// What a finished logger leaves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Finished {
    /// Messages written.
    pub messages: u64,
    /// Ticks lost because they were overwritten before they were read.
    pub lost: u64,
    /// Ticks that their writers never published.
    pub missing: u64,
    /// Writes the disk refused.
    pub write_errors: u64,
    /// Size of the file. [B]
    pub bytes: u64,
}

impl Logger {
    /// Attaches to the table and takes up where a dead predecessor had flushed.
    ///
    /// # Errors
    /// [`TableError`] when another logger is alive.
    pub fn new(table: &Table, make: MakeLog) -> Result<Self, TableError> {
        let status_writer = table.claim_writer(RegionId::LoggerStatus as usize)?;
        let mut status = LoggerStatus::absent();
        let reader = status_writer.reader();
        let resumed = reader.latest(reader.head(), status.words_mut()).is_some();
        // Only now, when no other logger is alive, so that no file is made in vain.
        let log = Files::new(make);
        let sequence = reader.head();
        let first = if resumed { status.written_tick } else { 0 };
        let tracks = ALL
            .iter()
            .filter(|id| id.region().logged())
            .map(|&id| Track {
                id,
                reader: table.reader(id as usize).clone(),
                next: first,
                words: vec![0; id.region().layout.words()].into(),
                dense: DENSE.contains(&id),
            })
            .collect();
        status.read_tick = first;
        let mut logger = Logger {
            tracks,
            log,
            status_writer,
            status,
            sequence,
            end_tick: NO_TICK,
            flushed: 0,
            watch: Watch::default(),
        };
        if resumed {
            logger.log.event(first, "logger_restarted", format!("goes on at tick {first}"));
        }
        logger.publish();
        Ok(logger)
    }

    /// The log is complete only with every tick of this region too: one whose service runs in lockstep behind the chain.
    pub fn must_have(&mut self, id: RegionId) {
        for track in self.tracks.iter_mut().filter(|track| track.id == id) {
            track.dense = true;
        }
    }

    /// Reads and writes what has come since the last call. Returns the number of messages, its own not counted.
    pub fn drain(&mut self) -> u64 {
        let mut messages = 0;
        for track in &mut self.tracks {
            let head = track.reader.head();
            // A logger that was away for longer than the history loses what was overwritten: counted below.
            let kept = head.saturating_sub(track.reader.depth() as u64);
            if track.next < kept {
                if track.dense {
                    self.status.lost_count += kept - track.next;
                }
                track.next = kept;
            }
            for n in track.next..head.min(track.next + BATCH) {
                match track.reader.read(n, &mut track.words) {
                    Read::Ready => {
                        if !self.log.write(track.id, n, &track.words) && track.dense {
                            self.status.lost_count += 1;
                        }
                        observe(
                            &mut self.watch,
                            &mut self.end_tick,
                            &mut self.log,
                            track.id,
                            n,
                            &track.words,
                        );
                        // Its own status is no news, or it would keep itself awake for ever.
                        messages += u64::from(track.id != RegionId::LoggerStatus);
                    }
                    Read::Missing if track.dense => self.status.missing_count += 1,
                    Read::Overwritten if track.dense => self.status.lost_count += 1,
                    Read::Missing | Read::Overwritten => {}
                    Read::NotYet => break,
                }
                track.next = n + 1;
            }
        }
        let read = self.tracks.iter().filter(|t| t.dense).map(|t| t.next).min().unwrap_or(0);
        let progressed = read != self.status.read_tick;
        self.status.read_tick = read;
        if self.status.lost_count > self.watch.lost {
            let lost = self.status.lost_count - self.watch.lost;
            self.watch.lost = self.status.lost_count;
            self.log.event(read, "log_lost_ticks", lost);
        }
        if progressed {
            self.publish();
        }
        messages
    }

    /// Hands everything to the system if the flush interval is over at `now`. [ns]
    pub fn flush_if_due(&mut self, now: Nanos) {
        if now.saturating_sub(self.flushed) >= FLUSH_NS {
            self.flushed = now;
            if self.log.flush() {
                self.status.written_tick = self.status.read_tick;
            }
            // A file that was removed took with it what was in it: a tick of each dense region is a loss.
            let gone = self.log.care(now, self.status.read_tick);
            if gone > 0 {
                self.status.lost_count += gone;
            }
            self.publish();
        }
    }

    /// Ticks below this one have been read of every dense region.
    pub fn read_tick(&self) -> u64 {
        self.status.read_tick
    }

    /// Whether all ticks of the run are read.
    pub fn complete(&self) -> bool {
        self.end_tick != NO_TICK && self.status.read_tick >= self.end_tick
    }

    /// First tick that is not part of the run, once that is known.
    pub fn end_tick(&self) -> Option<u64> {
        (self.end_tick != NO_TICK).then_some(self.end_tick)
    }

    /// Ends the log in order.
    pub fn finish(mut self) -> Finished {
        while self.drain() > 0 {}
        if self.log.flush() {
            self.status.written_tick = self.status.read_tick;
        } else {
            // The disk did not come back: what was kept for it in memory goes with this process.
            let dense = self.tracks.iter().filter(|track| track.dense).count() as u64;
            let kept = self.status.read_tick.saturating_sub(self.status.written_tick);
            self.status.lost_count += kept * dense;
        }
        self.publish();
        let stats = self.log.finish();
        Finished {
            messages: stats.messages,
            lost: self.status.lost_count,
            missing: self.status.missing_count,
            write_errors: stats.write_errors + stats.refused,
            bytes: stats.bytes,
        }
    }

    fn publish(&mut self) {
        let stats = self.log.stats();
        self.status.tick = self.sequence;
        self.status.message_count = stats.messages;
        self.status.write_error_count = stats.write_errors;
        self.status.byte_count = stats.bytes;
        // The status has a count of its own for a tick: it is published when there is news, not each tick.
        if self.status_writer.publish(self.sequence, self.status.words()).is_ok() {
            self.sequence += 1;
        }
    }
}

fn observe(watch: &mut Watch, end_tick: &mut u64, log: &mut Files, id: RegionId, n: u64, words: &[u64]) {
    match id {
        RegionId::Bench => {
            let mut bench = Bench::absent();
            bench.words_mut().copy_from_slice(words);
            *end_tick = bench.end_tick;
            if bench.request_count != watch.requests {
                watch.requests = bench.request_count;
                let asked = ["none", "arm", "start", "stop", "acknowledge", "off"];
                log.event(n, "request", *asked.get(bench.request as usize).unwrap_or(&"unknown"));
            }
            for (service, (&now, before)) in bench.restarts.iter().zip(&mut watch.restarts).enumerate() {
                if now > *before {
                    *before = now;
                    log.event(n, "service_restarted", regions::Axis::Service.label(service));
                }
            }
        }
        RegionId::Parameters => {
            let mut now = Parameters::absent();
            now.words_mut().copy_from_slice(words);
            // The first are the configuration's own.
            let before = watch.parameters.replace(now).unwrap_or(now);
            if now.version != before.version {
                let changed = params::difference(&before.value, &now.value);
                for (path, from, to) in changed.into_iter().filter(|(path, ..)| !path.starts_with(STEERED)) {
                    log.event(
                        n,
                        "parameter",
                        serde_json::json!({"path": path, "from": from, "to": to, "version": now.version}),
                    );
                }
            }
        }
        RegionId::RigStatus => {
            let mut status = RigStatus::absent();
            status.words_mut().copy_from_slice(words);
            if watch.state != Some(status.state) {
                watch.state = Some(status.state);
                log.event(n, "state", regions::state_name(status.state));
            }
            if status.trip_code != watch.trip_code {
                watch.trip_code = status.trip_code;
                log.event(
                    n,
                    "trip",
                    serde_json::json!({"code": status.trip_code, "tick": status.trip_tick,
                        "limit": status.trip_limit, "value": status.trip_value}),
                );
            }
            if status.late_command_count > watch.late_commands {
                let late = status.late_command_count - watch.late_commands;
                watch.late_commands = status.late_command_count;
                log.event(n, "late_command", late);
            }
        }
        _ => {}
    }
}

/// Runs a logger until the run is over, `stop` says so, or nothing has come for `idle_max_ns` after the end.
pub fn run(mut logger: Logger, poll_ns: Nanos, mut stop: impl FnMut() -> bool) -> Finished {
    let mut last_news = clock::now();
    loop {
        let messages = logger.drain();
        let now = clock::now();
        logger.flush_if_due(now);
        if logger.complete() || stop() {
            return logger.finish();
        }
        if messages > 0 {
            last_news = now;
            continue;
        }
        // The end is known but a service died short of it, or everybody has gone without a word: what there is,
        // is all there will be.
        let patience = if logger.end_tick().is_some() { END_NS } else { ORPHAN_NS };
        if now - last_news > patience {
            return logger.finish();
        }
        clock::sleep_until(now + poll_ns, 0);
    }
}

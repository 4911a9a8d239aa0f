//! The files of a log while its disk is well, full, read-only or gone.
//!
//! A file that the disk refuses for too long, that was removed, or that could not be made at all is given up and
//! another one tried once a second; what comes meanwhile is counted as lost. The loop never notices.

use record::{LogError, LogWriter, WriteStats};
use regions::RegionId;
use runtime::clock::{Nanos, SECOND};

/// Time between two attempts to make a file, and between two looks whether it is still there. [ns]
const RETRY_NS: Nanos = SECOND;

/// Makes the next file of the log.
pub type MakeLog = Box<dyn FnMut() -> Result<LogWriter, LogError> + Send>;

/// Where the log goes.
pub struct Files {
    make: MakeLog,
    log: Option<LogWriter>,
    retry_at: Nanos,
    /// Of the files before the present one.
    before: WriteStats,
    refused_files: u64,
    /// What happened to the files, not yet told: `kind`, detail.
    told: Vec<(&'static str, String)>,
}

impl Files {
    /// With the first file, if it can be made.
    pub fn new(mut make: MakeLog) -> Self {
        let mut files = Files {
            log: None,
            retry_at: 0,
            before: WriteStats::default(),
            refused_files: 0,
            told: Vec::new(),
            make: Box::new(|| unreachable!("replaced below")),
        };
        match make() {
            Ok(log) => files.log = Some(log),
            Err(error) => {
                files.refused_files += 1;
                files.told.push(("log_refused", error.to_string()));
            }
        }
        files.make = make;
        files
    }

    /// Writes a message; `false`: it is lost.
    pub fn write(&mut self, id: RegionId, tick: u64, words: &[u64]) -> bool {
        self.log.as_mut().is_some_and(|log| log.write(id, tick, words))
    }

    /// Writes an event, if there is a file.
    pub fn event(&mut self, tick: u64, kind: &str, detail: impl Into<serde_json::Value>) {
        if let Some(log) = &mut self.log {
            log.event(tick, kind, detail);
        }
    }

    /// Hands everything to the system. `true`: nothing is left over in this process.
    pub fn flush(&mut self) -> bool {
        self.log.as_mut().is_none_or(|log| {
            log.flush();
            log.stats().pending_bytes == 0
        })
    }

    /// Looks after the file at `now` and tick `tick`. Returns the messages that were in a file that has gone.
    pub fn care(&mut self, now: Nanos, tick: u64) -> u64 {
        if now < self.retry_at {
            return 0;
        }
        self.retry_at = now + RETRY_NS;
        let mut gone = 0;
        if let Some(log) = &self.log {
            // Removed under our hands: what is written there, nobody can read any more.
            let removed = log.links().is_some_and(|links| links == 0);
            if removed {
                gone = log.stats().messages;
                self.told.push(("log_removed", format!("{} with {gone} messages", log.path().display())));
            }
            if removed || !log.is_open() {
                self.close(removed);
            }
        }
        if self.log.is_none() {
            match (self.make)() {
                Ok(mut log) => {
                    log.event(tick, "log_resumed", format!("{}", log.path().display()));
                    self.log = Some(log);
                }
                Err(error) => {
                    self.refused_files += 1;
                    if self.told.len() < 100 {
                        self.told.push(("log_refused", error.to_string()));
                    }
                }
            }
        }
        for (kind, detail) in std::mem::take(&mut self.told) {
            match &mut self.log {
                Some(log) => log.event(tick, kind, detail),
                None => self.told.push((kind, detail)),
            }
        }
        gone
    }

    fn close(&mut self, removed: bool) {
        if let Some(log) = self.log.take() {
            let stats = log.stats();
            if !removed {
                self.told.push(("log_given_up", log.last_error().unwrap_or_default()));
            }
            self.before.messages += if removed { 0 } else { stats.messages };
            self.before.events += stats.events;
            self.before.refused += stats.refused;
            self.before.write_errors += stats.write_errors;
            self.before.bytes += if removed { 0 } else { stats.bytes };
        }
    }

    /// All files together.
    pub fn stats(&self) -> WriteStats {
        let present = self.log.as_ref().map(LogWriter::stats).unwrap_or_default();
        WriteStats {
            messages: self.before.messages + present.messages,
            events: self.before.events + present.events,
            refused: self.before.refused + present.refused,
            write_errors: self.before.write_errors + present.write_errors + self.refused_files,
            bytes: self.before.bytes + present.bytes,
            pending_bytes: present.pending_bytes,
        }
    }

    /// Ends the log in order.
    pub fn finish(mut self) -> WriteStats {
        let stats = self.stats();
        let present = self.log.take().map(|log| {
            let before = log.stats();
            // What could not be written is in the counts; the file up to there is readable.
            log.finish().map(|after| (before, after))
        });
        match present {
            Some(Ok((before, after))) => {
                WriteStats { bytes: stats.bytes - before.bytes + after.bytes, ..stats }
            }
            _ => stats,
        }
    }
}

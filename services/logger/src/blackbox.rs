//! The last seconds out of a table, live or left over by a crash, as a log.
//!
//! Every tick that is still in the rings is written, checkpoints apart, oldest first. Regions of another layout
//! (left by another version) are named and left out. The log carries the run's configuration if its manifest
//! is still there.

use crate::create_header;
use assembly::manifest::Manifest;
use record::{LogError, LogHeader, LogWriter};
use std::path::{Path, PathBuf};
use table::{Bench, Read, RegionReader, TableError};

/// What was saved.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct Saved {
    /// The log.
    pub path: PathBuf,
    /// First and last tick in it.
    pub ticks: (u64, u64),
    /// Seconds that they span.
    pub span_ms: u64,
    /// Messages written.
    pub messages: u64,
    /// Ticks that were being written when their writer died, or that it skipped.
    pub missing: u64,
    /// Regions left out, and why.
    pub left_out: Vec<String>,
}

impl std::fmt::Display for Saved {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "saved the last {:.3} s (ticks {} to {}, {} messages) to {}",
            self.span_ms as f64 * 1e-3,
            self.ticks.0,
            self.ticks.1,
            self.messages,
            self.path.display()
        )?;
        for region in &self.left_out {
            write!(f, "; left out: {region}")?;
        }
        Ok(())
    }
}

/// Why nothing was saved.
#[derive(Debug)]
pub enum BlackboxError {
    /// The table.
    Table(TableError),
    /// The bench has no table, or nothing was ever written to it.
    Nothing(String),
    /// The log.
    Log(LogError),
}

impl std::fmt::Display for BlackboxError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            BlackboxError::Table(e) => write!(f, "{e}"),
            BlackboxError::Nothing(bench) => {
                write!(f, "bench {bench} has no table with anything in it: it ended in order, or never ran")
            }
            BlackboxError::Log(e) => write!(f, "{e}"),
        }
    }
}

impl std::error::Error for BlackboxError {}

/// Saves what is in the rings to `path`, or to the first free `blackbox.mcap`, `blackbox.1.mcap`, … in the run's
/// directory, or in the present one if that is not known.
///
/// # Errors
/// [`BlackboxError`].
pub fn save(bench: &Bench, path: Option<&Path>) -> Result<Saved, BlackboxError> {
    let manifest = Manifest::read(&bench.directory()).ok();
    let mut left_out = Vec::new();
    let mut open = Vec::new();
    for found in table::list_bench(bench).map_err(BlackboxError::Table)? {
        let Some((id, region)) = regions::region_by_name(&found.region) else {
            left_out.push(format!("{} (unknown to this version)", found.region));
            continue;
        };
        match RegionReader::open_any(bench, &found.region) {
            Ok(reader) if reader.layout().hash != region.layout.hash() => {
                left_out.push(format!("{} (another layout: {})", region.name, reader.layout()));
            }
            Ok(reader) if region.logged() => open.push((id, reader)),
            Ok(_) => {}
            Err(error) => left_out.push(format!("{} ({error})", region.name)),
        }
    }
    open.sort_by_key(|(id, _)| *id);
    let nothing = || BlackboxError::Nothing(bench.name().to_string());
    let kept = |reader: &RegionReader| (reader.head().saturating_sub(reader.depth() as u64), reader.head());
    // Not all regions count in ticks of the run: those that do are written together, the rest before them.
    let dense = |id: &regions::RegionId| id.region().history == regions::History::Seconds;
    let ranges = open.iter().filter(|(id, r)| dense(id) && r.head() > 0).map(|(_, r)| kept(r));
    let (first, end) =
        ranges.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1))).filter(|r| r.1 > 0).ok_or_else(nothing)?;

    let info = open.first().map(|(_, reader)| reader.header().info()).ok_or_else(nothing)?;
    let header = match &manifest {
        Some(manifest) => create_header(manifest, info.t0_ns),
        None => LogHeader {
            bench: bench.name().to_string(),
            run_id: info.run_id,
            period_ns: info.period_ns,
            monotonic_start_ns: info.t0_ns,
            ..LogHeader::default()
        },
    };
    let path = path.map(Path::to_owned).unwrap_or_else(|| {
        let directory = manifest.map(|m| m.directory).filter(|d| d.is_dir()).unwrap_or_else(|| ".".into());
        free_path(&directory)
    });
    let mut log = LogWriter::create(&path, &header).map_err(BlackboxError::Log)?;
    log.event(first, "blackbox", format!("ticks {first} to {} out of the table", end - 1));
    let mut words: Vec<Vec<u64>> = open.iter().map(|(_, r)| vec![0; r.words()]).collect();
    let (mut messages, mut missing) = (0, 0);
    let mut put = |index: usize, n: u64, log: &mut LogWriter, words: &mut [Vec<u64>]| {
        let (id, reader) = &open[index];
        match reader.read(n, &mut words[index]) {
            Read::Ready => messages += u64::from(log.write(*id, n, &words[index])),
            Read::Missing if reader.head() > n => missing += 1,
            _ => {}
        }
    };
    for (index, (id, reader)) in open.iter().enumerate() {
        if !dense(id) {
            let (from, to) = kept(reader);
            (from..to).for_each(|n| put(index, n, &mut log, &mut words));
        }
    }
    for n in first..end {
        for (index, (id, _)) in open.iter().enumerate() {
            if dense(id) {
                put(index, n, &mut log, &mut words);
            }
        }
    }
    log.finish().map_err(BlackboxError::Log)?;
    let span_ms = (end - first) * info.period_ns / 1_000_000;
    Ok(Saved { path, ticks: (first, end - 1), span_ms, messages, missing, left_out })
}

fn free_path(directory: &Path) -> PathBuf {
    let name =
        |index: u32| if index == 0 { "blackbox.mcap".into() } else { format!("blackbox.{index}.mcap") };
    let free = (0..u32::MAX).map(|index| directory.join(name(index))).find(|p| p.symlink_metadata().is_err());
    free.unwrap_or_else(|| directory.join("blackbox.mcap"))
}

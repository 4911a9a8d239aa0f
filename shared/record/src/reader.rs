//! A log as tables: per region the ticks that are there and every word as a named column.
//!
//! Names, kinds and units come from the log itself, so that logs of other versions stay readable. A run may
//! have left several files (a logger that died and came back): they are read as one, a tick written twice
//! counts once, and what is missing stays visible. Whole regions are held in memory, about 2.5 MB per
//! second of a run at 1 kHz; [`LogReader::open_regions`] reads only some.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use regions::Kind;

use crate::error::LogError;
use crate::header::{
    CONFIGURATION_ATTACHMENT, HEADER_ATTACHMENT, LogHeader, METADATA_NAME, SOURCE_PREFIX, Source,
};
use crate::scan::{Channel, Item, ScanReport, scan};
use crate::writer::{EVENTS_TOPIC, file_name};

/// A word of a region as a column.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LogColumn {
    /// `field` or `field.label`.
    pub name: String,
    /// What the word holds.
    pub kind: Kind,
    /// Unit symbol, `1` for counters, codes and ratios.
    pub unit: String,
}

/// A region in a log: rows of words by tick.
#[derive(Debug, Clone, PartialEq)]
pub struct RegionLog {
    /// Name of the region.
    pub name: String,
    /// Name of its layout.
    pub layout: String,
    /// Hash of its layout, 16 hexadecimal digits.
    pub layout_hash: String,
    /// Whether two lockstep runs of one scenario must agree on it.
    pub compared: bool,
    /// Columns, one per word.
    pub columns: Vec<LogColumn>,
    /// Ticks that are there, ascending, each once.
    pub ticks: Vec<u64>,
    /// Ticks that were written again with the same words.
    pub duplicates: u64,
    /// Ticks that were written again with other words: the first one counts.
    pub conflicts: u64,
    /// Messages whose length did not fit.
    pub malformed: u64,
    words: Vec<u64>,
}

/// Something that happened.
#[derive(Debug, Clone, PartialEq)]
pub struct Event {
    /// At which tick.
    pub tick: u64,
    /// Start of the tick since the start of the run. \[s\]
    pub time_s: f64,
    /// What kind of event.
    pub kind: String,
    /// What happened, a text or a JSON value.
    pub detail: serde_json::Value,
}

impl Event {
    /// The event as it stands in a log.
    pub(crate) fn json(&self) -> String {
        serde_json::json!({ "tick": self.tick, "time_s": self.time_s, "kind": self.kind, "detail": self.detail })
            .to_string()
    }

    /// The detail as a line of text.
    pub fn text(&self) -> String {
        match &self.detail {
            serde_json::Value::String(text) => text.clone(),
            serde_json::Value::Null => String::new(),
            other => other.to_string(),
        }
    }
}

/// One file of a log.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LogFile {
    /// The file.
    pub path: PathBuf,
    /// How it was.
    pub scan: ScanReport,
    /// First and last tick of any region in it.
    pub ticks: Option<(u64, u64)>,
    /// Wall clock at tick 0 as this file has it; `None` if its head is damaged. \[ns\]
    pub wall_start_ns: Option<u64>,
}

/// A signal over time.
#[derive(Debug, Clone, PartialEq)]
pub struct Signal {
    /// `region.field` or `region.field.label`.
    pub name: String,
    /// Unit symbol.
    pub unit: String,
    /// Time each value is valid for. \[s\]
    pub time_s: Vec<f64>,
    /// Values, NaN where absent.
    pub value: Vec<f64>,
}

/// A log, read.
#[derive(Debug, Clone, PartialEq)]
pub struct LogReader {
    /// What the log says about its run.
    pub header: LogHeader,
    /// Files, in order.
    pub files: Vec<LogFile>,
    /// Events, by tick.
    pub events: Vec<Event>,
    regions: Vec<RegionLog>,
}

impl LogReader {
    /// Reads a log file, or all files `log.mcap`, `log.1.mcap`, … of a run's directory as one.
    ///
    /// # Errors
    /// If there is none, a file is not a log, or the files are not of one run. A damaged or truncated file
    /// is no error: see [`LogReader::files`].
    pub fn open(path: &Path) -> Result<LogReader, LogError> {
        Self::open_regions(path, |_| true)
    }

    /// The same, but keeps only the regions whose name `wanted` accepts.
    ///
    /// # Errors
    /// As [`LogReader::open`].
    pub fn open_regions(path: &Path, wanted: impl Fn(&str) -> bool) -> Result<LogReader, LogError> {
        let paths = log_files(path)?;
        let mut loader =
            Loader { wanted: &wanted, regions: BTreeMap::new(), order: Vec::new(), events: Vec::new() };
        let mut files = Vec::new();
        let mut header: Option<LogHeader> = None;
        for path in paths {
            let (file, found) = loader.load(path)?;
            match (&header, found) {
                (Some(first), Some(found)) if found.run_id != first.run_id => {
                    return Err(LogError::DifferentRuns {
                        path: file.path,
                        expected: first.run_id,
                        found: found.run_id,
                    });
                }
                (None, Some(found)) => header = Some(found),
                // A file damaged at its head tells nothing of its run; its data may still serve.
                _ => {}
            }
            files.push(file);
        }
        let mut events = loader.events;
        events.sort_by_key(|event| event.tick);
        let mut regions: Vec<RegionLog> = Vec::new();
        for name in &loader.order {
            if let Some(mut region) = loader.regions.remove(name) {
                region.put_in_order();
                regions.push(region);
            }
        }
        let header = header.unwrap_or_default();
        name_user_outputs(&mut regions, &header.configuration);
        Ok(LogReader { header, files, events, regions })
    }

    /// All regions in the log, in the order of their definition.
    pub fn regions(&self) -> &[RegionLog] {
        &self.regions
    }

    pub(crate) fn of_parts(header: LogHeader, regions: Vec<RegionLog>) -> LogReader {
        LogReader { header, files: Vec::new(), events: Vec::new(), regions }
    }

    pub(crate) fn regions_mut(&mut self) -> &mut [RegionLog] {
        &mut self.regions
    }

    /// A region by name.
    ///
    /// # Errors
    /// If the log has none of that name.
    pub fn region(&self, name: &str) -> Result<&RegionLog, LogError> {
        self.regions.iter().find(|region| region.name == name).ok_or_else(|| LogError::UnknownSignal {
            name: name.to_owned(),
            known: self.regions.iter().map(|r| r.name.clone()).filter(|n| close(n, name)).collect(),
        })
    }

    /// A column of a region as numbers, e.g. `column("rig_measurement", "tie_rod_force_n.left")`. Counters
    /// above 2⁵³ lose their last digits: see [`LogReader::column_u64`].
    ///
    /// # Errors
    /// If the log has no such region or column.
    pub fn column(&self, region: &str, column: &str) -> Result<Vec<f64>, LogError> {
        let region = self.region(region)?;
        Ok(region.numbers(region.column_index(column)?))
    }

    /// A column of a region as words.
    ///
    /// # Errors
    /// If the log has no such region or column.
    pub fn column_u64(&self, region: &str, column: &str) -> Result<Vec<u64>, LogError> {
        let region = self.region(region)?;
        Ok(region.words_of(region.column_index(column)?))
    }

    /// Time each row of a region is valid for: its `time_s`, else the start of the tick. \[s\]
    ///
    /// # Errors
    /// If the log has no such region.
    pub fn time_s(&self, region: &str) -> Result<Vec<f64>, LogError> {
        let region = self.region(region)?;
        Ok(match region.column_index("time_s") {
            Ok(column) => region.numbers(column),
            Err(_) => region.ticks.iter().map(|&tick| self.header.time_s(tick)).collect(),
        })
    }

    /// A signal by its full name, `region.field` or `region.field.label`.
    ///
    /// # Errors
    /// If the log has none of that name.
    pub fn signal(&self, name: &str) -> Result<Signal, LogError> {
        let (region_name, column) = name.split_once('.').unwrap_or((name, ""));
        let region = self.region(region_name)?;
        let index = region.column_index(column)?;
        Ok(Signal {
            name: name.to_owned(),
            unit: region.columns[index].unit.clone(),
            time_s: self.time_s(region_name)?,
            value: region.numbers(index),
        })
    }

    /// First and last tick of any region.
    pub fn tick_range(&self) -> Option<(u64, u64)> {
        let firsts = self.regions.iter().filter_map(|r| r.ticks.first());
        let lasts = self.regions.iter().filter_map(|r| r.ticks.last());
        Some((*firsts.min()?, *lasts.max()?))
    }

    /// Whether every file was ended by its writer and nothing in them was damaged.
    pub fn intact(&self) -> bool {
        self.files.iter().all(|f| f.scan.finished && f.scan.bytes_dropped == 0 && f.scan.damaged_chunks == 0)
    }
}

impl RegionLog {
    /// Number of a column.
    ///
    /// # Errors
    /// If there is none of that name.
    pub fn column_index(&self, name: &str) -> Result<usize, LogError> {
        self.columns.iter().position(|column| column.name == name).ok_or_else(|| LogError::UnknownSignal {
            name: format!("{}.{name}", self.name),
            known: self
                .columns
                .iter()
                .filter(|c| close(&c.name, name))
                .map(|c| format!("{}.{}", self.name, c.name))
                .take(5)
                .collect(),
        })
    }

    /// The words of row `row`.
    pub fn row(&self, row: usize) -> &[u64] {
        let width = self.columns.len();
        &self.words[row * width..(row + 1) * width]
    }

    /// The words of a tick.
    pub fn at_tick(&self, tick: u64) -> Option<&[u64]> {
        self.ticks.binary_search(&tick).ok().map(|row| self.row(row))
    }

    /// A column as words.
    pub fn words_of(&self, column: usize) -> Vec<u64> {
        (0..self.ticks.len()).map(|row| self.row(row)[column]).collect()
    }

    /// A column as numbers.
    pub fn numbers(&self, column: usize) -> Vec<f64> {
        let kind = self.columns[column].kind;
        (0..self.ticks.len()).map(|row| number(kind, self.row(row)[column])).collect()
    }

    /// Gaps: first and last tick of every run of ticks that is not there, between the first and the last.
    pub fn missing(&self) -> Vec<(u64, u64)> {
        self.ticks.windows(2).filter(|w| w[1] - w[0] > 1).map(|w| (w[0] + 1, w[1] - 1)).collect()
    }

    /// How many ticks lie in gaps.
    pub fn missing_count(&self) -> u64 {
        self.missing().iter().map(|(first, last)| last - first + 1).sum()
    }

    pub(crate) fn new(
        name: String,
        layout: String,
        layout_hash: String,
        compared: bool,
        columns: Vec<LogColumn>,
        ticks: Vec<u64>,
        words: Vec<u64>,
    ) -> Self {
        debug_assert_eq!(words.len(), ticks.len() * columns.len());
        RegionLog {
            name,
            layout,
            layout_hash,
            compared,
            columns,
            ticks,
            duplicates: 0,
            conflicts: 0,
            malformed: 0,
            words,
        }
    }

    /// Replaces the rows; as many as there are ticks.
    pub(crate) fn set_words(&mut self, words: Vec<u64>) {
        debug_assert_eq!(words.len(), self.ticks.len() * self.columns.len());
        self.words = words;
    }

    /// Sorts rows by tick and keeps the first of each.
    fn put_in_order(&mut self) {
        if self.ticks.windows(2).all(|w| w[0] < w[1]) {
            return;
        }
        let width = self.columns.len();
        let mut rows: Vec<usize> = (0..self.ticks.len()).collect();
        // Stable: of equal ticks the one written first stays first.
        rows.sort_by_key(|&row| self.ticks[row]);
        let mut ticks: Vec<u64> = Vec::with_capacity(rows.len());
        let mut words: Vec<u64> = Vec::with_capacity(self.words.len());
        for row in rows {
            let content = self.row(row);
            if ticks.last() == Some(&self.ticks[row]) {
                if words[words.len() - width..] == *content {
                    self.duplicates += 1;
                } else {
                    self.conflicts += 1;
                }
                continue;
            }
            ticks.push(self.ticks[row]);
            words.extend_from_slice(content);
        }
        self.ticks = ticks;
        self.words = words;
    }
}

/// A word as a number.
pub(crate) fn number(kind: Kind, word: u64) -> f64 {
    match kind {
        Kind::F64 => f64::from_bits(word),
        Kind::U64 => word as f64,
    }
}

/// Whether two names look alike: one holds a part of the other.
fn close(known: &str, asked: &str) -> bool {
    let parts: BTreeSet<&str> = asked.split(['_', '.']).filter(|p| p.len() > 2).collect();
    known.split(['_', '.']).filter(|p| parts.contains(p)).count() * 2 >= parts.len().max(1)
}

/// The files of a log.
///
/// # Errors
/// If a directory holds no `log.mcap`.
pub fn log_files(path: &Path) -> Result<Vec<PathBuf>, LogError> {
    if !path.is_dir() {
        return Ok(vec![path.to_owned()]);
    }
    // The first file may be the one that is lost, but a directory without any is not a run's.
    let files: Vec<PathBuf> =
        (0..1000).map(|index| path.join(file_name(index))).filter(|file| file.is_file()).collect();
    if files.is_empty() {
        return Err(LogError::NoLogIn(path.to_owned()));
    }
    Ok(files)
}

struct Loader<'a> {
    wanted: &'a dyn Fn(&str) -> bool,
    regions: BTreeMap<String, RegionLog>,
    order: Vec<String>,
    events: Vec<Event>,
}

impl Loader<'_> {
    fn load(&mut self, path: PathBuf) -> Result<(LogFile, Option<LogHeader>), LogError> {
        let mut head = Head::default();
        // By channel id: which region, or none.
        let mut channels: BTreeMap<u16, Option<String>> = BTreeMap::new();
        let mut ticks: Option<(u64, u64)> = None;
        let report = scan(&path, |item| match item {
            Item::Message(_, channel, _, _, data) if channel.topic == EVENTS_TOPIC => {
                if let Some(event) = read_event(data) {
                    self.events.push(event);
                }
            }
            Item::Message(id, channel, _, _, data) => {
                let name = channels.entry(id).or_insert_with(|| self.region_of(channel));
                let region = name.as_ref().and_then(|name| self.regions.get_mut(name));
                if let Some(tick) = region.and_then(|region| region.push(data)) {
                    ticks = Some(ticks.map_or((tick, tick), |(a, b)| (a.min(tick), b.max(tick))));
                }
            }
            other => head.take(&other),
        })?;
        let header = head.header();
        let wall_start_ns = header.as_ref().map(|header| header.wall_start_ns);
        Ok((LogFile { path, scan: report, ticks, wall_start_ns }, header))
    }

    /// The region a channel belongs to, made at its first message.
    fn region_of(&mut self, channel: &Channel) -> Option<String> {
        let region = read_region(channel)?;
        if !(self.wanted)(&region.name) {
            return None;
        }
        let name = region.name.clone();
        match self.regions.get(&name) {
            // Another layout within one run would be another program: its rows do not fit.
            Some(known) if known.columns != region.columns => return None,
            Some(_) => {}
            None => {
                self.order.push(name.clone());
                self.regions.insert(name.clone(), region);
            }
        }
        Some(name)
    }
}

impl RegionLog {
    fn push(&mut self, data: &[u8]) -> Option<u64> {
        let width = self.columns.len();
        let body = data.get(4..).unwrap_or_default();
        if body.len() != 8 * width {
            self.malformed += 1;
            return None;
        }
        let start = self.words.len();
        self.words.extend(body.as_chunks::<8>().0.iter().map(|bytes| u64::from_le_bytes(*bytes)));
        let tick = self.words[start];
        self.ticks.push(tick);
        Some(tick)
    }
}

/// The user's outputs lie in numbered slots; the configuration in the log says their names and units.
pub(crate) fn name_user_outputs(regions: &mut [RegionLog], configuration: &str) {
    let slots = regions.iter_mut().flat_map(|region| &mut region.columns);
    let mut slots: Vec<_> = slots.filter(|column| column.name.starts_with("user_output.")).collect();
    if slots.is_empty() || !configuration.contains("\"equations\"") {
        return;
    }
    let Ok(configuration) = serde_json::from_str::<serde_json::Value>(configuration) else { return };
    let outputs = configuration.pointer("/scenario/equations/outputs").and_then(|list| list.as_array());
    for (slot, output) in slots.iter_mut().zip(outputs.into_iter().flatten()) {
        if let (Some(name), Some(unit)) = (output["name"].as_str(), output["unit"].as_str()) {
            slot.name = format!("user_output.{name}");
            unit.clone_into(&mut slot.unit);
        }
    }
}

/// A region as its channel's metadata tell it. A region's first column is its tick.
fn read_region(channel: &Channel) -> Option<RegionLog> {
    let text = |key: &str| channel.metadata.get(key).cloned();
    let columns: Vec<[String; 3]> = serde_json::from_str(&text("columns")?).ok()?;
    let columns: Vec<LogColumn> = columns
        .into_iter()
        .map(|[name, kind, unit]| {
            let kind = if kind == "u64" { Kind::U64 } else { Kind::F64 };
            LogColumn { name, kind, unit }
        })
        .collect();
    if columns.first()?.name != "tick" {
        return None;
    }
    Some(RegionLog {
        name: text("region")?,
        layout: text("layout").unwrap_or_default(),
        layout_hash: text("layout_hash").unwrap_or_default(),
        compared: text("compared").is_some_and(|v| v == "true"),
        columns,
        ticks: Vec::new(),
        duplicates: 0,
        conflicts: 0,
        malformed: 0,
        words: Vec::new(),
    })
}

fn read_event(data: &[u8]) -> Option<Event> {
    let mut value: serde_json::Value = serde_json::from_slice(data).ok()?;
    Some(Event {
        tick: value.get("tick")?.as_u64()?,
        time_s: value.get("time_s")?.as_f64()?,
        kind: value.get("kind")?.as_str()?.to_owned(),
        detail: value.get_mut("detail")?.take(),
    })
}

/// Header and configuration as they are met.
#[derive(Default)]
struct Head {
    plain: Option<LogHeader>,
    json: Option<LogHeader>,
    configuration: String,
    sources: Vec<Source>,
}

impl Head {
    fn take(&mut self, item: &Item<'_>) {
        match item {
            Item::Metadata(name, map) if *name == METADATA_NAME => {
                self.plain = Some(LogHeader::from_metadata(map));
            }
            Item::Attachment(name, _, _, data) if *name == HEADER_ATTACHMENT => {
                self.json = serde_json::from_slice(data).ok();
            }
            Item::Attachment(name, _, _, data) if *name == CONFIGURATION_ATTACHMENT => {
                self.configuration = String::from_utf8_lossy(data).into_owned();
            }
            Item::Attachment(name, _, _, data) => {
                if let Some(name) = name.strip_prefix(SOURCE_PREFIX) {
                    let text = String::from_utf8_lossy(data).into_owned();
                    self.sources.push(Source { name: name.to_owned(), text });
                }
            }
            Item::Metadata(..) | Item::Message(..) => {}
        }
    }

    fn header(self) -> Option<LogHeader> {
        let mut header = self.json.or(self.plain)?;
        header.configuration = self.configuration;
        header.sources = self.sources;
        Some(header)
    }
}

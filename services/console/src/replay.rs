//! A recorded run, played like a live one: position, speed, pause.

use crate::signals::{Signal, number};
use crate::source::region_named;
use record::LogReader;
use regions::{Kind, RegionId};
use serde_json::{Value, json};
use std::sync::Arc;

/// A log that is being played by one client.
pub(crate) struct Replay {
    log: Arc<LogReader>,
    period_s: f64,
    first: u64,
    last: u64,
    position: f64,
    speed: f64,
    paused: bool,
    /// Name of the run.
    pub(crate) name: String,
}

impl Replay {
    /// From its beginning, at the speed it was.
    pub(crate) fn new(name: String, log: Arc<LogReader>, period_s: f64) -> Self {
        let (first, last) = log.tick_range().unwrap_or((0, 0));
        Replay { log, period_s, first, last, position: first as f64, speed: 1.0, paused: false, name }
    }

    /// Goes on by wall time. [s]
    pub(crate) fn advance(&mut self, elapsed_s: f64) {
        if !self.paused {
            self.position += self.speed * elapsed_s / self.period_s;
        }
        self.position = self.position.clamp(self.first as f64, self.last as f64);
    }

    /// Jumps. [s]
    pub(crate) fn seek(&mut self, to_s: f64) {
        self.position = (to_s / self.period_s).clamp(self.first as f64, self.last as f64);
    }

    /// Sets the speed, 0.05 to 20 times, and pauses or goes on.
    pub(crate) fn play(&mut self, speed: f64, paused: bool) {
        (self.speed, self.paused) = (speed.clamp(0.05, 20.0), paused);
    }

    /// Tick being shown.
    pub(crate) fn tick(&self) -> u64 {
        self.position as u64
    }

    /// Period. [s]
    pub(crate) fn period_s(&self) -> f64 {
        self.period_s
    }

    /// What the page is told.
    pub(crate) fn about(&self) -> Value {
        let s = |tick: u64| tick as f64 * self.period_s;
        json!({"run": self.name, "from_s": s(self.first), "to_s": s(self.last), "at_s": s(self.tick()),
            "speed": self.speed, "paused": self.paused})
    }

    /// Values of signals at each of `ticks`.
    pub(crate) fn rows(&self, signals: &[Signal], ticks: &[u64]) -> Vec<Vec<Value>> {
        signals.iter().map(|signal| ticks.iter().map(|&tick| self.value(signal, tick)).collect()).collect()
    }

    /// Values of signals at the tick shown, or the newest before it.
    pub(crate) fn latest(&self, signals: &[Signal]) -> Vec<Value> {
        signals.iter().map(|signal| self.newest(signal)).collect()
    }

    fn value(&self, signal: &Signal, tick: u64) -> Value {
        let words = self.region(signal).and_then(|region| region.at_tick(tick));
        words.and_then(|words| words.get(signal.word)).map_or(Value::Null, |&word| number(signal.kind, word))
    }

    fn newest(&self, signal: &Signal) -> Value {
        let Some(region) = self.region(signal) else { return Value::Null };
        let row = region.ticks.partition_point(|&tick| tick <= self.tick());
        let Some(row) = row.checked_sub(1) else { return Value::Null };
        region.row(row).get(signal.word).map_or(Value::Null, |&word| number(signal.kind, word))
    }

    /// The region of a signal, if the log's layout is this version's.
    fn region(&self, signal: &Signal) -> Option<&record::RegionLog> {
        let layout = &signal.region.region().layout;
        self.log
            .regions()
            .iter()
            .find(|region| region_named(&region.name) == Some(signal.region))
            .filter(|region| region.columns.len() == layout.words() && fits(region, signal))
    }
}

/// Whether the log means the same by the word: names guard against another version's layout.
fn fits(region: &record::RegionLog, signal: &Signal) -> bool {
    region.columns.get(signal.word).is_some_and(|column| column.kind == signal.kind)
}

/// Period of a log from its own times; 1 ms when it has too few.
pub(crate) fn period_s(log: &LogReader) -> f64 {
    let name = RegionId::RigMeasurement.region().name;
    let Ok(region) = log.region(name) else { return 1e-3 };
    let Ok(column) = region.column_index("time_s") else { return 1e-3 };
    let ends = region.ticks.first().zip(region.ticks.last()).filter(|(a, b)| a < b);
    let Some((first, last)) = ends else { return 1e-3 };
    let time = |row: usize| f64::from_bits(region.row(row)[column]);
    debug_assert!(region.columns[column].kind == Kind::F64);
    (time(region.ticks.len() - 1) - time(0)) / (last - first) as f64
}

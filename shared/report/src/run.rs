//! A log on one tick base: signals of different regions side by side, NaN where a tick is missing.

use record::{LogReader, RegionLog};

/// A run as aligned columns.
pub(crate) struct Run<'a> {
    pub log: &'a LogReader,
    first: u64,
    len: usize,
}

/// Longest run taken as a whole: 24 h at 1 kHz.
const TICKS_MAX: u64 = 100_000_000;

impl<'a> Run<'a> {
    pub fn new(log: &'a LogReader) -> Self {
        // A corrupt tick must not make a table of 2^64 rows.
        let (first, len) = log.tick_range().map_or((0, 0), |(first, last)| {
            (first, if last - first < TICKS_MAX { (last - first + 1) as usize } else { 0 })
        });
        Run { log, first, len }
    }

    /// Number of ticks from the first to the last in the log.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Period. \[s\]
    pub fn period_s(&self) -> f64 {
        self.log.header.period_s()
    }

    /// Start of every tick. \[s\]
    pub fn time_s(&self) -> Vec<f64> {
        (0..self.len as u64).map(|i| self.log.header.time_s(self.first + i)).collect()
    }

    fn rows(region: &RegionLog) -> impl Iterator<Item = (u64, &[u64])> {
        region.ticks.iter().enumerate().map(|(row, &tick)| (tick, region.row(row)))
    }

    /// A column on every tick, NaN where it is missing. None if the log has no such column.
    pub fn numbers(&self, region: &str, column: &str) -> Option<Vec<f64>> {
        let region = self.log.region(region).ok()?;
        let index = region.column_index(column).ok()?;
        let values = region.numbers(index);
        let mut out = vec![f64::NAN; self.len];
        for (&tick, value) in region.ticks.iter().zip(values) {
            if let Some(slot) = out.get_mut((tick - self.first) as usize) {
                *slot = value;
            }
        }
        Some(out)
    }

    /// A column's words on every tick, None where it is missing.
    pub fn words(&self, region: &str, column: &str) -> Option<Vec<Option<u64>>> {
        let region = self.log.region(region).ok()?;
        let index = region.column_index(column).ok()?;
        let mut out = vec![None; self.len];
        for (tick, row) in Self::rows(region) {
            if let Some(slot) = out.get_mut((tick - self.first) as usize) {
                *slot = Some(row[index]);
            }
        }
        Some(out)
    }

    /// The last word of a column.
    pub fn last(&self, region: &str, column: &str) -> Option<u64> {
        let region = self.log.region(region).ok()?;
        let index = region.column_index(column).ok()?;
        region.ticks.len().checked_sub(1).map(|row| region.row(row)[index])
    }

    /// Where the manoeuvre steers and the bench is running: the soft start and stop, whose commands fade, are not
    /// judged. A missing tick is as the one before it.
    pub fn active(&self) -> Option<Vec<bool>> {
        const RUNNING: u64 = 4;
        let states = self.words("rig_status", "state").unwrap_or_default();
        // A log without the rig's status is judged whole.
        let (mut active, mut running) = (false, states.is_empty());
        let words = self.words("vehicle_state", "manoeuvre_active")?;
        Some(
            words
                .into_iter()
                .enumerate()
                .map(|(i, word)| {
                    active = word.map_or(active, |w| w == 1);
                    running = states.get(i).copied().flatten().map_or(running, |state| state == RUNNING);
                    active && running
                })
                .collect(),
        )
    }
}

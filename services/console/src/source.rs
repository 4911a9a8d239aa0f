//! A live bench: its table, read-only, and what its manifest says.

use crate::signals::{Signal, number};
use assembly::manifest::{Drive, Manifest};
use regions::{ALL, RegionId, region_by_name};
use serde_json::{Value, json};
use table::{Bench, Read, RegionReader};

/// One run of a bench, open for reading.
pub(crate) struct Live {
    readers: Vec<Option<RegionReader>>,
    /// The run.
    pub(crate) run_id: u64,
    /// Period. [s]
    pub(crate) period_s: f64,
    /// What the page is told of it.
    pub(crate) about: Value,
    /// Cores that the services are bound to.
    pub(crate) cores: Vec<u16>,
}

impl Live {
    /// Opens the run that the bench's table holds now, if there is one and it is of this version.
    pub(crate) fn open(bench: &Bench) -> Option<Live> {
        let probe = RegionReader::open_any(bench, RegionId::RigStatus.region().name).ok()?;
        let (run_id, period_ns) = (probe.header().run_id(), probe.header().period_ns());
        let readers: Vec<_> = ALL
            .iter()
            .map(|id| {
                let region = id.region();
                let reader = RegionReader::open_any(bench, region.name).ok()?;
                let fits =
                    reader.words() == region.layout.words() && reader.layout().hash == region.layout.hash();
                (region.logged() && fits).then_some(reader)
            })
            .collect();
        // A table that is still being made, or is another version's, is none yet.
        let whole = ALL.iter().zip(&readers).all(|(id, reader)| reader.is_some() || !id.region().logged());
        let manifest = Manifest::read(&bench.directory()).ok().filter(|m| whole && m.run_id == run_id)?;
        let scenario = &manifest.resolved.scenario;
        let on = &scenario.realtime.cores;
        let cores = [on.rig, on.vehicle, on.multibody].into_iter().flatten().collect();
        let about = json!({
            "scenario": scenario.name, "description": scenario.description,
            "duration_s": scenario.duration_s, "lockstep": manifest.drive == Drive::Lockstep,
            "geometry": manifest.resolved.front_axle.geometry,
            "wheelbase_m": manifest.resolved.car.body.wheelbase_m,
        });
        Some(Live { readers, run_id, period_s: period_ns as f64 * 1e-9, about, cores })
    }

    /// Newest tick of the rig, if any.
    pub(crate) fn newest(&self) -> Option<u64> {
        self.readers[RegionId::RigStatus as usize].as_ref()?.head().checked_sub(1)
    }

    /// Whether the supervisor's word is younger than this. [ticks]
    pub(crate) fn supervised(&self, within: u64) -> bool {
        let head = |id: RegionId| self.readers[id as usize].as_ref().map_or(0, RegionReader::head);
        head(RegionId::RigStatus).saturating_sub(head(RegionId::Bench)) < within
    }

    /// Values of signals at each of `ticks`, one row of values a signal; `null` where there is none.
    pub(crate) fn rows(&self, signals: &[Signal], ticks: &[u64]) -> Vec<Vec<Value>> {
        let mut rows = vec![vec![Value::Null; ticks.len()]; signals.len()];
        self.each_region(signals, |reader, wanted, words| {
            for (column, &tick) in ticks.iter().enumerate() {
                if reader.read(tick, words) == Read::Ready {
                    for &(row, signal) in wanted {
                        rows[row][column] = number(signal.kind, words[signal.word]);
                    }
                }
            }
        });
        rows
    }

    /// Newest value of each signal.
    pub(crate) fn latest(&self, signals: &[Signal]) -> Vec<Value> {
        let mut values = vec![Value::Null; signals.len()];
        self.each_region(signals, |reader, wanted, words| {
            if reader.latest(reader.head(), words).is_some() {
                for &(row, signal) in wanted {
                    values[row] = number(signal.kind, words[signal.word]);
                }
            }
        });
        values
    }

    fn each_region(
        &self,
        signals: &[Signal],
        mut look: impl FnMut(&RegionReader, &[(usize, Signal)], &mut [u64]),
    ) {
        for id in ALL {
            let wanted: Vec<_> =
                signals.iter().copied().enumerate().filter(|(_, signal)| signal.region == id).collect();
            if let (Some(reader), false) = (&self.readers[id as usize], wanted.is_empty()) {
                let mut words = vec![0; reader.words()];
                look(reader, &wanted, &mut words);
            }
        }
    }
}

/// Index of a region by name, for logs.
pub(crate) fn region_named(name: &str) -> Option<RegionId> {
    region_by_name(name).map(|(id, _)| id)
}

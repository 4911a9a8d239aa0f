//! One run of a bench, open for reading, whole regions at a time.

use assembly::manifest::Manifest;
use record::LogHeader;
use regions::{ALL, RegionId};
use table::{Bench, Read, RegionReader};

/// One run of a bench.
pub(crate) struct Live {
    /// By [`RegionId`]; regions that are not logged are not served either.
    readers: Vec<Option<RegionReader>>,
    /// What its log says of it: time stamps are the same here and there.
    pub(crate) header: LogHeader,
    /// Cores that the services are bound to.
    pub(crate) cores: Vec<u16>,
}

/// Number of the run that the bench's table holds now.
pub(crate) fn run_id(bench: &Bench) -> Option<u64> {
    Some(RegionReader::open_any(bench, RegionId::RigStatus.region().name).ok()?.header().run_id())
}

impl Live {
    /// Opens the run that is there now, once its clock is known and if it is of this version.
    pub(crate) fn open(bench: &Bench) -> Option<Live> {
        let readers: Vec<_> = ALL
            .iter()
            .map(|id| {
                let region = id.region();
                let reader = RegionReader::open_any(bench, region.name).ok()?;
                let fits = reader.layout().hash == region.layout.hash();
                (region.logged() && fits).then_some(reader)
            })
            .collect();
        if ALL.iter().zip(&readers).any(|(id, reader)| id.region().logged() && reader.is_none()) {
            return None;
        }
        let clock = readers[RegionId::RigStatus as usize].as_ref()?.header();
        let (run_id, t0_ns) = (clock.run_id(), clock.t0_ns()?);
        let manifest = Manifest::read(&bench.directory()).ok().filter(|m| m.run_id == run_id)?;
        let on = &manifest.resolved.scenario.realtime.cores;
        let cores = [on.rig, on.vehicle, on.multibody].into_iter().flatten().collect();
        Some(Live { header: logger::create_header(&manifest, t0_ns), readers, cores })
    }

    /// Newest tick of a region + 1.
    pub(crate) fn head(&self, region: RegionId) -> u64 {
        self.readers[region as usize].as_ref().map_or(0, RegionReader::head)
    }

    /// Puts a tick of a region into `message` as CDR; `false` if that tick is not there (any more).
    pub(crate) fn message(
        &self,
        region: RegionId,
        tick: u64,
        words: &mut Vec<u64>,
        message: &mut Vec<u8>,
    ) -> bool {
        let Some(reader) = &self.readers[region as usize] else { return false };
        words.resize(reader.words(), 0);
        let ready = reader.read(tick, words) == Read::Ready;
        if ready {
            record::writer::put_message(words, message);
        }
        ready
    }
}

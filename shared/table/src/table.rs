//! A table: regions in the order of their specifications.

use crate::TableError;
use crate::bench::{Bench, BenchLock};
use crate::header::MAGIC;
use crate::region::{RegionReader, RegionWriter};
use crate::segment::{Mode, Segment, list_bench, segment_name};
use crate::spec::{RegionSpec, TableInfo};

/// How to make a shared table.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct CreateOptions {
    /// Group that may read the table (mode 0640 instead of 0600).
    pub group: Option<u32>,
}

/// How to open a shared table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OpenOptions {
    /// Touch every page now, so that none faults later. On by default; off for a quick look.
    pub populate: bool,
}

impl Default for OpenOptions {
    fn default() -> Self {
        OpenOptions { populate: true }
    }
}

/// Regions in the order of their specifications.
#[derive(Debug)]
pub struct Table {
    regions: Vec<RegionReader>,
    owner: bool,
}

impl Table {
    /// A table in this process's own memory: lockstep in one process, tests.
    ///
    /// # Errors
    /// [`TableError::Spec`].
    pub fn create_local(specs: &[RegionSpec], info: TableInfo) -> Result<Self, TableError> {
        check(specs, &info)?;
        Ok(Table {
            regions: specs.iter().map(|spec| RegionReader::local(spec, &info)).collect(),
            owner: true,
        })
    }

    /// Makes the bench's segments: zeroed, populated, finished in the order of `specs`. On failure none is left.
    ///
    /// # Errors
    /// [`TableError::LeftOver`] if the bench has any segment already (see [`crate::remove_bench`]);
    /// [`TableError::NoMemory`], [`TableError::Spec`], [`TableError::Os`].
    pub fn create_shared(
        lock: &BenchLock,
        specs: &[RegionSpec],
        info: TableInfo,
        options: &CreateOptions,
    ) -> Result<Self, TableError> {
        check(specs, &info)?;
        let found = list_bench(lock.bench())?;
        if !found.is_empty() {
            let segments = found.iter().map(|f| segment_name(&f.bench, &f.region)).collect();
            return Err(TableError::LeftOver { segments });
        }
        let mut regions = Vec::with_capacity(specs.len());
        for spec in specs {
            match Segment::create(lock, spec, &info, options.group) {
                Ok(segment) => regions.push(RegionReader::shared(lock.bench(), spec.name, segment)),
                Err(error) => {
                    let _ = crate::segment::remove_bench(lock);
                    return Err(error);
                }
            }
        }
        Ok(Table { regions, owner: true })
    }

    /// Opens a bench's table read-only.
    ///
    /// # Errors
    /// [`TableError::LayoutMismatch`] names both layouts; [`TableError::NotFound`], [`TableError::Empty`],
    /// [`TableError::NotReady`], [`TableError::NotATable`], [`TableError::Size`], [`TableError::Permission`].
    pub fn open(bench: &Bench, specs: &[RegionSpec], options: &OpenOptions) -> Result<Self, TableError> {
        Self::map(bench, specs, options, Mode::Read)
    }

    /// Takes over a running bench's table as its new supervisor.
    ///
    /// # Errors
    /// As [`Table::open`].
    pub fn adopt(lock: &BenchLock, specs: &[RegionSpec]) -> Result<Self, TableError> {
        Self::map(lock.bench(), specs, &OpenOptions::default(), Mode::Write)
    }

    fn map(
        bench: &Bench,
        specs: &[RegionSpec],
        options: &OpenOptions,
        mode: Mode,
    ) -> Result<Self, TableError> {
        let regions = specs
            .iter()
            .map(|spec| {
                spec.check()?;
                let segment =
                    Segment::open(bench.name(), spec.name, Some(spec.layout()), mode, options.populate)?;
                Ok(RegionReader::shared(bench, spec.name, segment))
            })
            .collect::<Result<Vec<_>, TableError>>()?;
        Ok(Table { regions, owner: mode == Mode::Write })
    }

    /// Number of regions.
    pub fn len(&self) -> usize {
        self.regions.len()
    }

    /// Whether there is no region.
    pub fn is_empty(&self) -> bool {
        self.regions.is_empty()
    }

    /// All regions, in the order of their specifications.
    pub fn readers(&self) -> &[RegionReader] {
        &self.regions
    }

    /// Region by index.
    ///
    /// # Panics
    /// If there is no such region.
    #[inline]
    pub fn reader(&self, region: usize) -> &RegionReader {
        &self.regions[region]
    }

    /// Index of a region by name.
    pub fn index_of(&self, name: &str) -> Option<usize> {
        self.regions.iter().position(|region| region.name() == name)
    }

    /// Becomes the region's one writer, until the writer is dropped or this process dies. Raises the epoch.
    ///
    /// # Errors
    /// [`TableError::Claimed`] naming the live holder; otherwise as [`Table::open`] and [`Bench::lock`].
    ///
    /// # Panics
    /// If there is no such region.
    pub fn claim_writer(&self, region: usize) -> Result<RegionWriter, TableError> {
        self.regions[region].claim()
    }

    /// Run, period and start, as the first region says.
    pub fn info(&self) -> Option<TableInfo> {
        self.regions.first().map(|region| region.header().info())
    }

    /// Sets the start of tick 0 on `CLOCK_MONOTONIC` \[ns\], in every region, the first one last: whoever sees it there
    /// sees it everywhere. For the process that made or adopted the table; once all regions are claimed and ready.
    ///
    /// # Errors
    /// [`TableError::NotOwner`].
    pub fn set_t0(&self, t0_ns: u64) -> Result<(), TableError> {
        if !self.owner {
            return Err(TableError::NotOwner);
        }
        for region in self.regions.iter().rev() {
            region.set_t0_ns(t0_ns);
        }
        Ok(())
    }
}

impl Table {
    /// Puts right what somebody has spoilt in the headers: everything that stands there from the start. Returns the
    /// regions that were. Those who have them open never look there again; whoever opens them later would be refused.
    /// `specs` and `info`: what the table was made with, `t0_ns` included. For the process that made or adopted it.
    ///
    /// # Errors
    /// [`TableError::NotOwner`].
    pub fn repair(&self, specs: &[RegionSpec], info: &TableInfo) -> Result<Vec<String>, TableError> {
        if !self.owner {
            return Err(TableError::NotOwner);
        }
        let mut repaired = Vec::new();
        for (region, spec) in self.regions.iter().zip(specs) {
            let header = region.header();
            if header.magic() != MAGIC || header.layout() != spec.layout() || header.info() != *info {
                header.fill(spec, info);
                header.finish();
                repaired.push(region.name().to_owned());
            }
        }
        Ok(repaired)
    }
}

fn check(specs: &[RegionSpec], info: &TableInfo) -> Result<(), TableError> {
    for (i, spec) in specs.iter().enumerate() {
        spec.check()?;
        if specs[..i].iter().any(|earlier| earlier.name == spec.name) {
            return Err(TableError::Spec { region: spec.name.to_owned(), rule: "the name occurs twice" });
        }
        if info.period_ns == 0 {
            return Err(TableError::Spec {
                region: spec.name.to_owned(),
                rule: "the period must be at least 1 ns",
            });
        }
    }
    Ok(())
}

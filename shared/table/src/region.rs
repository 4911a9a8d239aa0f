//! One region, wherever its memory is: reading it, writing it, waiting for it.

use crate::TableError;
use crate::bell::{Bell, Wait};
use crate::bench::{Bench, LockFile};
use crate::header::{FIELD_WORDS, Header};
use crate::process::{is_alive, this_process};
use crate::segment::{Mode, Segment, segment_name};
use crate::slot::{Latest, Read, Refused, Ring, ring_words};
use crate::spec::{Layout, RegionSpec, TableInfo};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};

/// Where a region's words are. Both homes reduce to the same slices; nothing above this line differs.
#[derive(Debug)]
#[allow(
    clippy::large_enum_variant,
    reason = "a few of them, each behind an Arc; a box would be one more hop"
)]
enum Home {
    Local { fields: Box<[AtomicU64]>, bell: AtomicU32, ring: Box<[AtomicU64]>, claimed: AtomicBool },
    Shared { segment: Segment, bench: Bench },
}

#[derive(Debug)]
struct Memory {
    name: String,
    words: usize,
    depth: usize,
    home: Home,
}

impl Memory {
    #[inline]
    fn ring(&self) -> Ring<'_> {
        let words = match &self.home {
            Home::Local { ring, .. } => &ring[..],
            Home::Shared { segment, .. } => segment.ring(),
        };
        Ring::new(words, self.words, self.depth)
    }

    #[inline]
    fn header(&self) -> Header<'_> {
        Header::new(match &self.home {
            Home::Local { fields, .. } => fields,
            Home::Shared { segment, .. } => segment.fields(),
        })
    }

    #[inline]
    fn bell(&self) -> Bell<'_> {
        Bell::new(match &self.home {
            Home::Local { bell, .. } => bell,
            Home::Shared { segment, .. } => segment.bell(),
        })
    }
}

fn zeroed(words: usize) -> Box<[AtomicU64]> {
    (0..words).map(|_| AtomicU64::new(0)).collect()
}

/// Reads a region. Cheap to clone; a clone can move to another thread.
#[derive(Debug, Clone)]
pub struct RegionReader {
    memory: Arc<Memory>,
}

impl RegionReader {
    pub(crate) fn local(spec: &RegionSpec, info: &TableInfo) -> Self {
        let home = Home::Local {
            fields: zeroed(FIELD_WORDS),
            bell: AtomicU32::new(0),
            ring: zeroed(ring_words(spec.words, spec.depth)),
            claimed: AtomicBool::new(false),
        };
        let memory = Memory { name: spec.name.to_owned(), words: spec.words, depth: spec.depth, home };
        memory.header().fill(spec, info);
        memory.header().finish();
        RegionReader { memory: Arc::new(memory) }
    }

    pub(crate) fn shared(bench: &Bench, region: &str, segment: Segment) -> Self {
        let (words, depth) = segment.layout_size();
        let home = Home::Shared { segment, bench: bench.clone() };
        RegionReader { memory: Arc::new(Memory { name: region.to_owned(), words, depth, home }) }
    }

    /// Opens a region of any layout, read-only: for browsing a table made by another version, or a left-over one.
    ///
    /// # Errors
    /// As [`crate::Table::open`], but for the layout.
    pub fn open_any(bench: &Bench, region: &str) -> Result<Self, TableError> {
        let segment = Segment::open(bench.name(), region, None, Mode::Read, false)?;
        Ok(Self::shared(bench, region, segment))
    }

    /// Name of the region.
    pub fn name(&self) -> &str {
        &self.memory.name
    }

    /// Payload words.
    #[inline]
    pub fn words(&self) -> usize {
        self.memory.words
    }

    /// Ticks of history.
    #[inline]
    pub fn depth(&self) -> usize {
        self.memory.depth
    }

    /// Version, hash, words and depth.
    pub fn layout(&self) -> Layout {
        self.memory.header().layout()
    }

    /// The live header: run, period, start, epoch, writer.
    pub fn header(&self) -> Header<'_> {
        self.memory.header()
    }

    /// Newest published tick + 1; 0 if none. A head that somebody has spoilt is not believed, see [`Ring::sound_head`].
    #[inline]
    pub fn head(&self) -> u64 {
        self.memory.ring().sound_head()
    }

    /// One bounded attempt to read tick `n` into `out` (exactly [`RegionReader::words`] long). Unless it is
    /// [`Read::Ready`], what is in `out` has no meaning.
    #[inline]
    pub fn read(&self, n: u64, out: &mut [u64]) -> Read {
        self.memory.ring().read(n, out)
    }

    /// Reads the newest published tick; `now` is the caller's own tick, for the age.
    #[inline]
    pub fn latest(&self, now: u64, out: &mut [u64]) -> Option<Latest> {
        self.memory.ring().latest(now, out)
    }

    /// Waits until tick `n` or a later one is published. `false`: the deadline came first.
    pub fn wait_for(&self, n: u64, wait: &Wait) -> bool {
        self.memory.bell().wait(wait, || self.memory.ring().is_published(n))
    }

    /// Waits on this region's bell until `condition` holds (checked after each ring). `false`: the deadline came first.
    pub fn wait_until(&self, wait: &Wait, condition: impl FnMut() -> bool) -> bool {
        self.memory.bell().wait(wait, condition)
    }

    /// Claims the region for writing.
    pub(crate) fn claim(&self) -> Result<RegionWriter, TableError> {
        match &self.memory.home {
            Home::Local { claimed, .. } => {
                if claimed.swap(true, Ordering::AcqRel) {
                    let what = format!("region {} of this process", self.name());
                    return Err(TableError::Claimed { what, holder_pid: Some(std::process::id()) });
                }
                Ok(RegionWriter::new(self.clone(), None))
            }
            Home::Shared { bench, .. } => {
                let lock = bench.lock_region(self.name())?;
                let segment =
                    Segment::open(bench.name(), self.name(), Some(self.layout()), Mode::Write, true)?;
                let writable = RegionReader::shared(bench, self.name(), segment);
                // The lock excludes everybody who looks for it in the same directory. The header excludes the rest.
                if let Some(writer) = writable.header().writer()
                    && is_alive(writer)
                {
                    let what = format!("region {} of bench {}", self.name(), bench.name());
                    return Err(TableError::Claimed { what, holder_pid: Some(writer.pid) });
                }
                Ok(RegionWriter::new(writable, Some(lock)))
            }
        }
    }

    pub(crate) fn set_t0_ns(&self, t0_ns: u64) {
        self.memory.header().set_t0_ns(t0_ns);
    }

    /// Name of what holds the region, for messages.
    pub fn segment_name(&self) -> Option<String> {
        match &self.memory.home {
            Home::Local { .. } => None,
            Home::Shared { bench, .. } => Some(segment_name(bench.name(), self.name())),
        }
    }
}

/// Writes a region; at most one exists, in whatever process. Dropping it releases the claim.
#[derive(Debug)]
pub struct RegionWriter {
    region: RegionReader,
    epoch: u64,
    /// First tick that may be written, by this writer's own count: the shared head is for readers.
    next: u64,
    lock: Option<LockFile>,
}

impl RegionWriter {
    fn new(region: RegionReader, lock: Option<LockFile>) -> Self {
        let next = region.head();
        let epoch = region.header().claim(this_process());
        RegionWriter { region, epoch, next, lock }
    }

    /// How often the region has been claimed, this claim included: 1 for the first writer.
    pub fn epoch(&self) -> u64 {
        self.epoch
    }

    /// The region, for reading.
    pub fn reader(&self) -> &RegionReader {
        &self.region
    }

    /// First tick that may be written: newest published + 1.
    #[inline]
    pub fn head(&self) -> u64 {
        self.next
    }

    /// Stores `payload` (exactly the region's words) as tick `n`, without ringing. Never waits.
    ///
    /// # Errors
    /// [`Refused`] if tick `n` or a later one is published already.
    #[inline]
    pub fn write(&mut self, n: u64, payload: &[u64]) -> Result<(), Refused> {
        assert_eq!(payload.len(), self.region.words(), "payload of {}", self.region.name());
        self.region.memory.ring().write_from(self.next, n, payload)?;
        self.next = n + 1;
        Ok(())
    }

    /// Wakes everybody who waits for this region. One system call.
    #[inline]
    pub fn ring(&mut self) {
        self.region.memory.bell().ring();
    }

    /// [`RegionWriter::write`], then [`RegionWriter::ring`].
    ///
    /// # Errors
    /// As [`RegionWriter::write`].
    #[inline]
    pub fn publish(&mut self, n: u64, payload: &[u64]) -> Result<(), Refused> {
        self.write(n, payload)?;
        self.ring();
        Ok(())
    }

    /// Leaves tick `n` as a writer killed in the middle of writing it does. For tests and fault campaigns.
    ///
    /// # Errors
    /// As [`RegionWriter::write`].
    #[doc(hidden)]
    pub fn write_interrupted(&mut self, n: u64, payload: &[u64]) -> Result<(), Refused> {
        self.region.memory.ring().write_interrupted(n, payload)
    }
}

impl Drop for RegionWriter {
    fn drop(&mut self) {
        // Before the lock goes, so that nobody sees a free lock and a live writer.
        self.region.header().release();
        if let Some(lock) = &self.lock {
            lock.remove_file();
        }
        if let Home::Local { claimed, .. } = &self.region.memory.home {
            claimed.store(false, Ordering::Release);
        }
    }
}

//! The header of a region: 64 words before the ring, on cache lines of their own.
//!
//! Word 0 is the magic, stored last by the maker: a segment without it is not finished. Words 16.. change hands with
//! the writer; the bell lies apart, in word 32, as a 32-bit futex word that is never accessed as part of this slice.

use crate::spec::{Layout, RegionSpec, TableInfo};
use std::sync::atomic::{AtomicU64, Ordering, fence};

/// `KPTABLE1`: a table in this format. Another header or slot format gets another digit.
pub const MAGIC: u64 = u64::from_be_bytes(*b"KPTABLE1");
/// Words before the ring, the bell's cache line included.
pub const HEADER_WORDS: usize = 64;
/// Words of the header that are accessed as 64-bit words.
pub(crate) const FIELD_WORDS: usize = 32;
/// The word in whose place the bell lies.
pub(crate) const BELL_WORD: usize = 32;

const VERSION: usize = 1;
const LAYOUT_HASH: usize = 2;
const WORDS: usize = 3;
const DEPTH: usize = 4;
const RUN_ID: usize = 5;
const PERIOD_NS: usize = 6;
const T0_NS: usize = 8;
const EPOCH: usize = 16;
const WRITER_PID: usize = 17;
const WRITER_START: usize = 18;

/// A process, told apart from later ones with the same number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ProcessId {
    /// Process number.
    pub pid: u32,
    /// Start time as in `/proc/PID/stat`, field 22. \[clock ticks since boot\]
    pub start_ticks: u64,
}

/// The header of a region, live.
#[derive(Debug, Clone, Copy)]
pub struct Header<'a>(&'a [AtomicU64]);

impl<'a> Header<'a> {
    /// Over the first words of a region's memory.
    pub(crate) fn new(fields: &'a [AtomicU64]) -> Self {
        assert_eq!(fields.len(), FIELD_WORDS);
        Header(fields)
    }

    #[inline]
    fn get(&self, word: usize) -> u64 {
        let value = self.0[word].load(Ordering::Relaxed);
        fence(Ordering::Acquire);
        value
    }

    /// First word; [`MAGIC`] in a finished segment.
    pub fn magic(&self) -> u64 {
        self.get(0)
    }

    /// Layout of the region.
    pub fn layout(&self) -> Layout {
        Layout {
            version: self.get(VERSION) as u32,
            hash: self.get(LAYOUT_HASH),
            words: self.get(WORDS),
            depth: self.get(DEPTH),
        }
    }

    /// The run that the table was made for.
    pub fn run_id(&self) -> u64 {
        self.get(RUN_ID)
    }

    /// Period of a tick. \[ns\]
    pub fn period_ns(&self) -> u64 {
        self.get(PERIOD_NS)
    }

    /// Start of tick 0 on `CLOCK_MONOTONIC`, once the supervisor has set it. \[ns\]
    pub fn t0_ns(&self) -> Option<u64> {
        Some(self.get(T0_NS)).filter(|t| *t != 0)
    }

    /// How often the region has been claimed.
    pub fn epoch(&self) -> u64 {
        self.get(EPOCH)
    }

    /// The region's present writer, or its last one if that died; `None` if it was never claimed or was released.
    pub fn writer(&self) -> Option<ProcessId> {
        let pid = self.get(WRITER_PID) as u32;
        (pid != 0).then(|| ProcessId { pid, start_ticks: self.get(WRITER_START) })
    }

    /// Run, period and start.
    pub fn info(&self) -> TableInfo {
        TableInfo { run_id: self.run_id(), period_ns: self.period_ns(), t0_ns: self.get(T0_NS) }
    }

    /// Everything but the magic.
    pub(crate) fn fill(&self, spec: &RegionSpec, info: &TableInfo) {
        let set = |word: usize, value: u64| self.0[word].store(value, Ordering::Relaxed);
        set(VERSION, u64::from(spec.version));
        set(LAYOUT_HASH, spec.layout_hash);
        set(WORDS, spec.words as u64);
        set(DEPTH, spec.depth as u64);
        set(RUN_ID, info.run_id);
        set(PERIOD_NS, info.period_ns);
        set(T0_NS, info.t0_ns);
    }

    /// Declares the segment finished.
    pub(crate) fn finish(&self) {
        self.0[0].store(MAGIC, Ordering::Release);
    }

    pub(crate) fn set_t0_ns(&self, t0_ns: u64) {
        self.0[T0_NS].store(t0_ns, Ordering::Release);
    }

    /// Enters a new writer, under the region's lock. Returns the new epoch.
    pub(crate) fn claim(&self, writer: ProcessId) -> u64 {
        let epoch = self.get(EPOCH) + 1;
        self.0[WRITER_START].store(writer.start_ticks, Ordering::Relaxed);
        self.0[WRITER_PID].store(u64::from(writer.pid), Ordering::Release);
        self.0[EPOCH].store(epoch, Ordering::Release);
        epoch
    }

    /// The writer leaves in order.
    pub(crate) fn release(&self) {
        self.0[WRITER_PID].store(0, Ordering::Release);
    }
}

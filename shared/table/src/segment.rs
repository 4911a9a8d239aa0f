//! Regions in POSIX shared memory, one segment each, named `kingpin.<bench>.<region>`.
//!
//! Home: iceoryx2's `SharedMemoryBuilder`, pinned. Not used of it: `zero_memory` (fresh shared memory is zero by
//! POSIX; the option replaces this process's handlers of all catchable signals, SIGINT and SIGTERM included, and
//! turns them into a flag of its own), and ownership (a dropped old owner would unlink a newer segment).
//! Memory is claimed by populating instead, which reports a full `/dev/shm` as an error, not as SIGBUS.
//!
//! A segment is exactly as large as its layout needs, and that is checked against the mapping before any word but
//! the header is touched. Shrinking a live segment from outside still is SIGBUS; only its owner can do that.

// Turning the mapping into slices of atomics, and `madvise` on it, cannot be said safely.
#![allow(unsafe_code)]

use crate::TableError;
use crate::bench::{Bench, BenchLock};
use crate::header::{BELL_WORD, FIELD_WORDS, HEADER_WORDS, Header, MAGIC};
use crate::process::is_alive;
use crate::slot::ring_words;
use crate::spec::{BenchName, Layout, RegionSpec, TableInfo};
use iceoryx2_bb_posix::file_descriptor::FileDescriptorManagement;
use iceoryx2_bb_posix::memory_mapping::{MemoryMappingCreationError, SemanticString};
use iceoryx2_bb_posix::shared_memory::{
    AccessMode, CreationMode, Permission, SharedMemory, SharedMemoryBuilder, SharedMemoryCreationError,
};
use iceoryx2_bb_system_types::file_name::FileName;
use rustix::mm::Advice;
use std::sync::atomic::{AtomicU32, AtomicU64};

// Links the (silent) logger that iceoryx2's lower crates want.
extern crate iceoryx2_bb_loggers;

const DIRECTORY: &str = "/dev/shm";
const PREFIX: &str = "kingpin";

/// Name of a region's segment.
pub fn segment_name(bench: &BenchName, region: &str) -> String {
    format!("{PREFIX}.{bench}.{region}")
}

/// Bytes of a segment with that layout; `None` if no such layout is possible.
pub(crate) fn segment_bytes(layout: &Layout) -> Option<u64> {
    let ring = layout.words.checked_add(1)?.checked_mul(layout.depth)?.checked_add(1)?;
    ring.checked_add(HEADER_WORDS as u64)?.checked_mul(8)
}

/// How a mapping is used.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Mode {
    Read,
    Write,
}

/// One mapped segment of a checked size.
#[derive(Debug)]
pub(crate) struct Segment {
    memory: SharedMemory,
    words: usize,
    depth: usize,
}

// SAFETY: the mapping stays where it is until drop, and is accessed through atomics only; `SharedMemory` itself is
// touched only in making and dropping.
unsafe impl Send for Segment {}
// SAFETY: as above.
unsafe impl Sync for Segment {}

impl Segment {
    /// Makes a region's segment, zeroed, populated, with its header filled and the magic stored last.
    /// On failure nothing is left behind.
    pub(crate) fn create(
        lock: &BenchLock,
        spec: &RegionSpec,
        info: &TableInfo,
        group: Option<u32>,
    ) -> Result<Self, TableError> {
        let name = segment_name(lock.bench().name(), spec.name);
        let file = file_name(&name)?;
        let bytes = segment_bytes(&spec.layout()).unwrap_or(u64::MAX);
        let no_memory = || TableError::NoMemory { segment: name.clone(), bytes };
        let created = SharedMemoryBuilder::new(&file)
            .creation_mode(CreationMode::CreateExclusive)
            .permission(Permission::OWNER_READ_WRITE)
            .zero_memory(false)
            .has_ownership(false)
            .size(usize::try_from(bytes).map_err(|_| no_memory())?)
            .create();
        let memory = match created {
            Ok(memory) => memory,
            Err(SharedMemoryCreationError::AlreadyExist) => {
                return Err(TableError::LeftOver { segments: vec![name] });
            }
            Err(error) => {
                // May have come as far as making the file; it is ours, since it did not exist before.
                let _ = SharedMemory::remove(&file);
                return Err(creation_error(&name, bytes, error));
            }
        };
        let mut segment = Segment { memory, words: spec.words, depth: spec.depth };
        match segment.prepare(&name, spec, info, group) {
            Ok(()) => Ok(segment),
            Err(error) => {
                let _ = SharedMemory::remove(&file);
                Err(error)
            }
        }
    }

    fn prepare(
        &mut self,
        name: &str,
        spec: &RegionSpec,
        info: &TableInfo,
        group: Option<u32>,
    ) -> Result<(), TableError> {
        let os = |what: &str, cause: &dyn std::fmt::Debug| TableError::Os {
            what: format!("{what} of segment {name}"),
            cause: format!("{cause:?}"),
        };
        let mut permission = Permission::OWNER_READ_WRITE;
        if let Some(gid) = group {
            let path = format!("{DIRECTORY}/{name}");
            let gid = rustix::fs::Gid::from_raw(gid);
            rustix::fs::chown(path, None, Some(gid)).map_err(|e| os("group", &e))?;
            permission |= Permission::GROUP_READ;
        }
        // Said again, because the mode at creation is subject to the umask.
        self.memory.set_permission(permission).map_err(|e| os("mode", &e))?;
        if self.memory.size() as u64 != segment_bytes(&spec.layout()).unwrap_or(0) {
            return Err(os("size", &self.memory.size()));
        }
        self.populate(name, Mode::Write)?;
        let header = Header::new(self.fields());
        header.fill(spec, info);
        header.finish();
        Ok(())
    }

    /// Maps an existing segment. `expected`: the layout it must have; `None` takes the segment's word for it.
    pub(crate) fn open(
        bench: &BenchName,
        region: &str,
        expected: Option<Layout>,
        mode: Mode,
        populate: bool,
    ) -> Result<Self, TableError> {
        let name = segment_name(bench, region);
        regular_file(&name)?;
        let access = match mode {
            Mode::Read => AccessMode::Read,
            Mode::Write => AccessMode::ReadWrite,
        };
        let memory = SharedMemoryBuilder::new(&file_name(&name)?)
            .open_existing(access)
            .map_err(|error| creation_error(&name, 0, error))?;
        let found_bytes = memory.size() as u64;
        if found_bytes < (HEADER_WORDS * 8) as u64 {
            let expected_bytes =
                expected.and_then(|l| segment_bytes(&l)).unwrap_or((HEADER_WORDS * 8) as u64);
            return Err(TableError::Size { segment: name, found_bytes, expected_bytes });
        }
        let mut segment = Segment { memory, words: 0, depth: 0 };
        let header = Header::new(segment.fields());
        match header.magic() {
            MAGIC => {}
            0 => return Err(TableError::NotReady { segment: name }),
            magic => return Err(TableError::NotATable { segment: name, magic }),
        }
        let found = header.layout();
        if let Some(expected) = expected
            && found != expected
        {
            return Err(TableError::LayoutMismatch { segment: name, found, expected });
        }
        let expected_bytes = segment_bytes(&found).unwrap_or(u64::MAX);
        if found_bytes != expected_bytes
            || !found.depth.is_power_of_two()
            || found.depth < 2
            || found.words == 0
        {
            return Err(TableError::Size { segment: name, found_bytes, expected_bytes });
        }
        segment.words = found.words as usize;
        segment.depth = found.depth as usize;
        if populate {
            segment.populate(&name, mode)?;
        }
        Ok(segment)
    }

    /// Touches every page now, so that none faults on the hot path.
    fn populate(&self, name: &str, mode: Mode) -> Result<(), TableError> {
        let advice = match mode {
            Mode::Read => Advice::LinuxPopulateRead,
            Mode::Write => Advice::LinuxPopulateWrite,
        };
        let bytes = self.memory.size();
        // SAFETY: the range is exactly this live mapping, and populating changes no contents.
        match unsafe { rustix::mm::madvise(self.memory.base_address().as_ptr().cast(), bytes, advice) } {
            Ok(()) => Ok(()),
            // EFAULT is what would have been a SIGBUS: the file system is full.
            Err(rustix::io::Errno::FAULT | rustix::io::Errno::NOMEM) => {
                Err(TableError::NoMemory { segment: name.to_owned(), bytes: bytes as u64 })
            }
            Err(error) => {
                Err(TableError::Os { what: format!("populating segment {name}"), cause: error.to_string() })
            }
        }
    }

    pub(crate) fn layout_size(&self) -> (usize, usize) {
        (self.words, self.depth)
    }

    pub(crate) fn fields(&self) -> &[AtomicU64] {
        // SAFETY: every mapping has at least HEADER_WORDS words (made so, or checked in `open`), is page-aligned and
        // lives as long as self. Other processes access it through atomics only. On read-only mappings only loads
        // are made: the crate's writing types exist for writable mappings only.
        unsafe { std::slice::from_raw_parts(self.memory.base_address().as_ptr().cast(), FIELD_WORDS) }
    }

    pub(crate) fn bell(&self) -> &AtomicU32 {
        // SAFETY: inside the header, past the field words, so no 64-bit atomic overlaps it; otherwise as in `fields`.
        unsafe { &*self.memory.base_address().as_ptr().cast::<u64>().add(BELL_WORD).cast::<AtomicU32>() }
    }

    pub(crate) fn ring(&self) -> &[AtomicU64] {
        // SAFETY: the size of the mapping was checked against words and depth; otherwise as in `fields`.
        unsafe {
            std::slice::from_raw_parts(
                self.memory.base_address().as_ptr().cast::<AtomicU64>().add(HEADER_WORDS),
                ring_words(self.words, self.depth),
            )
        }
    }
}

/// Refuses what `shm_open` must not be let near: it waits for a writer on a FIFO, for ever.
fn regular_file(name: &str) -> Result<(), TableError> {
    match std::fs::symlink_metadata(format!("{DIRECTORY}/{name}")) {
        Ok(data) if data.is_file() => Ok(()),
        Ok(_) => {
            Err(TableError::Os { what: format!("segment {name}"), cause: "is not a regular file".to_owned() })
        }
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => {
            Err(TableError::NotFound { segment: name.to_owned() })
        }
        Err(e) => Err(TableError::Os { what: format!("segment {name}"), cause: e.to_string() }),
    }
}

fn file_name(name: &str) -> Result<FileName, TableError> {
    FileName::new(name.as_bytes())
        .map_err(|e| TableError::Os { what: format!("segment name {name}"), cause: format!("{e:?}") })
}

fn creation_error(name: &str, bytes: u64, error: SharedMemoryCreationError) -> TableError {
    use SharedMemoryCreationError as E;
    let segment = name.to_owned();
    match error {
        E::DoesNotExist => TableError::NotFound { segment },
        E::InsufficientPermissions => TableError::Permission { what: format!("segment {name}") },
        E::MemoryMappingCreationError(MemoryMappingCreationError::InsufficientPermissions) => {
            TableError::Permission { what: format!("segment {name}") }
        }
        E::MemoryMappingCreationError(MemoryMappingCreationError::MappingSizeIsZero) => {
            TableError::Empty { segment }
        }
        E::InsufficientMemory | E::SizeDoesNotFit | E::FileTruncateError(_) => {
            TableError::NoMemory { segment, bytes }
        }
        E::MemoryMappingCreationError(MemoryMappingCreationError::InsufficientResources) => {
            TableError::NoMemory { segment, bytes }
        }
        other => TableError::Os { what: format!("segment {name}"), cause: format!("{other:?}") },
    }
}

/// A segment as found in `/dev/shm`, whatever is in it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Found {
    /// Bench it belongs to.
    pub bench: BenchName,
    /// Region.
    pub region: String,
    /// Size. \[byte\]
    pub bytes: u64,
}

/// Every segment in shared memory that is named as ours are, sorted by bench and region.
///
/// # Errors
/// [`TableError::Os`] if `/dev/shm` cannot be listed.
pub fn list_segments() -> Result<Vec<Found>, TableError> {
    let os =
        |e: std::io::Error| TableError::Os { what: format!("listing {DIRECTORY}"), cause: e.to_string() };
    let mut all = Vec::new();
    for entry in std::fs::read_dir(DIRECTORY).map_err(os)? {
        let Ok(entry) = entry else { continue };
        let name = entry.file_name();
        let Some((PREFIX, rest)) = name.to_str().and_then(|n| n.split_once('.')) else { continue };
        let Some((bench, region)) = rest.split_once('.') else { continue };
        // Gone in between: then it is not there.
        let (Ok(bench), Ok(data)) = (BenchName::new(bench), entry.metadata()) else { continue };
        all.push(Found { bench, region: region.to_owned(), bytes: data.len() });
    }
    all.sort_by(|a, b| (&a.bench, &a.region).cmp(&(&b.bench, &b.region)));
    Ok(all)
}

/// The segments of one bench: in use, or left over.
///
/// # Errors
/// As [`list_segments`].
pub fn list_bench(bench: &Bench) -> Result<Vec<Found>, TableError> {
    Ok(list_segments()?.into_iter().filter(|found| &found.bench == bench.name()).collect())
}

/// Names of all benches with segments, live or left over.
///
/// # Errors
/// As [`list_segments`].
pub fn list_benches() -> Result<Vec<BenchName>, TableError> {
    let mut names: Vec<_> = list_segments()?.into_iter().map(|found| found.bench).collect();
    names.dedup();
    Ok(names)
}

/// A region of the bench that a live process other than this one writes, and that process.
///
/// # Errors
/// As [`list_segments`].
pub fn writers_alive(bench: &Bench) -> Result<Option<(String, u32)>, TableError> {
    for found in list_bench(bench)? {
        // A segment that cannot be opened has no writer.
        if let Ok(segment) = Segment::open(&found.bench, &found.region, None, Mode::Read, false)
            && let Some(writer) = Header::new(segment.fields()).writer()
            && writer.pid != std::process::id()
            && is_alive(writer)
        {
            return Ok(Some((found.region, writer.pid)));
        }
    }
    Ok(None)
}

/// Removes every segment of the bench, whatever its layout, and the locks of its regions. Mappings that exist stay
/// valid. Returns the number of segments.
///
/// # Errors
/// [`TableError::Claimed`] if another live process still writes a region (a supervisor with another lock directory
/// could be running this bench): nothing is removed then. [`TableError::Permission`] or [`TableError::Os`]: the
/// remaining segments are removed nevertheless.
pub fn remove_bench(lock: &BenchLock) -> Result<usize, TableError> {
    let mut removed = 0;
    let mut first_error = None;
    let all = list_bench(lock.bench())?;
    if let Some((region, pid)) = writers_alive(lock.bench())? {
        let what = format!("region {region} of bench {}", lock.bench().name());
        return Err(TableError::Claimed { what, holder_pid: Some(pid) });
    }
    for found in all {
        let name = segment_name(&found.bench, &found.region);
        match file_name(&name).and_then(|file| {
            SharedMemory::remove(&file).map_err(|e| match e {
                iceoryx2_bb_posix::shared_memory::SharedMemoryRemoveError::InsufficientPermissions => {
                    TableError::Permission { what: format!("removing segment {name}") }
                }
                other => {
                    TableError::Os { what: format!("removing segment {name}"), cause: format!("{other:?}") }
                }
            })
        }) {
            Ok(was_there) => removed += usize::from(was_there),
            Err(error) => first_error = first_error.or(Some(error)),
        }
    }
    lock.bench().remove_region_locks();
    first_error.map_or(Ok(removed), Err)
}

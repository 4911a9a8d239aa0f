//! What can go wrong in making, opening, claiming and removing a table. Nothing on the hot path is here.

use crate::spec::Layout;
use std::path::PathBuf;

/// Errors of the table. Each names the segment or file, and both sides where two disagree.
#[derive(Debug)]
#[non_exhaustive]
pub enum TableError {
    /// A bench name that does not match `[a-z0-9_-]{1,40}`.
    BenchName {
        /// The name (its first 80 characters).
        name: String,
    },
    /// An impossible region specification.
    Spec {
        /// The region.
        region: String,
        /// The rule that it breaks.
        rule: &'static str,
    },
    /// No such segment.
    NotFound {
        /// Segment name.
        segment: String,
    },
    /// The bench has segments already: left over from a crash, or in use.
    LeftOver {
        /// Segment names.
        segments: Vec<String>,
    },
    /// A segment of size zero: its maker died before giving it a size, or is at it now.
    Empty {
        /// Segment name.
        segment: String,
    },
    /// The maker has not finished the segment, or died before it had.
    NotReady {
        /// Segment name.
        segment: String,
    },
    /// Not a segment of a table, or of an incompatible table format.
    NotATable {
        /// Segment name.
        segment: String,
        /// Its first word.
        magic: u64,
    },
    /// The segment has another size than its layout needs.
    Size {
        /// Segment name.
        segment: String,
        /// Size of the segment. \[byte\]
        found_bytes: u64,
        /// Size that the layout needs. \[byte\]
        expected_bytes: u64,
    },
    /// The segment was made with another layout.
    LayoutMismatch {
        /// Segment name.
        segment: String,
        /// The segment's layout.
        found: Layout,
        /// This program's layout.
        expected: Layout,
    },
    /// Not permitted to this user.
    Permission {
        /// Segment or file.
        what: String,
    },
    /// Not enough shared memory.
    NoMemory {
        /// Segment name.
        segment: String,
        /// Bytes wanted.
        bytes: u64,
    },
    /// Another live process holds the region or the bench.
    Claimed {
        /// What is held: `region NAME of bench NAME` or `bench NAME`.
        what: String,
        /// Its holder, if it can be told.
        holder_pid: Option<u32>,
    },
    /// A lock directory that is not ours alone.
    UnsafeDirectory {
        /// The directory.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// The table was not made or adopted by this process.
    NotOwner,
    /// Any other failure of the operating system.
    Os {
        /// What was tried.
        what: String,
        /// The system's answer.
        cause: String,
    },
}

impl std::fmt::Display for TableError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::BenchName { name } => write!(f, "bench name {name:?}: must match [a-z0-9_-]{{1,40}}"),
            Self::Spec { region, rule } => write!(f, "region {region:?}: {rule}"),
            Self::NotFound { segment } => write!(f, "no shared-memory segment {segment}"),
            Self::LeftOver { segments } => {
                write!(f, "the bench has {} segments already: {}", segments.len(), segments.join(", "))
            }
            Self::Empty { segment } => {
                write!(f, "segment {segment} has size zero: its maker died or is at it now")
            }
            Self::NotReady { segment } => {
                write!(f, "segment {segment} is not finished: its maker died or is at it now")
            }
            Self::NotATable { segment, magic } => {
                write!(f, "segment {segment} is not a table of this format (first word {magic:016x})")
            }
            Self::Size { segment, found_bytes, expected_bytes } => {
                write!(f, "segment {segment} has {found_bytes} bytes, its layout needs {expected_bytes}")
            }
            Self::LayoutMismatch { segment, found, expected } => {
                write!(
                    f,
                    "segment {segment} has another layout: it has {found}; this program expects {expected}"
                )
            }
            Self::Permission { what } => write!(f, "{what}: not permitted to this user"),
            Self::NoMemory { segment, bytes } => {
                write!(f, "segment {segment}: not enough shared memory for {bytes} bytes (see df /dev/shm)")
            }
            Self::Claimed { what, holder_pid: Some(pid) } => write!(f, "{what} is held by process {pid}"),
            Self::Claimed { what, holder_pid: None } => write!(f, "{what} is held by another process"),
            Self::UnsafeDirectory { path, reason } => {
                write!(f, "lock directory {}: {reason}", path.display())
            }
            Self::NotOwner => write!(f, "this process did not make or adopt the table"),
            Self::Os { what, cause } => write!(f, "{what}: {cause}"),
        }
    }
}

impl std::error::Error for TableError {}

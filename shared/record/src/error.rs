//! What can go wrong with a log as a whole. Faults inside a log are data, not errors.

use std::fmt;
use std::path::{Path, PathBuf};

/// Why a log could not be made, opened or exported.
#[derive(Debug)]
pub enum LogError {
    /// The system refused an operation on a file.
    Io {
        /// The file.
        path: PathBuf,
        /// What was tried.
        action: &'static str,
        /// What the system said.
        source: std::io::Error,
    },
    /// The path is a directory, pipe, device or socket where a log file is needed.
    NotRegularFile(PathBuf),
    /// A log is never overwritten.
    Exists(PathBuf),
    /// The file is not an MCAP file, or nothing of it can be read.
    NotALog {
        /// The file.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// The directory holds no `log.mcap`.
    NoLogIn(PathBuf),
    /// Files of one directory are not of one run.
    DifferentRuns {
        /// The file that does not belong.
        path: PathBuf,
        /// Run of the first file.
        expected: u64,
        /// Run of this file.
        found: u64,
    },
    /// A name asked for is not in the log.
    UnknownSignal {
        /// What was asked for.
        name: String,
        /// Names that come close.
        known: Vec<String>,
    },
    /// The output could not be written.
    Output(String),
}

impl LogError {
    pub(crate) fn io(path: &Path, action: &'static str, source: std::io::Error) -> Self {
        LogError::Io { path: path.to_owned(), action, source }
    }
}

impl fmt::Display for LogError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            LogError::Io { path, action, source } => {
                write!(f, "{}: cannot {action}: {source}", path.display())
            }
            LogError::NotRegularFile(path) => write!(f, "{}: not a regular file", path.display()),
            LogError::Exists(path) => {
                write!(f, "{}: exists already; a log is never overwritten", path.display())
            }
            LogError::NotALog { path, reason } => {
                write!(f, "{}: not a readable log: {reason}", path.display())
            }
            LogError::NoLogIn(path) => write!(f, "{}: no log.mcap in this directory", path.display()),
            LogError::DifferentRuns { path, expected, found } => write!(
                f,
                "{}: is of run {found:016x}, but the first file of this directory is of run {expected:016x}",
                path.display()
            ),
            LogError::UnknownSignal { name, known } if known.is_empty() => {
                write!(f, "{name}: no such signal in the log")
            }
            LogError::UnknownSignal { name, known } => {
                write!(f, "{name}: no such signal in the log; did you mean {}?", known.join(", "))
            }
            LogError::Output(reason) => write!(f, "cannot write: {reason}"),
        }
    }
}

impl std::error::Error for LogError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            LogError::Io { source, .. } => Some(source),
            _ => None,
        }
    }
}

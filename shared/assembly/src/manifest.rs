//! What a service is told when it is started: one file in the bench's directory, written by the supervisor.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The file's name.
const FILE: &str = "manifest.json";

/// How a run is driven.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Drive {
    /// By the wall clock.
    Paced,
    /// Tick by tick, as fast as it goes.
    Lockstep,
}

/// What a service is told when it is started.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct Manifest {
    /// Name of the bench.
    pub bench: String,
    /// Number of the run.
    pub run_id: u64,
    /// How the run is driven.
    pub drive: Drive,
    /// Where the run's files go.
    pub directory: PathBuf,
    /// Wall clock when the run was made, Unix time. [ns]
    pub wall_start_ns: u64,
    /// Monotonic clock at the same instant. [ns]
    pub monotonic_start_ns: u64,
    /// Whether the services obey the orders of a fault campaign.
    pub faults: bool,
    /// Versions for the log's header.
    pub versions: BTreeMap<String, String>,
    /// Resolved configuration.
    pub resolved: config::ResolvedBench,
}

/// Why a manifest could not be read or written.
#[derive(Debug)]
pub enum ManifestError {
    /// The file system refused.
    Io(PathBuf, std::io::Error),
    /// Not one of this version.
    Format(PathBuf, serde_json::Error),
}

impl std::fmt::Display for ManifestError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            ManifestError::Io(path, error) => write!(f, "{}: {error}", path.display()),
            ManifestError::Format(path, error) => write!(f, "{}: not a manifest: {error}", path.display()),
        }
    }
}

impl std::error::Error for ManifestError {}

impl Manifest {
    /// Writes the manifest into the bench's directory, whole or not at all.
    ///
    /// # Errors
    /// [`ManifestError`].
    pub fn write(&self, directory: &Path) -> Result<(), ManifestError> {
        let path = directory.join(FILE);
        let text = serde_json::to_vec(self).map_err(|e| ManifestError::Format(path.clone(), e))?;
        let draft = directory.join(".manifest.tmp");
        std::fs::write(&draft, text)
            .and_then(|()| std::fs::rename(&draft, &path))
            .map_err(|e| ManifestError::Io(path, e))
    }

    /// Reads the manifest of the bench's directory.
    ///
    /// # Errors
    /// [`ManifestError`].
    pub fn read(directory: &Path) -> Result<Self, ManifestError> {
        let path = directory.join(FILE);
        let text = std::fs::read(&path).map_err(|e| ManifestError::Io(path.clone(), e))?;
        serde_json::from_slice(&text).map_err(|e| ManifestError::Format(path, e))
    }

    /// Removes it at the end of a run, with what services kept beside it for their restarts.
    pub fn remove(directory: &Path) {
        let _ = std::fs::remove_file(directory.join(FILE));
        for entry in std::fs::read_dir(directory).into_iter().flatten().flatten() {
            if entry.file_name().to_string_lossy().starts_with(crate::kinematics::CACHE_PREFIX) {
                // An unpacked FMU is a folder.
                let _ = std::fs::remove_file(entry.path()).or_else(|_| std::fs::remove_dir_all(entry.path()));
            }
        }
    }
}

//! A bench by its name, and the locks that say who runs it and who writes which region.
//!
//! One lock file per region and one for the bench, in `<base>/<bench>/`, mode 0700, where `<base>` is the argument,
//! or `$KINGPIN_RUNTIME_DIR`, or `$XDG_RUNTIME_DIR/kingpin`, or `/tmp/kingpin-<uid>`. The kernel frees a lock when its
//! holder dies, however it dies. A lock file is removed only by who holds it, and who gets a lock looks whether the file
//! is still the one at its path: who had waited for a removed one starts anew, so that there are never two holders.

use crate::TableError;
use crate::header::ProcessId;
use crate::process::{is_alive, this_process};
use crate::spec::BenchName;
use std::fs::{DirBuilder, File, OpenOptions, TryLockError};
use std::io::{Read, Seek, Write};
use std::os::unix::fs::{DirBuilderExt, MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

/// A bench's name and the directory of its locks.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Bench {
    name: BenchName,
    base: PathBuf,
}

impl Bench {
    /// With the lock directory that the environment gives.
    ///
    /// # Errors
    /// [`TableError::BenchName`].
    pub fn new(name: &str) -> Result<Self, TableError> {
        Self::with_base(name, base_from_environment())
    }

    /// With a given base directory for the locks.
    ///
    /// # Errors
    /// [`TableError::BenchName`].
    pub fn with_base(name: &str, base: impl Into<PathBuf>) -> Result<Self, TableError> {
        Ok(Bench { name: BenchName::new(name)?, base: base.into() })
    }

    /// The name.
    pub fn name(&self) -> &BenchName {
        &self.name
    }

    /// Base directory of the locks; give it to child processes as `KINGPIN_RUNTIME_DIR`.
    pub fn base(&self) -> &Path {
        &self.base
    }

    /// This bench's own directory (locks; free for small run-time files of the bench). Made when first locked.
    pub fn directory(&self) -> PathBuf {
        self.base.join(self.name.as_str())
    }

    /// Becomes the bench's one supervisor, until the lock is dropped or this process dies.
    ///
    /// # Errors
    /// [`TableError::Claimed`] naming the holder; [`TableError::UnsafeDirectory`]; [`TableError::Os`].
    pub fn lock(&self) -> Result<BenchLock, TableError> {
        let file = LockFile::take(self, "bench.lock", || format!("bench {}", self.name))?;
        Ok(BenchLock { bench: self.clone(), file })
    }

    /// The process that supervises the bench now, if any. Writes nothing.
    ///
    /// # Errors
    /// [`TableError::Permission`], [`TableError::Os`].
    pub fn supervisor_pid(&self) -> Result<Option<u32>, TableError> {
        let path = self.directory().join("bench.lock");
        let mut file = match File::open(&path) {
            Ok(file) => file,
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            Err(e) => return Err(file_error(&path, &e)),
        };
        // The lock is tried only if the last holder still lives: trying it holds it for a moment, and a supervisor that
        // starts just then would be refused.
        let Some(holder) = read_holder(&mut file).filter(|holder| is_alive(*holder)) else { return Ok(None) };
        match file.try_lock_shared() {
            Ok(()) => Ok(None),
            Err(TryLockError::WouldBlock) => Ok(Some(holder.pid)),
            Err(TryLockError::Error(e)) => Err(file_error(&path, &e)),
        }
    }

    pub(crate) fn lock_region(&self, region: &str) -> Result<LockFile, TableError> {
        LockFile::take(self, &format!("region.{region}.lock"), || {
            format!("region {region} of bench {}", self.name)
        })
    }

    /// Removes the lock files of regions that nobody writes any more.
    pub(crate) fn remove_region_locks(&self) {
        let entries = std::fs::read_dir(self.directory()).into_iter().flatten().flatten();
        for name in entries.filter_map(|entry| entry.file_name().into_string().ok()) {
            if let Some(region) = name.strip_prefix("region.").and_then(|name| name.strip_suffix(".lock"))
                && let Ok(held) = self.lock_region(region)
            {
                held.remove_file();
            }
        }
    }
}

/// Base directory of the locks as the environment gives it.
pub fn base_from_environment() -> PathBuf {
    let set = |key: &str| std::env::var_os(key).filter(|v| !v.is_empty()).map(PathBuf::from);
    set("KINGPIN_RUNTIME_DIR")
        .or_else(|| set("XDG_RUNTIME_DIR").map(|dir| dir.join("kingpin")))
        .unwrap_or_else(|| PathBuf::from(format!("/tmp/kingpin-{}", rustix::process::geteuid().as_raw())))
}

/// Held by a bench's one supervisor: the right to make and remove its segments.
#[derive(Debug)]
pub struct BenchLock {
    bench: Bench,
    file: LockFile,
}

impl Drop for BenchLock {
    /// Leaves no file behind; the directory goes if nothing is in it.
    fn drop(&mut self) {
        self.file.remove_file();
        let _ = std::fs::remove_dir(self.bench.directory());
    }
}

impl BenchLock {
    /// The bench that is locked.
    pub fn bench(&self) -> &Bench {
        &self.bench
    }
}

/// A held lock file; freed on drop or death.
#[derive(Debug)]
pub(crate) struct LockFile {
    file: File,
    path: PathBuf,
}

/// How often a lock file that its last holder removed in between is made anew.
const LOCK_ATTEMPTS: usize = 100;

impl LockFile {
    fn take(bench: &Bench, file_name: &str, what: impl Fn() -> String) -> Result<Self, TableError> {
        let path = bench.directory().join(file_name);
        for _ in 0..LOCK_ATTEMPTS {
            private_directory(&bench.base)?;
            private_directory(&bench.directory())?;
            if let Some(held) = Self::attempt(&path, &what)? {
                return Ok(held);
            }
        }
        let cause = format!("removed by others {LOCK_ATTEMPTS} times while it was taken");
        Err(TableError::Os { what: format!("lock file {}", path.display()), cause })
    }

    /// `None`: the last holder removed the file, or its directory, meanwhile.
    fn attempt(path: &Path, what: impl Fn() -> String) -> Result<Option<Self>, TableError> {
        let os = |e: std::io::Error| match e.kind() {
            std::io::ErrorKind::PermissionDenied => {
                TableError::Permission { what: path.display().to_string() }
            }
            _ => TableError::Os { what: format!("lock file {}", path.display()), cause: e.to_string() },
        };
        let opened = OpenOptions::new()
            .read(true)
            .write(true)
            .create(true)
            .truncate(false)
            .mode(0o600)
            .custom_flags(rustix::fs::OFlags::NOFOLLOW.bits() as i32)
            .open(path);
        let mut file = match opened {
            Ok(file) => file,
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            Err(e) => return Err(os(e)),
        };
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                let holder_pid = read_holder(&mut file).map(|holder| holder.pid);
                return Err(TableError::Claimed { what: what(), holder_pid });
            }
            Err(TryLockError::Error(e)) => return Err(os(e)),
        }
        if !is_at(&file, path) {
            return Ok(None);
        }
        let id = this_process();
        file.set_len(0).map_err(os)?;
        file.rewind().map_err(os)?;
        writeln!(file, "{} {}", id.pid, id.start_ticks).map_err(os)?;
        Ok(Some(LockFile { file, path: path.to_owned() }))
    }

    /// Removes the file; the lock is held until it is dropped. Another file that somebody has put in its place stays.
    pub(crate) fn remove_file(&self) {
        if is_at(&self.file, &self.path) {
            let _ = std::fs::remove_file(&self.path);
        }
    }
}

/// Whether an open file is the one at that path.
fn is_at(file: &File, path: &Path) -> bool {
    let (Ok(open), Ok(there)) = (file.metadata(), std::fs::symlink_metadata(path)) else { return false };
    (open.dev(), open.ino()) == (there.dev(), there.ino())
}

/// What the holder of a lock wrote into it; nothing if it has just locked and not yet written.
fn read_holder(file: &mut File) -> Option<ProcessId> {
    let mut text = String::new();
    file.take(64).read_to_string(&mut text).ok()?;
    let mut fields = text.split_ascii_whitespace();
    let pid = fields.next()?.parse().ok()?;
    Some(ProcessId { pid, start_ticks: fields.next()?.parse().ok()? })
}

fn file_error(path: &Path, error: &std::io::Error) -> TableError {
    match error.kind() {
        std::io::ErrorKind::PermissionDenied => TableError::Permission { what: path.display().to_string() },
        _ => TableError::Os { what: path.display().to_string(), cause: error.to_string() },
    }
}

/// Makes the directory with mode 0700, or checks that it is ours and nobody else can write to it.
fn private_directory(path: &Path) -> Result<(), TableError> {
    let os = |e: std::io::Error| file_error(path, &e);
    // Only the last component: a missing parent is the user's mistake, not ours to make with the wrong mode.
    match DirBuilder::new().mode(0o700).create(path) {
        Ok(()) => return Ok(()),
        Err(e) if e.kind() == std::io::ErrorKind::AlreadyExists => {}
        Err(e) => return Err(os(e)),
    }
    // Not following a symbolic link, which another user could have put into /tmp.
    let data = match std::fs::symlink_metadata(path) {
        Ok(data) => data,
        // Its last user removed it just now: who opens a file in it is told.
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(()),
        Err(e) => return Err(os(e)),
    };
    let unsafe_directory = |reason: String| TableError::UnsafeDirectory { path: path.to_owned(), reason };
    if !data.is_dir() {
        return Err(unsafe_directory("is not a directory".to_owned()));
    }
    let uid = rustix::process::geteuid().as_raw();
    if data.uid() != uid {
        return Err(unsafe_directory(format!("belongs to user {}, not to user {uid}", data.uid())));
    }
    if data.mode() & 0o022 != 0 {
        return Err(unsafe_directory(format!("others may write to it (mode {:04o})", data.mode() & 0o7777)));
    }
    Ok(())
}

//! Starting the executable, and finding what is not in the repository.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;
use std::time::{Duration, Instant};

/// Root of the workspace.
pub fn workspace() -> PathBuf {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    here.parent().unwrap_or(here).to_owned()
}

/// The executable, built from the present sources: `cargo test` alone leaves other packages' binaries stale.
///
/// # Panics
/// When it cannot be built: no test that starts it means anything then.
#[allow(clippy::panic)]
pub fn kingpin() -> PathBuf {
    static BUILT: OnceLock<PathBuf> = OnceLock::new();
    BUILT
        .get_or_init(|| {
            // Where nothing can be built (inside the CAN lab) it was built before.
            if let Some(built) = std::env::var_os("KINGPIN_EXECUTABLE") {
                return built.into();
            }
            let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
            let built = Command::new(cargo)
                .args(["build", "--release", "--quiet", "--package", "kingpin"])
                .current_dir(workspace())
                .status();
            match built {
                Ok(status) if status.success() => {}
                other => panic!("kingpin cannot be built: {other:?}"),
            }
            let target = std::env::var_os("CARGO_TARGET_DIR")
                .map_or_else(|| workspace().join("target"), PathBuf::from);
            target.join("release").join("kingpin")
        })
        .clone()
}

/// A file or folder of the reference data beside the repository. `None`, with its name said, when it is not
/// there; with `CI=true` that is a failure.
///
/// # Panics
/// With `CI=true` when it is missing.
#[allow(clippy::panic, clippy::print_stdout)]
pub fn reference(path: &str) -> Option<PathBuf> {
    let full = workspace().join("../shared/reference").join(path);
    if full.exists() {
        return Some(full);
    }
    if std::env::var("CI").is_ok_and(|ci| ci == "true") {
        panic!("reference data missing: {path}");
    }
    println!("SKIPPED: reference data missing: {path}");
    None
}

/// A Python that has the named modules (comma-separated): the interpreter that `KINGPIN_PEERS` names, else `python3`.
/// `None`, with what is missing said, when it has not; with `CI=true` that is a failure.
///
/// # Panics
/// With `CI=true` when it is missing.
#[allow(clippy::panic, clippy::print_stdout)]
pub fn peer(modules: &str) -> Option<PathBuf> {
    let python = PathBuf::from(std::env::var_os("KINGPIN_PEERS").unwrap_or_else(|| "python3".into()));
    let found = Command::new(&python).args(["-c", &format!("import {modules}")]).output();
    if found.is_ok_and(|output| output.status.success()) {
        return Some(python);
    }
    let missing = format!("Python with {modules} (tests/peers.txt; KINGPIN_PEERS names the interpreter)");
    if std::env::var("CI").is_ok_and(|ci| ci == "true") {
        panic!("missing: {missing}");
    }
    println!("SKIPPED: missing: {missing}");
    None
}

/// A region of a running bench's table as JSON; with no name, the table itself.
///
/// # Panics
/// When the executable cannot be started.
#[allow(clippy::unwrap_used)]
pub fn show(name: &str, region: &str) -> Option<serde_json::Value> {
    let mut command = Command::new(kingpin());
    command.args(["table", "show", "--json", "--name", name]);
    if !region.is_empty() {
        command.arg(region);
    }
    serde_json::from_slice(&command.output().unwrap().stdout).ok()
}

/// What `look` finds, once it finds something.
///
/// # Panics
/// When that takes longer than `patience`.
pub fn until<T>(what: &str, patience: Duration, mut look: impl FnMut() -> Option<T>) -> T {
    let begin = Instant::now();
    loop {
        if let Some(found) = look() {
            return found;
        }
        assert!(begin.elapsed() < patience, "waited in vain for {what}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// Files that the bench of that name has in shared memory and in its directory of locks: none when nobody runs it.
pub fn left_over(name: &str) -> Vec<String> {
    let files = |directory: &Path| {
        let entries = std::fs::read_dir(directory).into_iter().flatten().flatten();
        entries.map(|entry| entry.path().display().to_string()).collect::<Vec<_>>()
    };
    let of_bench = |file: &String| {
        ["kingpin.", "kingpin_link."].iter().any(|of| file.contains(&format!("/{of}{name}.")))
    };
    let memory = files(Path::new("/dev/shm")).into_iter().filter(of_bench);
    let locks = files(&table::base_from_environment().join(name));
    memory.chain(locks).collect()
}

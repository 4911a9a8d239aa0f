//! What all clients share: the live run, if any, the run this console started, logs that are open.

use crate::operator::Operator;
use crate::replay;
use crate::source::Live;
use crate::token::Token;
use record::LogReader;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicU64, AtomicUsize};
use std::sync::{Arc, Mutex, PoisonError};
use table::Bench;

/// A log with its period.
pub(crate) type Log = (Arc<LogReader>, f64);

/// Logs kept open at most: they are held in memory.
const LOGS_MAX: usize = 2;

/// What all clients share.
pub(crate) struct Hub {
    pub(crate) bench: Bench,
    pub(crate) token: Token,
    pub(crate) runs: PathBuf,
    /// A log named when the console was started.
    pub(crate) log: Option<PathBuf>,
    pub(crate) executable: PathBuf,
    /// Values replaced in the runs that are started here.
    pub(crate) set: Vec<String>,
    pub(crate) operator: Operator,
    pub(crate) clients: AtomicUsize,
    pub(crate) frames_sent: AtomicU64,
    live: Mutex<Option<Arc<Live>>>,
    started: Mutex<Option<Started>>,
    logs: Mutex<Vec<(String, Log)>>,
    /// What became of runs started here, and how often there was such news.
    news: Mutex<(u64, String)>,
}

struct Started {
    child: Child,
    said: PathBuf,
    scenario: String,
}

fn locked<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    // What is behind the locks is replaced whole, so a panic of another task leaves nothing half made.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Hub {
    pub(crate) fn new(
        bench: Bench,
        token: Token,
        runs: PathBuf,
        log: Option<PathBuf>,
        executable: PathBuf,
        set: Vec<String>,
        operator: Operator,
    ) -> Self {
        Hub {
            bench,
            token,
            runs,
            log,
            executable,
            set,
            operator,
            clients: AtomicUsize::new(0),
            frames_sent: AtomicU64::new(0),
            live: Mutex::new(None),
            started: Mutex::new(None),
            logs: Mutex::new(Vec::new()),
            news: Mutex::new((0, String::new())),
        }
    }

    /// The run that is there now.
    pub(crate) fn live(&self) -> Option<Arc<Live>> {
        locked(&self.live).clone()
    }

    /// Looks whether there is another run than before.
    pub(crate) fn look(&self) {
        let header = || {
            let name = regions::RegionId::RigStatus.region().name;
            Some(table::RegionReader::open_any(&self.bench, name).ok()?.header().run_id())
        };
        let now = header();
        let before = self.live().map(|live| live.run_id);
        if now == before {
            return;
        }
        let opened = now.and_then(|_| Live::open(&self.bench));
        if let Some(live) = &opened {
            keep_off(&live.cores);
        }
        *locked(&self.live) = opened.map(Arc::new);
    }

    /// Starts a run of a shipped scenario that waits for its operator.
    pub(crate) fn launch(&self, scenario: &str, duration_s: Option<f64>) -> Result<String, String> {
        let known = config::Library::list(config::Kind::Scenario).iter().any(|s| s.name == scenario);
        if !known {
            return Err(format!("`{scenario}` is not one of the scenarios"));
        }
        if duration_s.is_some_and(|s| !(s.is_finite() && (1.0..=86400.0).contains(&s))) {
            return Err("the duration must be between 1 and 86400 s".to_owned());
        }
        let mut started = locked(&self.started);
        let running = started.as_mut().is_some_and(|s| matches!(s.child.try_wait(), Ok(None)));
        if running || matches!(self.bench.supervisor_pid(), Ok(Some(_))) {
            return Err(format!("bench {} is running already", self.bench.name()));
        }
        let stamp = std::time::SystemTime::now()
            .duration_since(std::time::UNIX_EPOCH)
            .map_or(0, |since| since.as_secs());
        let name = format!("{scenario}-console-{stamp}");
        let directory = self.runs.join(&name);
        std::fs::create_dir_all(&directory).map_err(|e| format!("{}: {e}", directory.display()))?;
        let said = directory.join("console.txt");
        let file = std::fs::File::create(&said).map_err(|e| format!("{}: {e}", said.display()))?;
        let mut command = Command::new(&self.executable);
        command.args(["run", scenario, "--operate", "--name", self.bench.name().as_str(), "--out"]);
        command.arg(&directory);
        for set in &self.set {
            command.args(["--set", set]);
        }
        if let Some(duration) = duration_s {
            command.arg("--duration").arg(duration.to_string());
        }
        command.env("KINGPIN_RUNTIME_DIR", self.bench.base());
        let child = command
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(file)
            .spawn()
            .map_err(|e| format!("the run could not be started: {e}"))?;
        *started = Some(Started { child, said, scenario: scenario.to_owned() });
        Ok(name)
    }

    /// The newest news, if it is newer than what somebody has seen.
    pub(crate) fn news(&self, seen: &mut u64) -> Option<String> {
        let mut news = locked(&self.news);
        if let Some(text) = self.ended() {
            *news = (news.0 + 1, text);
        }
        let newer = news.0 > *seen;
        *seen = news.0;
        newer.then(|| news.1.clone())
    }

    /// What became of the run this console started: `None` while it runs or if there is none.
    fn ended(&self) -> Option<String> {
        let mut started = locked(&self.started);
        let run = started.as_mut()?;
        let status = run.child.try_wait().ok()??;
        let said = std::fs::read_to_string(&run.said).unwrap_or_default();
        let last: Vec<_> = said.lines().rev().take(6).collect();
        let text = match status.code() {
            Some(0) => format!("{} ended as planned", run.scenario),
            code => {
                let lines: Vec<_> = last.into_iter().rev().collect();
                let code = code.map_or("killed".to_owned(), |code| format!("exit status {code}"));
                format!("{} ended ({code}): {}", run.scenario, lines.join(" | "))
            }
        };
        *started = None;
        Some(text)
    }

    /// Directory of a run by its name: a plain name within the runs' directory, or the log this console was
    /// started on.
    pub(crate) fn run_directory(&self, name: &str) -> Result<PathBuf, String> {
        if let Some(log) = self.log.as_ref().filter(|log| log_name(log) == name) {
            return Ok(log.clone());
        }
        let plain = !name.is_empty()
            && name.len() <= 200
            && !name.starts_with('.')
            && name.chars().all(|c| c.is_ascii_alphanumeric() || "._-".contains(c));
        let path = self.runs.join(name);
        if plain && path.is_dir() { Ok(path) } else { Err(format!("there is no run `{name}`")) }
    }

    /// A run's log, read whole. Slow: not for the server's own thread.
    pub(crate) fn open_log(&self, name: &str) -> Result<Log, String> {
        if let Some((_, log)) = locked(&self.logs).iter().find(|(known, _)| known == name) {
            return Ok(log.clone());
        }
        let path = self.run_directory(name)?;
        let log = LogReader::open(&path).map_err(|e| e.to_string())?;
        let period = replay::period_s(&log);
        let log = (Arc::new(log), period);
        let mut logs = locked(&self.logs);
        if logs.len() >= LOGS_MAX {
            logs.remove(0);
        }
        logs.push((name.to_owned(), log.clone()));
        Ok(log)
    }
}

/// Name by which the page knows the log that the console was started on.
pub(crate) fn log_name(path: &Path) -> String {
    path.file_name().map_or_else(|| "log".to_owned(), |name| name.to_string_lossy().into_owned())
}

impl Drop for Hub {
    fn drop(&mut self) {
        // A run outlives its console; whoever waits for its end is the system.
        if let Some(run) = locked(&self.started).as_mut() {
            let _ = run.child.try_wait();
        }
    }
}

/// Leaves the cores of the real-time services to them, as far as there are others.
pub fn keep_off(cores: &[u16]) {
    if cores.is_empty() {
        return;
    }
    if let Ok(mut set) = rustix::thread::sched_getaffinity(None) {
        for &core in cores {
            set.unset(usize::from(core));
        }
        // With no core left over, sharing is all there is.
        if set.count() > 0 {
            let _ = rustix::thread::sched_setaffinity(None, &set);
        }
    }
}

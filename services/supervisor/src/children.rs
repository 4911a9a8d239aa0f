//! The services as child processes: started, watched by their exit, restarted, ended.
//!
//! They run in a process group of their own, so that Ctrl-C reaches the supervisor only, and without a
//! parent-death signal: a running bench survives its supervisor.

use runtime::clock::{self, Nanos, SECOND};
use std::fs::OpenOptions;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};

/// Services in the order of the counters in the bench region.
pub const SERVICES: [&str; 4] = ["rig", "vehicle", "multibody", "logger"];

/// Restarts of one service within [`GIVE_UP_NS`] after which it is given up.
const GIVE_UP: usize = 8;
const GIVE_UP_NS: Nanos = 10 * SECOND;

/// One service.
struct Service {
    child: Option<Child>,
    restarts: u64,
    died: Vec<Nanos>,
    restart_at: Nanos,
    finished: bool,
}

/// All services of a bench.
pub struct Children {
    /// [`SERVICES`], then those that only some benches have.
    names: Vec<&'static str>,
    executable: PathBuf,
    bench: String,
    output: PathBuf,
    restart_delay_ns: Nanos,
    services: Vec<Service>,
}

/// What watching the services found.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Change {
    /// A service died; it is started again.
    Died {
        /// Which.
        service: &'static str,
        /// How.
        how: String,
    },
    /// A service was started again.
    Restarted {
        /// Which.
        service: &'static str,
    },
    /// A service died too often.
    GivenUp {
        /// Which.
        service: &'static str,
        /// How it died the last time.
        how: String,
    },
}

/// How a process ended, in words.
fn how(status: ExitStatus) -> String {
    match (status.code(), status.signal()) {
        (Some(code), _) => format!("exit status {code}"),
        (None, Some(signal)) => format!("killed by signal {signal}"),
        _ => "ended".to_owned(),
    }
}

impl Children {
    /// Starts all services of a bench, and the `optional` ones that this bench has; what they say goes to the file
    /// `output`.
    ///
    /// # Errors
    /// The system's, when a process cannot be started.
    pub fn start(
        executable: PathBuf,
        bench: &str,
        output: &Path,
        restart_delay_ns: Nanos,
        optional: &[&'static str],
    ) -> std::io::Result<Self> {
        let service =
            || Service { child: None, restarts: 0, died: Vec::new(), restart_at: 0, finished: false };
        let names: Vec<&'static str> = SERVICES.iter().chain(optional).copied().collect();
        let mut children = Children {
            services: names.iter().map(|_| service()).collect(),
            names,
            executable,
            bench: bench.to_owned(),
            output: output.to_owned(),
            restart_delay_ns,
        };
        for index in 0..children.names.len() {
            match children.spawn(index) {
                Ok(child) => children.services[index].child = Some(child),
                Err(error) => {
                    children.kill();
                    return Err(error);
                }
            }
        }
        Ok(children)
    }

    fn spawn(&self, index: usize) -> std::io::Result<Child> {
        let said = OpenOptions::new().create(true).append(true).open(&self.output)?;
        let errors = said.try_clone()?;
        Command::new(&self.executable)
            .args(["service", self.names[index], "--bench", &self.bench])
            .stdin(Stdio::null())
            .stdout(said)
            .stderr(errors)
            .process_group(0)
            .spawn()
    }

    /// Process numbers by service, for whoever wants to watch or kill them.
    pub fn pids(&self) -> [Option<u32>; 4] {
        std::array::from_fn(|i| self.services[i].child.as_ref().map(Child::id))
    }

    /// Restarts by service.
    pub fn restarts(&self) -> [u64; 4] {
        std::array::from_fn(|i| self.services[i].restarts)
    }

    /// 1 for each service that is running.
    pub fn alive(&self) -> [u64; 4] {
        std::array::from_fn(|i| u64::from(self.services[i].child.is_some()))
    }

    /// Reaps what died. Before `ending`, a death is a fault and the service is started again; after it, a
    /// clean exit is what is wanted.
    pub fn watch(&mut self, ending: bool) -> Vec<Change> {
        let mut changes = Vec::new();
        let now = clock::now();
        for index in 0..self.names.len() {
            let name = self.names[index];
            let service = &mut self.services[index];
            if let Some(child) = &mut service.child
                && let Ok(Some(status)) = child.try_wait()
            {
                service.child = None;
                if ending && status.success() {
                    service.finished = true;
                    continue;
                }
                service.died.retain(|&at| now - at < GIVE_UP_NS);
                service.died.push(now);
                if service.died.len() > GIVE_UP {
                    service.finished = true;
                    changes.push(Change::GivenUp { service: name, how: how(status) });
                    continue;
                }
                service.restart_at = now + self.restart_delay_ns;
                changes.push(Change::Died { service: name, how: how(status) });
            }
            let service = &self.services[index];
            if service.child.is_none() && !service.finished && now >= service.restart_at {
                // A refusal (no memory, no processes left) is tried again at the next look.
                if let Ok(child) = self.spawn(index) {
                    self.services[index].child = Some(child);
                    self.services[index].restarts += 1;
                    changes.push(Change::Restarted { service: name });
                }
            }
        }
        changes
    }

    /// A service that ended before the run began, if any: the run cannot start.
    pub fn early_death(&mut self) -> Option<(&'static str, String)> {
        for (index, service) in self.services.iter_mut().enumerate() {
            if let Some(child) = &mut service.child
                && let Ok(Some(status)) = child.try_wait()
            {
                service.child = None;
                return Some((self.names[index], how(status)));
            }
        }
        None
    }

    /// Whether all services have ended.
    pub fn all_ended(&self) -> bool {
        self.services.iter().all(|service| service.child.is_none())
    }

    /// Ends whatever still runs.
    pub fn kill(&mut self) {
        for service in &mut self.services {
            if let Some(mut child) = service.child.take() {
                let _ = child.kill();
                let _ = child.wait();
            }
        }
    }
}

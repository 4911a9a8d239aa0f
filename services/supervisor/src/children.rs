//! The services as processes: started or adopted, watched by their pidfd, restarted, ended.
//!
//! They run in a process group of their own, so that Ctrl-C reaches the supervisor only, and without a
//! parent-death signal: a running bench survives its supervisor, and the next one adopts them. A pidfd tells of
//! a death at once, also that of a process that is nobody's child here, and never means another process.
//!
//! A service that dies young again and again is started again later each time, and given up after
//! [`YOUNG_MAX`] such deaths in a row or [`DEATHS_MAX`] deaths within a minute.

use runtime::clock::{self, Nanos, SECOND};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::process::{Pid, PidfdFlags, Signal, pidfd_open, pidfd_send_signal};
use std::fs::OpenOptions;
use std::os::fd::OwnedFd;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use table::ProcessId;

/// Services in the order of the counters in the bench region.
pub const SERVICES: [&str; 4] = ["rig", "vehicle", "multibody", "logger"];

/// A service that dies before it is this old has died young. [ns]
pub const YOUNG_NS: Nanos = SECOND;
/// Young deaths in a row after which a service is given up.
pub const YOUNG_MAX: u32 = 8;
/// Wait before the restart behind the second young death; twice as long behind each further one. [ns]
const BACK_OFF_NS: Nanos = 10_000_000;
/// Longest wait before a restart. [ns]
const BACK_OFF_MAX_NS: Nanos = SECOND;
/// Deaths within [`DEATHS_NS`] after which a service is given up, however old it was each time.
pub const DEATHS_MAX: usize = 60;
const DEATHS_NS: Nanos = 60 * SECOND;

/// A process that is watched.
#[derive(Debug)]
struct Process {
    pid: u32,
    started: Nanos,
    pidfd: OwnedFd,
    /// Not there for one that was adopted: only its parent learns how it ended.
    child: Option<Child>,
}

/// How a process ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct End {
    status: Option<ExitStatus>,
    age_ns: Nanos,
}

impl End {
    /// In words.
    fn how(&self) -> String {
        match self.status.map(|s| (s.code(), s.signal())) {
            Some((Some(code), _)) => format!("exit status {code}"),
            Some((None, Some(signal))) => format!("killed by signal {signal}"),
            _ => "ended".to_owned(),
        }
    }

    /// In order, as far as is known.
    fn clean(&self) -> bool {
        self.status.is_none_or(|status| status.success())
    }
}

impl Process {
    fn of_child(mut child: Child) -> std::io::Result<Self> {
        let pid = child.id();
        let watched = Pid::from_raw(pid.cast_signed())
            .ok_or_else(|| std::io::Error::other("no process number"))
            .and_then(|pid| Ok(pidfd_open(pid, PidfdFlags::empty())?));
        match watched {
            Ok(pidfd) => Ok(Process { pid, started: clock::now(), pidfd, child: Some(child) }),
            Err(error) => {
                let _ = child.kill();
                let _ = child.wait();
                Err(error)
            }
        }
    }

    /// A process that somebody else started; `None` if it is not there any more.
    fn adopt(id: ProcessId) -> Option<Self> {
        let pidfd = pidfd_open(Pid::from_raw(id.pid.cast_signed())?, PidfdFlags::empty()).ok()?;
        // The number may have gone to another process before it was opened; from here on it cannot.
        table::is_alive(id).then_some(Process { pid: id.pid, started: 0, pidfd, child: None })
    }

    /// How it ended, if it has.
    fn ended(&mut self) -> Option<End> {
        let age_ns = clock::now() - self.started;
        if let Some(child) = &mut self.child {
            return child.try_wait().ok().flatten().map(|status| End { status: Some(status), age_ns });
        }
        readable(&[&self.pidfd], 0).then_some(End { status: None, age_ns })
    }

    fn kill(mut self) {
        let _ = pidfd_send_signal(&self.pidfd, Signal::KILL);
        match &mut self.child {
            Some(child) => drop(child.wait()),
            None => drop(readable(&[&self.pidfd], SECOND)),
        }
    }
}

/// Whether one of the descriptors becomes readable within a time. A pidfd does when its process ends.
fn readable(fds: &[&OwnedFd], within: Nanos) -> bool {
    let mut polled: Vec<_> = fds.iter().map(|fd| PollFd::new(*fd, PollFlags::IN)).collect();
    let timeout = Timespec { tv_sec: (within / SECOND) as i64, tv_nsec: (within % SECOND) as _ };
    poll(&mut polled, Some(&timeout)).is_ok_and(|count| count > 0)
}

/// One service.
#[derive(Debug, Default)]
struct Service {
    process: Option<Process>,
    restarts: u64,
    died: Vec<Nanos>,
    young_deaths: u32,
    restart_at: Nanos,
    finished: bool,
}

impl Service {
    /// Books a death at `now`. The wait before the restart, or `None` to give up.
    fn book(&mut self, now: Nanos, age_ns: Nanos) -> Option<Nanos> {
        self.died.retain(|&at| now - at < DEATHS_NS);
        self.died.push(now);
        self.young_deaths = if age_ns < YOUNG_NS { self.young_deaths + 1 } else { 0 };
        if self.young_deaths >= YOUNG_MAX || self.died.len() >= DEATHS_MAX {
            return None;
        }
        let doublings = self.young_deaths.checked_sub(2);
        Some(doublings.map_or(0, |n| (BACK_OFF_NS << n.min(10)).min(BACK_OFF_MAX_NS)))
    }
}

/// All services of a bench.
#[derive(Debug)]
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
        /// In so long. [ns]
        again_in_ns: Nanos,
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
        /// Young deaths in a row.
        young_deaths: u32,
        /// Deaths within the last minute.
        deaths: usize,
    },
}

impl std::fmt::Display for Change {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Change::Died { service, how, again_in_ns: 0 } => write!(f, "service {service} died ({how})"),
            Change::Died { service, how, again_in_ns } => {
                let wait_ms = *again_in_ns as f64 * 1e-6;
                write!(f, "service {service} died ({how}); started again in {wait_ms:.0} ms")
            }
            Change::Restarted { service } => write!(f, "service {service} was started again"),
            Change::GivenUp { service, how, young_deaths, .. } if *young_deaths >= YOUNG_MAX => write!(
                f,
                "service {service} died {young_deaths} times in a row within {:.0} s of its start ({how}) and is given up: \
                 the run ends",
                YOUNG_NS as f64 * 1e-9
            ),
            Change::GivenUp { service, how, deaths, .. } => write!(
                f,
                "service {service} died {deaths} times within a minute ({how}) and is given up: the run ends"
            ),
        }
    }
}

impl Children {
    fn none(
        executable: PathBuf,
        bench: &str,
        output: &Path,
        restart_delay_ns: Nanos,
        optional: &[&'static str],
    ) -> Self {
        let (bench, output) = (bench.to_owned(), output.to_owned());
        let names: Vec<&'static str> = SERVICES.iter().chain(optional).copied().collect();
        let services = names.iter().map(|_| Service::default()).collect();
        Children { names, executable, bench, output, restart_delay_ns, services }
    }

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
        let mut children = Self::none(executable, bench, output, restart_delay_ns, optional);
        for index in 0..children.names.len() {
            match children.spawn(index) {
                Ok(process) => children.services[index].process = Some(process),
                Err(error) => {
                    children.kill();
                    return Err(error);
                }
            }
        }
        Ok(children)
    }

    /// Takes over the services of a bench that lost its supervisor; `None` for one that is not there any more: it is
    /// started again at the first look. `restarts`: what the last supervisor counted.
    pub fn adopt(
        executable: PathBuf,
        bench: &str,
        output: &Path,
        restart_delay_ns: Nanos,
        running: [Option<ProcessId>; 4],
        restarts: [u64; 4],
        optional: &[(&'static str, Option<ProcessId>)],
    ) -> Self {
        let names: Vec<_> = optional.iter().map(|(name, _)| *name).collect();
        let mut children = Self::none(executable, bench, output, restart_delay_ns, &names);
        let restarts = restarts.into_iter().chain(std::iter::repeat(0));
        let running = running.into_iter().chain(optional.iter().map(|(_, id)| *id));
        for ((service, id), restarts) in children.services.iter_mut().zip(running).zip(restarts) {
            service.process = id.and_then(Process::adopt);
            service.restarts = restarts;
        }
        children
    }

    fn spawn(&self, index: usize) -> std::io::Result<Process> {
        // The run's directory may have been removed meanwhile: then what the service says is lost, not the service.
        let said = OpenOptions::new().create(true).append(true).open(&self.output);
        let (said, errors) = match said.and_then(|said| Ok((said.try_clone()?, said))) {
            Ok((said, errors)) => (Stdio::from(said), Stdio::from(errors)),
            Err(_) => (Stdio::null(), Stdio::null()),
        };
        Command::new(&self.executable)
            .args(["service", self.names[index], "--bench", &self.bench])
            .stdin(Stdio::null())
            .stdout(said)
            .stderr(errors)
            .process_group(0)
            .spawn()
            .and_then(Process::of_child)
    }

    /// Process numbers by service, for whoever wants to watch or kill them.
    pub fn pids(&self) -> [Option<u32>; 4] {
        std::array::from_fn(|i| self.services[i].process.as_ref().map(|p| p.pid))
    }

    /// Restarts by service.
    pub fn restarts(&self) -> [u64; 4] {
        std::array::from_fn(|i| self.services[i].restarts)
    }

    /// 1 for each service that is running.
    pub fn alive(&self) -> [u64; 4] {
        std::array::from_fn(|i| u64::from(self.services[i].process.is_some()))
    }

    /// Waits until a service ends or the time is over.
    pub fn wait(&self, at_most: Nanos) {
        let now = clock::now();
        let due = |s: &Service| s.process.is_none() && !s.finished;
        let next = self.services.iter().filter(|s| due(s)).map(|s| s.restart_at.saturating_sub(now)).min();
        let at_most = next.map_or(at_most, |next| next.min(at_most));
        let fds: Vec<_> = self.services.iter().filter_map(|s| Some(&s.process.as_ref()?.pidfd)).collect();
        readable(&fds, at_most);
    }

    /// Reaps what died. Before `ending`, a death is a fault and the service is started again; after it, a
    /// clean exit is what is wanted.
    pub fn watch(&mut self, ending: bool) -> Vec<Change> {
        let mut changes = Vec::new();
        let now = clock::now();
        for index in 0..self.names.len() {
            let name = self.names[index];
            let service = &mut self.services[index];
            if let Some(end) = service.process.as_mut().and_then(Process::ended) {
                service.process = None;
                if ending && end.clean() {
                    service.finished = true;
                    continue;
                }
                let how = end.how();
                let Some(back_off_ns) = service.book(now, end.age_ns) else {
                    service.finished = true;
                    let (young_deaths, deaths) = (service.young_deaths, service.died.len());
                    changes.push(Change::GivenUp { service: name, how, young_deaths, deaths });
                    continue;
                };
                let again_in_ns = back_off_ns.max(self.restart_delay_ns);
                service.restart_at = now + again_in_ns;
                changes.push(Change::Died { service: name, how, again_in_ns });
            }
            let service = &self.services[index];
            if service.process.is_none() && !service.finished && now >= service.restart_at {
                // A refusal (no memory, no processes left) is tried again at a later look.
                match self.spawn(index) {
                    Ok(process) => {
                        self.services[index].process = Some(process);
                        self.services[index].restarts += 1;
                        changes.push(Change::Restarted { service: name });
                    }
                    Err(_) => self.services[index].restart_at = now + BACK_OFF_NS,
                }
            }
        }
        changes
    }

    /// A service that has ended, if any, without starting it again: before the run began, and in lockstep.
    /// The flag says whether it ended in order.
    pub fn early_death(&mut self) -> Option<(&'static str, String, bool)> {
        for (index, service) in self.services.iter_mut().enumerate() {
            if let Some(end) = service.process.as_mut().and_then(Process::ended) {
                service.process = None;
                service.finished = true;
                return Some((self.names[index], end.how(), end.clean()));
            }
        }
        None
    }

    /// Whether all services have ended.
    pub fn all_ended(&self) -> bool {
        self.services.iter().all(|service| service.process.is_none() && service.finished)
    }

    /// Ends whatever still runs.
    pub fn kill(&mut self) {
        for service in &mut self.services {
            if let Some(process) = service.process.take() {
                process.kill();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn young_deaths_back_off_and_end_in_giving_up() {
        let mut service = Service::default();
        let waits: Vec<_> = (0..8).map(|i| service.book(i * SECOND, 1000).map(|w| w / 1_000_000)).collect();
        assert_eq!(waits[0], Some(0));
        assert_eq!(waits[1..7], [10, 20, 40, 80, 160, 320].map(Some)[..]);
        assert_eq!(waits[7], None, "the eighth young death in a row");
    }

    #[test]
    fn a_service_that_did_some_work_starts_afresh() {
        let mut service = Service::default();
        for i in 0..50 {
            let age = if i % 7 == 6 { 2 * SECOND } else { 0 };
            assert!(service.book(i * 2 * SECOND, age).is_some(), "death {i}");
        }
        let many =
            (0..60).map(|i| service.book(1000 * SECOND + i, 2 * SECOND)).filter(Option::is_none).count();
        assert_eq!(many, 1, "sixty within a minute are too many even so");
    }
}

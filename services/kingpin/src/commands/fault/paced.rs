//! Faults in real time: the bench is a run like any other, this process is its enemy and its witness.
//!
//! The bench is started as `kingpin run`, so that its supervisor can be killed too. Services are killed and
//! stopped by signals; what they do to themselves is ordered through the region `faults`. An observer thread
//! reads the table all the while, so that the log can be compared with what was really published.

use super::round::{DENSE, Made, Round, Seen};
use super::schedule::{Injection, Random, fault_ticks, order};
use config::ResolvedBench;
use config::campaign::{Campaign, FaultKind, Place, Target};
use regions::{Fault, Payload, RegionId, RigStatus, fault_kind};
use runtime::clock::{self, Grid, Nanos, SECOND};
use runtime::realtime::{self, Wish};
use runtime::region_specs;
use rustix::process::{Pid, Resource, Rlimit, Signal, kill_process, prlimit};
use std::collections::BTreeSet;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use table::{Bench, OpenOptions, Read, RegionWriter, Table};

/// Longest wait for the bench to start or end.
const PATIENCE_NS: Nanos = 120 * SECOND;
/// A look of the observer. The table keeps four seconds.
const OBSERVE: Duration = Duration::from_millis(50);
/// State code of a running bench.
const RUNNING: u64 = 4;

/// A bench under attack.
struct Victim<'a> {
    bench: &'a Bench,
    campaign: &'a Campaign,
    resolved: &'a ResolvedBench,
    directory: PathBuf,
    executable: PathBuf,
    supervisor: Child,
    table: Table,
    orders: Option<RegionWriter>,
    grid: Grid,
    pids: BTreeSet<u32>,
}

fn signal(pid: u32, signal: Signal) -> bool {
    Pid::from_raw(pid.cast_signed()).is_some_and(|pid| kill_process(pid, signal).is_ok())
}

/// Makes the faults in one run of the bench. `progress` is told each that is done.
pub fn round(
    campaign: &Campaign,
    resolved: &ResolvedBench,
    bench: &Bench,
    directory: &Path,
    injections: Vec<Injection>,
    interrupt: &AtomicBool,
    mut progress: impl FnMut(&Made),
) -> Round {
    let mut round =
        Round { directory: directory.to_owned(), made: Vec::new(), seen: None, faults: Vec::new() };
    let mut victim = match start(campaign, resolved, bench, directory) {
        Ok(victim) => victim,
        Err(why) => {
            round.faults.push(why);
            return round;
        }
    };
    let done = AtomicBool::new(false);
    let readers = DENSE.map(|id| victim.table.reader(id as usize).clone());
    std::thread::scope(|scope| {
        let done = &done;
        let observer = scope.spawn(move || observe(&readers, done));
        for injection in injections {
            if interrupt.load(Ordering::Relaxed) {
                break;
            }
            let made = victim.make(injection);
            let lost = made.skipped.is_none() && made.running_tick.is_none();
            progress(&made);
            round.made.push(made);
            if lost {
                // It will not come back: the rest of the faults would only say so again.
                break;
            }
        }
        done.store(true, Ordering::Relaxed);
        // The observer must have read what was published until now before the table goes.
        round.seen = observer.join().ok();
    });
    round.faults.extend(victim.end());
    round
}

fn observe(readers: &[table::RegionReader; DENSE.len()], done: &AtomicBool) -> Seen {
    let mut seen = Seen::default();
    let mut next = [0_u64; DENSE.len()];
    loop {
        let last = done.load(Ordering::Relaxed);
        for (i, reader) in readers.iter().enumerate() {
            let mut words = vec![0; reader.words()];
            let head = reader.head();
            let kept = head.saturating_sub(reader.depth() as u64);
            if next[i] < kept {
                seen.unseen += kept - next[i];
                next[i] = kept;
            }
            while next[i] < head {
                match reader.read(next[i], &mut words) {
                    Read::Ready => seen.ticks[i].push(next[i]),
                    Read::Overwritten => seen.unseen += 1,
                    Read::Missing | Read::NotYet => {}
                }
                next[i] += 1;
            }
        }
        if last {
            return seen;
        }
        std::thread::sleep(OBSERVE);
    }
}

fn start<'a>(
    campaign: &'a Campaign,
    resolved: &'a ResolvedBench,
    bench: &'a Bench,
    directory: &Path,
) -> Result<Victim<'a>, String> {
    let executable = std::env::current_exe().map_err(|e| format!("kingpin: {e}"))?;
    let mut command = Command::new(&executable);
    command.args(["run", &campaign.scenario, "--json", "--no-report", "--rearm", "--faults"]);
    command.args(["--name", bench.name().as_str()]).arg("--out").arg(directory);
    for value in &campaign.set {
        command.args(["--set", value]);
    }
    let said = std::fs::File::create(directory.with_extension("stderr.txt")).map_err(|e| e.to_string())?;
    let supervisor = command
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(said)
        .spawn()
        .map_err(|e| format!("kingpin run: {e}"))?;
    let mut supervisor = supervisor;
    let period_s = resolved.scenario.timing.period_s();
    let limit = clock::now() + PATIENCE_NS;
    let fail = |supervisor: &mut Child, why: String| {
        let _ = supervisor.kill();
        let _ = supervisor.wait();
        why
    };
    let (table, t0) = loop {
        if let Ok(table) = Table::open(bench, &region_specs(period_s), &OpenOptions::default())
            && let Some(t0) = table.reader(0).header().t0_ns()
        {
            break (table, t0);
        }
        if let Ok(Some(status)) = supervisor.try_wait() {
            return Err(format!("the run ended before it began ({status}); see {}", directory.display()));
        }
        if clock::now() > limit {
            return Err(fail(&mut supervisor, "the run did not begin in time".to_owned()));
        }
        clock::sleep_until(clock::now() + 20_000_000, 0);
    };
    let orders = table
        .claim_writer(RegionId::Faults as usize)
        .map_err(|e| fail(&mut supervisor, format!("region faults: {e}")))?;
    let orders = Some(orders);
    let grid = Grid { t0, period: resolved.scenario.timing.period_ns() };
    let pids = BTreeSet::new();
    let directory = directory.to_owned();
    Ok(Victim { bench, campaign, resolved, directory, executable, supervisor, table, orders, grid, pids })
}

/// The region by which a service is known.
fn region_of(target: Target) -> RegionId {
    match target {
        Target::Rig => RegionId::RigStatus,
        Target::Vehicle => RegionId::VehicleState,
        Target::Multibody => RegionId::SuspensionState,
        Target::Logger => RegionId::LoggerStatus,
        Target::Supervisor => RegionId::Bench,
        Target::Can => RegionId::Can,
    }
}

/// Number of a service in [`Fault::target`].
fn number_of(target: Target) -> u64 {
    match target {
        Target::Rig | Target::Supervisor => 0,
        Target::Vehicle => 1,
        Target::Multibody => 2,
        Target::Logger => 3,
        Target::Can => can_service::TARGET,
    }
}

impl Victim<'_> {
    fn recover_max_ns(&self) -> Nanos {
        (self.campaign.recover_max_s * SECOND as f64) as Nanos
    }

    fn status(&self) -> Option<(u64, RigStatus)> {
        let reader = self.table.reader(RegionId::RigStatus as usize);
        let mut status = RigStatus::absent();
        let latest = reader.latest(reader.head(), status.words_mut())?;
        Some((latest.tick, status))
    }

    fn writer(&mut self, target: Target) -> Option<u32> {
        let writer = self.table.reader(region_of(target) as usize).header().writer()?;
        self.pids.insert(writer.pid);
        table::is_alive(writer).then_some(writer.pid)
    }

    /// All processes of this bench.
    fn everybody(&self) -> Vec<Target> {
        let mut all =
            vec![Target::Rig, Target::Vehicle, Target::Multibody, Target::Logger, Target::Supervisor];
        if self.resolved.can.is_some() {
            all.push(Target::Can);
        }
        all
    }

    fn epoch(&self, target: Target) -> u64 {
        self.table.reader(region_of(target) as usize).header().epoch()
    }

    /// Waits until everybody is there and the bench has run for `settle_s` without a late command. The tick then.
    fn wait_running(&mut self, settle_s: f64) -> Option<u64> {
        let limit = clock::now() + self.recover_max_ns() + (settle_s * SECOND as f64) as Nanos;
        let settle = (settle_s * SECOND as f64) as Nanos;
        let mut since = clock::now();
        let mut last_tick = 0;
        let everybody = self.everybody();
        loop {
            let now = clock::now();
            let there = everybody.iter().all(|&target| self.writer(target).is_some());
            let fine = match self.status() {
                Some((tick, status)) => {
                    let moves = tick > last_tick || now - since < 20_000_000;
                    last_tick = tick;
                    status.state == RUNNING && status.stale_count == 0 && moves
                }
                None => false,
            };
            if !(there && fine) {
                since = now;
            } else if now - since >= settle {
                return Some(last_tick);
            }
            if now > limit || matches!(self.supervisor.try_wait(), Ok(Some(_))) {
                return None;
            }
            clock::sleep_until(now + 2_000_000, 0);
        }
    }

    /// Start, attach and end of a process that does nothing else, at the priority of a restart.
    fn bare(&self) -> Option<u64> {
        let priority = self.resolved.scenario.realtime.priority;
        let priority = priority.map(|p| (i32::from(p) - supervisor::BELOW_SERVICES).max(1));
        // What the host refuses, it refuses the supervisor too.
        let _ = realtime::apply(&Wish { priority, ..Wish::default() });
        let bare = self.bare_at_priority();
        realtime::relax();
        bare
    }

    fn bare_at_priority(&self) -> Option<u64> {
        let begin = clock::now();
        let status = Command::new(&self.executable)
            .args(["service", "probe", "--bench", self.bench.name().as_str()])
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .status()
            .ok()?;
        status.success().then(|| clock::now() - begin)
    }

    fn make(&mut self, injection: Injection) -> Made {
        let settle_s = injection.settle_s;
        if injection.target == Target::Can && self.resolved.can.is_none() {
            return Made::skipped(injection, "this bench has no CAN service");
        }
        if self.wait_running(settle_s).is_none() {
            let mut made = Made::skipped(injection, "");
            made.skipped = None;
            made.tick = self.grid.tick_at(clock::now());
            made.at_ns = clock::now().saturating_sub(self.grid.t0);
            return made;
        }
        let kills = matches!(injection.kind, FaultKind::Kill { .. } | FaultKind::TornWrite { .. });
        let bare_ns = if kills { self.bare() } else { None };
        let target = injection.target;
        let epoch = self.epoch(target);
        let period_s = self.grid.period as f64 * 1e-9;
        let n = self.grid.tick_at(clock::now()) + 3;
        let duration = fault_ticks(&injection.kind, period_s) * self.grid.period;
        let mut made = Made::skipped(injection.clone(), "");
        (made.skipped, made.bare_ns) = (None, bare_ns);
        let timing = &self.resolved.scenario.timing;
        if let Some((kind, ticks, value)) = order(&injection, timing.period_s(), timing.output_phase) {
            // Far enough ahead that it is there in time.
            let from = n + 20;
            let number = self.orders.as_ref().map_or(0, RegionWriter::head);
            let order = Fault {
                tick: number,
                target: number_of(target),
                kind,
                from_tick: from,
                end_tick: from + ticks,
                value,
            };
            if let Some(orders) = &mut self.orders {
                let _ = orders.write(number, order.words());
            }
            (made.tick, made.at_ns) = (from, from * self.grid.period);
            clock::sleep_until(self.grid.at(from, 0.0), 0);
            if kind != fault_kind::TORN_WRITE {
                clock::sleep_until(self.grid.at(from + ticks.min(duration / self.grid.period + 1), 0.0), 0);
            }
        } else {
            let when = self.grid.at(n, injection.phase);
            clock::sleep_until(when, 20_000);
            let now = clock::now();
            (made.tick, made.at_ns) = (self.grid.tick_at(now), now - self.grid.t0);
            match &injection.kind {
                FaultKind::Kill { .. } if target == Target::Supervisor => self.replace_supervisor(),
                FaultKind::Kill { .. } => {
                    let killed = self.writer(target).is_some_and(|pid| signal(pid, Signal::KILL));
                    made.skipped = (!killed).then(|| "was not there".to_owned());
                }
                FaultKind::Stop { .. } => {
                    let pid = self.writer(target).unwrap_or(0);
                    if pid != 0 && signal(pid, Signal::STOP) {
                        clock::sleep_until(now + duration, 0);
                        signal(pid, Signal::CONT);
                    }
                }
                FaultKind::Scribble { place, ticks, .. } => {
                    match self.scribble(target, *place, u64::from(*ticks), injection.seed) {
                        Ok((ticks, put_right)) => (made.scribbled, made.put_right) = (ticks, put_right),
                        Err(why) => made.skipped = Some(why),
                    }
                }
                FaultKind::DiskFull { .. } => {
                    if let Err(why) = self.fill_disk(duration) {
                        made.skipped = Some(why);
                    }
                }
                _ => {}
            }
        }
        if kills {
            made.back_ns = self.wait_back(target, epoch);
        }
        if !kills || made.back_ns.is_some() {
            // What the ECU saw of it comes back with its diagnosis, a message of 100 ms.
            let settle_s = if matches!(made.injection.kind, FaultKind::Can { .. }) { 0.3 } else { 0.02 };
            made.running_tick = self.wait_running(settle_s);
        }
        made
    }

    /// Waits until the region of a service has a new writer.
    fn wait_back(&mut self, target: Target, epoch: u64) -> Option<u64> {
        let limit = clock::now() + self.recover_max_ns();
        loop {
            let now = clock::now();
            if self.epoch(target) > epoch && self.writer(target).is_some() {
                return Some(now - self.grid.t0);
            }
            if now > limit {
                return None;
            }
            clock::sleep_until(now + 500_000, 0);
        }
    }

    fn replace_supervisor(&mut self) {
        self.pids.insert(self.supervisor.id());
        let _ = self.supervisor.kill();
        let _ = self.supervisor.wait();
        let said = std::fs::File::options()
            .append(true)
            .create(true)
            .open(self.directory.with_extension("stderr.txt"));
        let next = Command::new(&self.executable)
            .args(["attach", self.bench.name().as_str(), "--json", "--no-report", "--rearm"])
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(said.map_or_else(|_| Stdio::null(), Stdio::from))
            .spawn();
        if let Ok(next) = next {
            self.supervisor = next;
        }
    }

    /// Writes random words into a region as any program of the same user can: through its file. Returns the ticks that
    /// were hit and whether a header was put right in time.
    fn scribble(
        &self,
        target: Target,
        place: Place,
        ticks: u64,
        seed: u64,
    ) -> Result<(Vec<u64>, bool), String> {
        let id = if target == Target::Rig { RegionId::RigMeasurement } else { region_of(target) };
        let reader = self.table.reader(id as usize);
        let path = Path::new("/dev/shm").join(reader.segment_name().unwrap_or_default());
        let file = std::fs::OpenOptions::new().write(true).open(&path);
        let file = file.map_err(|e| format!("{}: {e}", path.display()))?;
        let mut random = Random::new(seed);
        let mut write = |word: u64, count: u64| -> Result<(), String> {
            let bytes: Vec<u8> = (0..count).flat_map(|_| random.bits().to_ne_bytes()).collect();
            file.write_all_at(&bytes, 8 * word).map_err(|e| format!("{}: {e}", path.display()))
        };
        if place == Place::Header {
            let layout = reader.layout();
            write(0, 9)?;
            let limit = clock::now() + SECOND;
            while reader.header().magic() != table::MAGIC || reader.layout() != layout {
                if clock::now() > limit {
                    return Ok((Vec::new(), false));
                }
                clock::sleep_until(clock::now() + 500_000, 0);
            }
            return Ok((Vec::new(), true));
        }
        let (head_word, stride) = (table::HEADER_WORDS as u64, 1 + reader.words() as u64);
        let mut hit = Vec::new();
        let limit = clock::now() + self.recover_max_ns();
        let mut tick = reader.head();
        while (hit.len() as u64) < ticks && clock::now() < limit {
            let head = reader.head();
            // Only right behind the publication of a tick.
            if head != tick + 1 {
                tick = if head > tick + 1 { head } else { tick };
                std::hint::spin_loop();
                continue;
            }
            let slot = head_word + 1 + (tick % reader.depth() as u64) * stride;
            match place {
                Place::Payload => write(slot + 1, stride - 1)?,
                Place::Stamp => write(slot, 1)?,
                Place::Head => write(head_word, 1)?,
                Place::Header => {}
            }
            hit.push(tick);
            tick += 1;
        }
        Ok((if place == Place::Head { Vec::new() } else { hit }, true))
    }

    /// A limit on the size of the logger's files is a full disk to it.
    fn fill_disk(&mut self, duration: Nanos) -> Result<(), String> {
        let pid = self.writer(Target::Logger).and_then(|pid| Pid::from_raw(pid.cast_signed()));
        let files = record::log_files(&self.directory).map_err(|e| e.to_string())?;
        let size = files.last().and_then(|path| path.metadata().ok()).map_or(0, |data| data.len());
        let full = Rlimit { current: Some(size), maximum: None };
        let before = prlimit(pid, Resource::Fsize, full).map_err(|e| format!("limit on file sizes: {e}"))?;
        clock::sleep_until(clock::now() + duration, 0);
        prlimit(pid, Resource::Fsize, before).map(drop).map_err(|e| format!("limit on file sizes: {e}"))
    }

    /// Ends the run and says what it left that it should not have.
    fn end(mut self) -> Vec<String> {
        let mut faults = Vec::new();
        for target in self.everybody() {
            self.writer(target);
        }
        // A region that somebody writes is not removed.
        self.orders = None;
        signal(self.supervisor.id(), Signal::INT);
        let limit = clock::now() + PATIENCE_NS;
        loop {
            match self.supervisor.try_wait() {
                Ok(Some(status)) => {
                    if !matches!(status.code(), Some(130 | 0 | 1)) {
                        faults.push(format!("the supervisor ended with {status}"));
                    }
                    break;
                }
                _ if clock::now() > limit => {
                    faults.push("the run did not end in time and was killed".to_owned());
                    let _ = self.supervisor.kill();
                    let _ = self.supervisor.wait();
                    for &pid in &self.pids {
                        signal(pid, Signal::KILL);
                    }
                    break;
                }
                _ => clock::sleep_until(clock::now() + 20_000_000, 0),
            }
        }
        reap();
        drop(self.table);
        if let Ok(left) = table::list_bench(self.bench)
            && !left.is_empty()
        {
            faults.push(format!("{} segments of shared memory were left over", left.len()));
        }
        let alive: Vec<_> =
            self.pids.iter().filter(|pid| Path::new(&format!("/proc/{pid}/exe")).exists()).collect();
        if !alive.is_empty() {
            faults.push(format!("processes {alive:?} were left over"));
        }
        let files = std::fs::read_dir(self.bench.directory()).into_iter().flatten().flatten();
        let files: Vec<_> = files.map(|file| file.path().display().to_string()).collect();
        if !files.is_empty() {
            faults.push(format!("files were left over: {}", files.join(", ")));
        }
        faults
    }
}

/// Collects the services of a killed supervisor, which became this process's children.
pub fn reap() {
    while let Ok(Some(_)) = rustix::process::wait(rustix::process::WaitOptions::NOHANG) {}
}

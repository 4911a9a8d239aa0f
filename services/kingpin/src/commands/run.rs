//! `run`: the main job. Resolve, build, run, then log, summary and report.

use crate::args::{AttachArgs, Lockstep, RunArgs};
use crate::exit::Exit;
use crate::output;
use config::ResolvedBench;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use record::LogReader;
use regions::RigStatus;
use serde_json::json;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use supervisor::{Attach, Mode, Observer, Outcome, Run, RunError};
use table::{Bench, TableError};

/// `kingpin run`.
pub fn run(args: &RunArgs) -> Exit {
    let bench = match Bench::new(&args.name) {
        Ok(bench) => bench,
        Err(error) => return refuse(args, Exit::BadInput, &error.to_string()),
    };
    if !(args.restart_delay.is_finite() && args.restart_delay >= 0.0) {
        return refuse(args, Exit::BadInput, "--restart-delay: must be 0 or more seconds");
    }
    let mut overrides = args.set.clone();
    if let Some(duration) = args.duration {
        overrides.push(format!("duration_s={duration:?}"));
    }
    let resolved = match super::configuration::load(&args.scenario, &overrides, args.json) {
        Ok(resolved) => resolved,
        Err(exit) => return exit,
    };
    if args.operate && args.lockstep.is_some() {
        return refuse(args, Exit::BadInput, "--operate: needs a run by the clock, not --lockstep");
    }
    let directory = match make_directory(args, &resolved) {
        Ok(directory) => directory,
        Err(error) => return refuse(args, Exit::Unavailable, &error),
    };
    let mode = match args.lockstep {
        None => Mode::Paced,
        Some(Lockstep::Process) => Mode::LockstepProcess,
        Some(Lockstep::Set) => Mode::LockstepSet,
    };
    let interrupt = interruptible();
    let run = Run {
        bench,
        resolved,
        directory: directory.path.clone(),
        mode,
        restart_delay_ns: (args.restart_delay * 1e9) as u64,
        rearm: args.rearm,
        faults: args.faults,
        fault_plan: Vec::new(),
        versions: versions(),
        operated: args.operate,
    };
    let beside = args.console.then(|| super::console::Beside::start(&args.name, args.console_port));
    if let Some(Err(error)) = &beside {
        output::note(format!("the run has no console: {error}"));
    }
    let mut view = View::new(&run, args.json);
    let outcome = supervisor::run(&run, &interrupt, &mut view);
    drop(beside);
    view.bar.finish_and_clear();
    match outcome {
        Ok(outcome) => finish(Ending { json: args.json, report: !args.no_report }, &run, &outcome),
        Err(error) => {
            directory.discard();
            if interrupt.load(Ordering::Relaxed) {
                output::note("interrupted before the run began");
                return Exit::Interrupted;
            }
            refuse(args, exit_of(&error), &error.to_string())
        }
    }
}

/// `kingpin attach`.
pub fn attach(args: &AttachArgs) -> Exit {
    let bench = match Bench::new(&args.name) {
        Ok(bench) => bench,
        Err(error) => return say(args.json, Exit::BadInput, &error.to_string()),
    };
    let interrupt = interruptible();
    let attach = Attach { bench, rearm: args.rearm, restart_delay_ns: 0 };
    let mut view = View::named(&args.name, args.json);
    let outcome = supervisor::attach(&attach, &interrupt, &mut view);
    view.bar.finish_and_clear();
    match outcome {
        Ok((run, outcome)) => finish(Ending { json: args.json, report: !args.no_report }, &run, &outcome),
        Err(error) => say(args.json, exit_of(&error), &error.to_string()),
    }
}

/// A flag that Ctrl-C and SIGTERM set.
pub fn interruptible() -> Arc<AtomicBool> {
    let interrupt = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        // A second Ctrl-C kills at once, as people expect.
        let _ = signal_hook::flag::register_conditional_shutdown(signal, 130, Arc::clone(&interrupt));
        let _ = signal_hook::flag::register(signal, Arc::clone(&interrupt));
    }
    interrupt
}

fn exit_of(error: &RunError) -> Exit {
    match error {
        RunError::Table(TableError::BenchName { .. }) | RunError::Assembly(_) => Exit::BadInput,
        RunError::ServiceEnded { .. } | RunError::Tick(_) | RunError::Service(_) => Exit::Failed,
        _ => Exit::Unavailable,
    }
}

/// How a run's end is told.
#[derive(Debug, Clone, Copy)]
struct Ending {
    json: bool,
    report: bool,
}

fn refuse(args: &RunArgs, exit: Exit, error: &str) -> Exit {
    say(args.json, exit, error)
}

/// Says what ends a command.
pub(super) fn say(json: bool, exit: Exit, error: &str) -> Exit {
    if json {
        output::json(&json!({ "error": error }));
    } else {
        output::note(error);
    }
    exit
}

/// Summary, report and verdict of a run that was made.
fn finish(args: Ending, run: &Run, outcome: &Outcome) -> Exit {
    let mut failures = Vec::new();
    let state = regions::state_name(outcome.last_status.state);
    if outcome.last_status.trip_code != 0 {
        failures.push(format!(
            "tripped: code {} at tick {}",
            outcome.last_status.trip_code, outcome.last_status.trip_tick
        ));
    } else if state != "idle" {
        failures.push(format!("the rig ended in state {state}, not idle"));
    }
    failures.extend(outcome.given_up.clone());
    if outcome.logged.lost_count > 0 {
        failures.push(format!("the logger lost {} ticks", outcome.logged.lost_count));
    }
    if outcome.logged.write_error_count > 0 {
        failures.push(format!("the disk refused {} writes of the log", outcome.logged.write_error_count));
    }
    let simulated_s = outcome.ticks as f64 * outcome.period_s;
    let extra = json!({
        "mode": match run.mode {
            Mode::Paced => "paced",
            Mode::LockstepProcess => "lockstep-process",
            Mode::LockstepSet => "lockstep-set",
        },
        "simulated_s": simulated_s,
        "wall_s": outcome.wall_s,
        "simulated_per_wall": simulated_s / outcome.wall_s,
        "interrupted": outcome.interrupted,
        "end_state": state,
        "restarts": {"rig": outcome.restarts[0], "vehicle": outcome.restarts[1],
            "multibody": outcome.restarts[2], "logger": outcome.restarts[3]},
        "failures": failures,
        "directory": run.directory,
    });
    let written = match LogReader::open(&run.directory) {
        Ok(log) => super::summary::write_all(&log, &run.directory, args.report, &extra),
        Err(error) => Err(format!("the run left no readable log: {error}")),
    };
    let summary = match written {
        Ok(summary) => summary,
        // A disk that refused the log refuses the summary, too: then what was lost is told here at least.
        Err(error) if args.json => {
            output::json(&json!({ "error": error, "run": extra }));
            return Exit::Failed;
        }
        Err(error) => {
            output::note(error);
            failures.iter().for_each(|failure| output::note(format!("NOT AS PLANNED: {failure}")));
            return Exit::Failed;
        }
    };
    if args.json {
        output::json(&summary);
    } else {
        output::line(super::summary::text(&summary));
        output::line(format!(
            "{simulated_s:.2} s simulated in {:.2} s: {:.1} simulated seconds per second",
            outcome.wall_s,
            simulated_s / outcome.wall_s
        ));
        for file in ["log.mcap", "summary.json", "report.html"] {
            let path = run.directory.join(file);
            if path.exists() {
                output::line(format!("  {}", path.display()));
            }
        }
        for failure in &failures {
            output::note(format!("NOT AS PLANNED: {failure}"));
        }
    }
    if !failures.is_empty() {
        Exit::Failed
    } else if outcome.interrupted {
        Exit::Interrupted
    } else {
        Exit::Done
    }
}

/// The run's directory, and what to do with it when the run never began.
struct Directory {
    path: PathBuf,
    made: bool,
}

impl Directory {
    fn discard(&self) {
        let _ = std::fs::remove_file(self.path.join("services.txt"));
        let _ = std::fs::remove_file(self.path.join("log.mcap"));
        if self.made {
            // Only if empty: never anything that is not ours.
            let _ = std::fs::remove_dir(&self.path);
        }
    }
}

fn make_directory(args: &RunArgs, resolved: &ResolvedBench) -> Result<Directory, String> {
    let path = match &args.out {
        Some(path) => path.clone(),
        None => {
            let stamp = timestamp(runtime::clock::wall_now() / 1_000_000_000);
            Path::new("runs").join(format!("{}-{stamp}", resolved.scenario.name))
        }
    };
    let there = path.is_dir();
    if there && record::log_files(&path).is_ok_and(|files| !files.is_empty()) {
        return Err(format!("{}: holds a log already; name another directory with --out", path.display()));
    }
    std::fs::create_dir_all(&path).map_err(|e| format!("{}: {e}", path.display()))?;
    Ok(Directory { path, made: !there })
}

/// UTC date and time of Unix seconds, `YYYYMMDD-HHMMSS` (proleptic Gregorian calendar).
pub fn timestamp(seconds: u64) -> String {
    let (days, rest) = (seconds / 86400, seconds % 86400);
    // Days since 0000-03-01 in cycles of 400 years.
    let z = days + 719_468;
    let era = z / 146_097;
    let day_of_era = z % 146_097;
    let year_of_era = (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let shifted_month = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * shifted_month + 2) / 5 + 1;
    let month = if shifted_month < 10 { shifted_month + 3 } else { shifted_month - 9 };
    let year = year_of_era + era * 400 + u64::from(month <= 2);
    format!("{year:04}{month:02}{day:02}-{:02}{:02}{:02}", rest / 3600, rest / 60 % 60, rest % 60)
}

pub fn versions() -> BTreeMap<String, String> {
    let kernel = rustix::system::uname();
    BTreeMap::from([
        ("kingpin".to_owned(), env!("CARGO_PKG_VERSION").to_owned()),
        ("kernel".to_owned(), kernel.release().to_string_lossy().into_owned()),
        ("machine".to_owned(), kernel.machine().to_string_lossy().into_owned()),
    ])
}

/// The progress bar.
struct View {
    bar: ProgressBar,
    period_s: f64,
    quiet: bool,
}

impl View {
    fn new(run: &Run, quiet: bool) -> Self {
        let mut view = Self::named(&run.resolved.scenario.name, quiet);
        view.period_s = run.resolved.scenario.timing.period_s();
        view
    }

    fn named(name: &str, quiet: bool) -> Self {
        let bar = ProgressBar::new(0);
        if quiet {
            bar.set_draw_target(ProgressDrawTarget::hidden());
        } else {
            bar.set_draw_target(ProgressDrawTarget::stderr_with_hz(8));
        }
        let style = ProgressStyle::with_template("{prefix} {bar:30} {msg}");
        bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
        bar.set_prefix(name.to_owned());
        View { bar, period_s: 1e-3, quiet }
    }
}

impl Observer for View {
    fn progress(&mut self, done: u64, all: u64, status: &RigStatus) {
        self.bar.set_length(all);
        self.bar.set_position(done);
        self.bar.set_message(format!(
            "{:6.2} s of {:.2} s  {:9}  tie rods {:+6.0} N {:+6.0} N  late {}",
            done as f64 * self.period_s,
            all as f64 * self.period_s,
            regions::state_name(status.state),
            status.tie_rod_force_applied_n[0],
            status.tie_rod_force_applied_n[1],
            status.late_command_count
        ));
    }

    fn note(&mut self, line: &str) {
        if self.quiet || self.bar.is_hidden() {
            output::note(line);
        } else {
            self.bar.println(line);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_stamps_are_calendar_dates() {
        assert_eq!(timestamp(0), "19700101-000000");
        assert_eq!(timestamp(951_782_400), "20000229-000000");
        assert_eq!(timestamp(1_709_251_199), "20240229-235959");
        assert_eq!(timestamp(4_102_444_800), "21000101-000000");
    }
}

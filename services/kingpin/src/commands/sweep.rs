//! `sweep`: a parameter study on the cores of this machine.
//!
//! Each worker is a process of its own that makes one run after the other in memory and keeps each in the study's
//! journal: whatever kills a worker, or all of them, the finished runs stay, and only the others are made again. The
//! numbers of the runs are handed out one at a time through a pipe; a worker whose pipe ends, ends.

use crate::exit::Exit;
use crate::output;
use clap::Args as ClapArgs;
use config::study::Study;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde_json::json;
use std::collections::VecDeque;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use study::{Cell, Journal, Prepared, Row, write_results};

/// A run that killed its worker is tried so often before it becomes a row with an error.
const TRIES: u32 = 2;

const ABOUT: &str = "\
STUDY is a TOML file, or the bare name of a shipped one (see `kingpin list studies`; `kingpin schema study` for your
editor). It names a scenario, what is varied (lists, ranges; on a grid, at random, in a Latin hypercube) and which
figures are kept: figures of the standard's procedure, numbers of summary.json, statistics of signals.

In DIR:
  results.parquet, results.csv   one row a run: run, seed, parameters, figures, error (empty if nothing is wrong)
  report.html                    spans, correlations, each figure over the parameter that it follows most
  journal/                       finished runs; a sweep that was interrupted goes on with the others

The table depends on nothing but the study: not on the number of workers, their order, or interruptions. A run that
cannot be built, trips, or kills its worker twice is a row with its error. Exit code 0 if any run gave figures.

Examples:
  kingpin sweep assist_feel --jobs 8 --out runs/assist_feel
  kingpin sweep my_study.toml --set sampling.runs=50 --plan
  kingpin sweep quick && python -c \"import pandas; print(pandas.read_parquet('runs/quick/results.parquet'))\"

On a cluster: kingpin.sweep(study, client=...) of the Python package, with Dask (docs/PYTHON.md).";

/// Arguments of `sweep`.
#[derive(Debug, ClapArgs)]
#[command(after_help = ABOUT)]
pub struct SweepArgs {
    /// A shipped study or a TOML file
    pub study: String,
    /// Replace a value of the study, as in `run`
    #[arg(long, value_name = "PATH=VALUE")]
    pub set: Vec<String>,
    /// Where results and journal go [default: runs/NAME of the study]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Workers [default: as many as there are cores]
    #[arg(long, value_name = "N")]
    pub jobs: Option<usize>,
    /// Only print which runs there are
    #[arg(long)]
    pub plan: bool,
    /// Print what was done as JSON
    #[arg(long)]
    pub json: bool,
    /// Make the runs whose numbers come in, for this study (started by `sweep`)
    #[arg(long, hide = true, value_name = "HASH")]
    pub worker: Option<String>,
}

/// `kingpin sweep`.
pub fn sweep(args: &SweepArgs) -> Exit {
    let refuse = |exit: Exit, error: serde_json::Value, text: &str| {
        if args.json {
            output::json(&error);
        } else {
            output::note(text);
        }
        exit
    };
    let loaded = config::load_with::<Study>(&args.study, &args.set).map(|loaded| loaded.value);
    let prepared = match loaded.and_then(Prepared::new) {
        Ok(prepared) => prepared,
        Err(problems) => return refuse(Exit::BadInput, problems.to_json(), &problems.to_string()),
    };
    if args.plan {
        return plan(&prepared, args.json);
    }
    let directory = args.out.clone().unwrap_or_else(|| Path::new("runs").join(&prepared.study.name));
    let journal = match Journal::open(&directory, &prepared.hash) {
        Ok(journal) => journal,
        Err(error) => return refuse(Exit::BadInput, json!({ "error": error }), &error),
    };
    if let Some(hash) = &args.worker {
        return work(&prepared, hash, &journal);
    }
    let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    let jobs = args.jobs.unwrap_or(cores).max(1);
    let begin = Instant::now();
    let before = journal.rows().len() as u64;
    let interrupt = super::run::interruptible();
    let made = Pool::new(args, &prepared, &journal, &directory).run(jobs, &interrupt);
    let mut rows: Vec<Row> = journal.rows().into_values().collect();
    if let Err(error) = write_results(&prepared, &mut rows, &directory) {
        let error = error.to_string();
        return refuse(Exit::Unavailable, json!({ "error": error }), &error);
    }
    let errors = rows.iter().filter(|row| !row.error.is_empty()).count();
    let complete = rows.len() as u64 == prepared.runs();
    let wall_s = begin.elapsed().as_secs_f64();
    if args.json {
        output::json(&json!({
            "study": prepared.study.name, "hash": prepared.hash, "directory": directory, "complete": complete,
            "runs": prepared.runs(), "finished": rows.len(), "made_now": made, "taken_over": before,
            "with_error": errors, "wall_s": wall_s, "workers": jobs,
        }));
    } else {
        output::line(format!(
            "{}: {} of {} runs finished ({before} before, {made} now in {wall_s:.1} s on {jobs} workers), {errors} with \
             an error",
            prepared.study.name,
            rows.len(),
            prepared.runs()
        ));
        for file in ["results.parquet", "results.csv", "report.html"] {
            output::line(format!("  {}", directory.join(file).display()));
        }
    }
    if interrupt.load(Ordering::Relaxed) && !complete {
        output::note("interrupted: the same command goes on with the other runs");
        return Exit::Interrupted;
    }
    if !complete || errors == rows.len() { Exit::Failed } else { Exit::Done }
}

fn plan(prepared: &Prepared, as_json: bool) -> Exit {
    let names: Vec<&str> = prepared.study.parameter.iter().map(|p| p.name.as_str()).collect();
    if as_json {
        let runs: Vec<_> = (0..prepared.runs())
            .map(|run| json!({"run": run, "seed": prepared.seed(run), "parameters": prepared.parameters(run), "set": prepared.overrides(run)}))
            .collect();
        output::json(
            &json!({ "study": prepared.study.name, "hash": prepared.hash, "parameters": names, "runs": runs }),
        );
        return Exit::Done;
    }
    let mut rows = vec![["run"].into_iter().chain(names).map(str::to_owned).collect::<Vec<_>>()];
    for run in 0..prepared.runs() {
        let cells = prepared.parameters(run).into_iter().map(|cell| match cell {
            Cell::Number(number) => {
                format!("{number:.6}").trim_end_matches('0').trim_end_matches('.').to_owned()
            }
            Cell::Text(text) => text,
        });
        rows.push(std::iter::once(run.to_string()).chain(cells).collect());
    }
    output::line(output::columns(&rows).trim_end());
    Exit::Done
}

/// A worker: a number in, the run made and kept, the number out.
fn work(prepared: &Prepared, hash: &str, journal: &Journal) -> Exit {
    // Ctrl-C reaches the whole group; whether it ends the study is decided by who hands out the runs.
    let _ =
        signal_hook::flag::register(signal_hook::consts::SIGINT, std::sync::Arc::new(AtomicBool::new(false)));
    if hash != prepared.hash {
        output::note("the study was changed while it ran");
        return Exit::BadInput;
    }
    for line in std::io::stdin().lock().lines() {
        let Some(run) = line.ok().and_then(|line| line.trim().parse::<u64>().ok()) else { break };
        let begin = Instant::now();
        let Ok(row) = prepared.evaluate(run, |_, _| Ok(())) else { break };
        if let Err(error) = journal.keep(&row, begin.elapsed().as_secs_f64()) {
            output::note(error);
            return Exit::Unavailable;
        }
        output::line(run);
    }
    Exit::Done
}

/// The workers and what is left to do.
struct Pool<'a> {
    args: &'a SweepArgs,
    prepared: &'a Prepared,
    journal: &'a Journal,
    directory: &'a Path,
    /// Runs to be made, with how often they were tried.
    left: Mutex<VecDeque<(u64, u32)>>,
    children: Mutex<Vec<Child>>,
    bar: ProgressBar,
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl<'a> Pool<'a> {
    fn new(args: &'a SweepArgs, prepared: &'a Prepared, journal: &'a Journal, directory: &'a Path) -> Self {
        let done = journal.rows();
        let left = (0..prepared.runs()).filter(|run| !done.contains_key(run)).map(|run| (run, 0)).collect();
        let bar = ProgressBar::new(prepared.runs());
        bar.set_draw_target(if args.json {
            ProgressDrawTarget::hidden()
        } else {
            ProgressDrawTarget::stderr_with_hz(8)
        });
        let style =
            ProgressStyle::with_template("{prefix} {bar:30} {pos} of {len} runs  {elapsed}, {eta} left");
        bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
        bar.set_prefix(prepared.study.name.clone());
        bar.set_position(done.len() as u64);
        bar.reset_eta();
        Pool { args, prepared, journal, directory, left: Mutex::new(left), children: Mutex::default(), bar }
    }

    /// Makes what is left; how many runs were made.
    fn run(self, jobs: usize, interrupt: &AtomicBool) -> u64 {
        let before = self.bar.position();
        std::thread::scope(|scope| {
            let jobs = jobs.min(locked(&self.left).len());
            let threads: Vec<_> = (0..jobs).map(|_| scope.spawn(|| self.feed(interrupt))).collect();
            while threads.iter().any(|thread| !thread.is_finished()) {
                std::thread::sleep(Duration::from_millis(50));
                if interrupt.load(Ordering::Relaxed) {
                    // Runs that are not finished are made again next time.
                    for child in locked(&self.children).iter_mut() {
                        let _ = child.kill();
                    }
                }
            }
        });
        self.bar.finish_and_clear();
        self.bar.position() - before
    }

    /// Keeps one worker at work, and replaces it when it dies.
    fn feed(&self, interrupt: &AtomicBool) {
        while !interrupt.load(Ordering::Relaxed) && !locked(&self.left).is_empty() {
            let mut child = match self.start() {
                Ok(child) => child,
                Err(error) => {
                    self.bar.println(format!("a worker cannot be started: {error}"));
                    return;
                }
            };
            let pipes = child.stdin.take().zip(child.stdout.take());
            let id = child.id();
            locked(&self.children).push(child);
            let Some((mut to, from)) = pipes else { return };
            let mut from = BufReader::new(from);
            let mut lost = None;
            while !interrupt.load(Ordering::Relaxed) {
                let Some((run, tries)) = locked(&self.left).pop_front() else { break };
                let mut answer = String::new();
                let asked = writeln!(to, "{run}").and_then(|()| to.flush());
                let answered = asked.is_ok() && from.read_line(&mut answer).is_ok_and(|bytes| bytes > 0);
                if !answered || answer.trim() != run.to_string() {
                    lost = Some((run, tries + 1));
                    break;
                }
                self.bar.inc(1);
            }
            drop(to);
            let how = self.end(id);
            if let Some((run, tries)) = lost
                && !interrupt.load(Ordering::Relaxed)
            {
                self.lose(run, tries, &how);
            }
        }
    }

    fn start(&self) -> std::io::Result<Child> {
        let mut command = Command::new(std::env::current_exe()?);
        command.arg("sweep").arg(&self.args.study).arg("--worker").arg(&self.prepared.hash);
        command.arg("--out").arg(self.directory);
        for set in &self.args.set {
            command.arg("--set").arg(set);
        }
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn()
    }

    /// Waits for a worker; how it ended.
    fn end(&self, id: u32) -> String {
        let child = {
            let mut children = locked(&self.children);
            let place = children.iter().position(|child| child.id() == id);
            place.map(|place| children.swap_remove(place))
        };
        let ended = child.map(|mut child| child.wait());
        match ended {
            Some(Ok(status)) => status.to_string(),
            Some(Err(error)) => error.to_string(),
            None => String::new(),
        }
    }

    /// A run whose worker died is made again, or given up.
    fn lose(&self, run: u64, tries: u32, how: &str) {
        // It may have been kept just before.
        if self.journal.rows().contains_key(&run) {
            self.bar.inc(1);
            return;
        }
        self.bar.println(format!("run {run}: its worker died ({how})"));
        if tries < TRIES {
            locked(&self.left).push_back((run, tries));
            return;
        }
        let row = Row {
            run,
            seed: self.prepared.seed(run),
            parameters: self.prepared.parameters(run),
            metrics: vec![None; self.prepared.study.metric.len()],
            error: format!("its worker died {tries} times ({how})"),
        };
        match self.journal.keep(&row, 0.0) {
            Ok(()) => self.bar.inc(1),
            Err(error) => self.bar.println(error),
        }
    }
}

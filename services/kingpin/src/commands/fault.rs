//! `fault`: runs a fault campaign and says whether every reaction was the expected one.

mod arguments;
mod judge;
mod judge_can;
mod lockstep;
mod paced;
mod page;
mod replay;
mod round;
mod schedule;

pub use arguments::FaultArgs;

use crate::exit::Exit;
use crate::output;
use assembly::ServiceKind;
use config::ResolvedBench;
use config::campaign::{Campaign, CampaignDrive, FaultKind, Target};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use judge::{Judgement, Outcome};
use record::LogReader;
use regions::RigStatus;
use round::{Made, Round};
use schedule::{Injection, fault_ticks};
use serde_json::{Value, json};
use std::collections::{BTreeMap, VecDeque};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use supervisor::Observer;
use table::Bench;

/// A fault that says nothing because the host stalled is made again, up to this often.
const TRIES_MAX: u32 = 5;

/// Regions of the log that are read.
const READ: [&str; 9] = [
    "rig_timing",
    "can",
    "bench",
    "rig_measurement",
    "vehicle_state",
    "suspension_state",
    "rig_status",
    "faults",
    "parameters",
];

/// What all runs of a campaign gave.
#[derive(Default)]
struct Result {
    judgements: Vec<Judgement>,
    /// Of runs as a whole.
    faults: Vec<String>,
    replays: BTreeMap<&'static str, replay::Replayed>,
    plots: Vec<page::Window>,
    runs: usize,
    kept: Vec<PathBuf>,
    bit_identical: Option<bool>,
}

/// `kingpin fault`.
pub fn fault(args: &FaultArgs) -> Exit {
    let fail = |exit: Exit, error: Value, text: &str| {
        if args.json {
            output::json(&error)
        } else {
            output::note(text)
        }
        exit
    };
    let campaign = match config::load_with::<Campaign>(&args.campaign, &args.set) {
        Ok(loaded) => loaded.value,
        Err(problems) => return fail(Exit::BadInput, problems.to_json(), &problems.to_string()),
    };
    let resolved = match super::history::load_bench(&campaign.scenario, &campaign.set) {
        Ok(resolved) => resolved,
        Err(problems) => return fail(Exit::BadInput, problems.to_json(), &problems.to_string()),
    };
    let refuse = |exit: Exit, text: String| fail(exit, json!({ "error": text }), &text);
    let bench = match Bench::new(&args.name) {
        Ok(bench) => bench,
        Err(error) => return refuse(Exit::BadInput, error.to_string()),
    };
    let directory = args.out.clone().unwrap_or_else(|| {
        let stamp = super::run::timestamp(runtime::clock::wall_now() / 1_000_000_000);
        Path::new("runs").join(format!("{}-{stamp}", campaign.name))
    });
    if directory.join("faults.json").exists() {
        let text = format!("{} holds the results of a campaign already", directory.display());
        return refuse(Exit::BadInput, text);
    }
    if let Err(error) = std::fs::create_dir_all(&directory) {
        return refuse(Exit::Unavailable, format!("{}: {error}", directory.display()));
    }
    let interrupt = super::run::interruptible();
    // Orphans of killed supervisors become ours, and are collected.
    let _ = rustix::process::set_child_subreaper(Some(rustix::process::getpid()));
    let mut all = schedule::schedule(&campaign);
    if let Err(error) = schedule::bind(&mut all, &resolved) {
        return refuse(Exit::BadInput, format!("campaign {}: {error}", campaign.name));
    }
    let bar = progress(&campaign, args.json);
    let result = match campaign.drive {
        CampaignDrive::Paced => {
            run_paced(args, &campaign, &resolved, &bench, &directory, &interrupt, &bar, all)
        }
        CampaignDrive::Lockstep => {
            run_lockstep(args, &campaign, resolved, &bench, &directory, &interrupt, &bar, &all)
        }
    };
    bar.finish_and_clear();
    paced::reap();
    let result = match result {
        Ok(result) => result,
        Err(error) => return refuse(Exit::Unavailable, error),
    };
    let summary = summarise(&campaign, &result);
    let json_path = directory.join("faults.json");
    let html_path = directory.join("faults.html");
    let text = serde_json::to_string_pretty(&summary).unwrap_or_default();
    let written =
        super::log::write_whole(&json_path, |out| out.write_all(text.as_bytes()).map_err(|e| e.to_string()))
            .and_then(|()| {
                let html = page::html(&campaign, &summary, &result.plots);
                super::log::write_whole(&html_path, |out| {
                    out.write_all(html.as_bytes()).map_err(|e| e.to_string())
                })
            });
    if let Err(error) = written {
        return refuse(Exit::Unavailable, error);
    }
    if args.json {
        output::json(&summary);
    } else {
        output::line(page::text(&summary));
        output::line(format!("  {}\n  {}", json_path.display(), html_path.display()));
    }
    if interrupt.load(Ordering::Relaxed) {
        Exit::Interrupted
    } else if summary["passed"] == json!(true) {
        Exit::Done
    } else {
        Exit::Failed
    }
}

fn progress(campaign: &Campaign, quiet: bool) -> ProgressBar {
    let bar = ProgressBar::new(campaign.faults());
    if quiet {
        bar.set_draw_target(ProgressDrawTarget::hidden());
    }
    let style = ProgressStyle::with_template("{prefix} {bar:30} {pos}/{len} {msg}");
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar.set_prefix(campaign.name.clone());
    bar
}

#[allow(clippy::too_many_arguments)]
fn run_paced(
    args: &FaultArgs,
    campaign: &Campaign,
    resolved: &ResolvedBench,
    bench: &Bench,
    directory: &Path,
    interrupt: &AtomicBool,
    bar: &ProgressBar,
    all: Vec<Injection>,
) -> std::result::Result<Result, String> {
    let mut queue: VecDeque<Injection> = all.into();
    let mut result = Result::default();
    let mut barren = 0;
    while !queue.is_empty() && !interrupt.load(Ordering::Relaxed) {
        let count = queue.len().min(campaign.faults_per_run as usize);
        let injections: Vec<_> = queue.drain(..count).collect();
        let planned = injections.clone();
        let place = directory.join(format!("run{:03}", result.runs));
        let round = paced::round(campaign, resolved, bench, &place, injections, interrupt, |made| {
            bar.set_message(format!("{} {}", made.injection.kind.name(), made.injection.target.name()));
            bar.inc(1);
        });
        // A run that ended early owes the rest.
        for injection in planned.into_iter().skip(round.made.len()).rev() {
            queue.push_front(injection);
        }
        barren = if round.made.is_empty() { barren + 1 } else { 0 };
        let again = take(&mut result, &round, resolved, campaign, args.keep);
        bar.set_length(bar.position() + (queue.len() + again.len()) as u64);
        queue.extend(again);
        if barren >= 3 {
            return Err(format!("the bench does not start: {}", result.faults.join("; ")));
        }
    }
    Ok(result)
}

/// Judges a run, replays it, and removes its files if there is no reason to keep them. What is to be made again.
fn take(
    result: &mut Result,
    round: &Round,
    resolved: &ResolvedBench,
    campaign: &Campaign,
    keep: bool,
) -> Vec<Injection> {
    let number = result.runs;
    result.runs += 1;
    let named = |what: String| format!("run {number}: {what}");
    let log = match LogReader::open_regions(&round.directory, |name| READ.contains(&name)) {
        Ok(log) => log,
        Err(error) => {
            result.faults.extend(round.faults.iter().cloned().map(named));
            result.faults.push(named(format!("no readable log: {error}")));
            result.kept.push(round.directory.clone());
            return Vec::new();
        }
    };
    let (judgements, whole) = match judge::judge(round, &log, resolved, campaign.drive) {
        Ok(judged) => judged,
        Err(error) => (Vec::new(), vec![error]),
    };
    let mut bad = !whole.is_empty();
    // Where another program wrote into the table, the log is not what was used: nothing to step again from.
    let falsified = round.made.iter().any(|made| !made.scribbled.is_empty());
    result.faults.extend(whole.into_iter().map(named));
    for (name, kind, target) in [
        ("vehicle", ServiceKind::Vehicle, Target::Vehicle),
        ("multibody", ServiceKind::Multibody, Target::Multibody),
    ]
    .into_iter()
    .filter(|_| !falsified)
    {
        let spoilt = spoilt_ticks(&round.made, resolved, target);
        let of = |tick: u64| spoilt.iter().any(|(from, to)| (*from..*to).contains(&tick));
        match replay::replay(kind, resolved, &log, of) {
            Ok(replayed) => {
                bad |= replayed.different > 0 || replayed.stopped.is_some();
                let sum = result.replays.entry(name).or_default();
                sum.ticks += replayed.ticks;
                sum.different += replayed.different;
                sum.first = sum.first.take().or(replayed.first);
                sum.stopped = sum.stopped.take().or(replayed.stopped);
            }
            Err(error) => result.faults.push(named(format!("{name} cannot be stepped again: {error}"))),
        }
    }
    let mut again = Vec::new();
    for (made, mut judgement) in round.made.iter().zip(judgements) {
        if judgement.outcome == Outcome::HostStalled && made.injection.tries + 1 < TRIES_MAX {
            let mut injection = made.injection.clone();
            injection.tries += 1;
            again.push(injection);
        }
        if judgement.outcome == Outcome::Failed {
            bad = true;
            judgement.notes.push(format!("run {number}"));
        }
        page::keep_window(&mut result.plots, &log, made, &judgement);
        result.judgements.push(judgement);
    }
    if keep || bad {
        result.kept.push(round.directory.clone());
    } else {
        let _ = std::fs::remove_dir_all(&round.directory);
        let _ = std::fs::remove_file(round.directory.with_extension("stderr.txt"));
    }
    again
}

/// Ticks whose published words a campaign falsified.
fn spoilt_ticks(made: &[Made], resolved: &ResolvedBench, target: Target) -> Vec<(u64, u64)> {
    let period_s = resolved.scenario.timing.period_s();
    made.iter()
        .filter(|m| m.injection.target == target && m.skipped.is_none())
        .filter(|m| matches!(m.injection.kind, FaultKind::Corrupt { .. }))
        .map(|m| (m.tick, m.tick + fault_ticks(&m.injection.kind, period_s)))
        .collect()
}

/// Watches a lockstep run.
struct Quiet<'a>(&'a ProgressBar);

impl Observer for Quiet<'_> {
    fn progress(&mut self, done: u64, all: u64, _: &RigStatus) {
        self.0.set_length(all);
        self.0.set_position(done);
    }

    fn note(&mut self, line: &str) {
        self.0.println(line);
    }
}

#[allow(clippy::too_many_arguments)]
fn run_lockstep(
    args: &FaultArgs,
    campaign: &Campaign,
    resolved: ResolvedBench,
    bench: &Bench,
    directory: &Path,
    interrupt: &AtomicBool,
    bar: &ProgressBar,
    all: &[Injection],
) -> std::result::Result<Result, String> {
    let mut result = Result::default();
    let mut identical = true;
    for injections in all.chunks(campaign.faults_per_run as usize) {
        let (plan, made, duration_s) = lockstep::plan(injections, &resolved);
        let mut run = resolved.clone();
        run.scenario.duration_s = duration_s;
        let place = |copy: &str| directory.join(format!("run{:03}{copy}", result.runs));
        let (first, second) = (place(""), place("b"));
        let one = |place: &Path, made: Vec<Made>| {
            lockstep::round(&run, bench, place, &plan, made, interrupt, &mut Quiet(bar))
        };
        let mut round = one(&first, made);
        let copy = one(&second, Vec::new());
        if interrupt.load(Ordering::Relaxed) {
            break;
        }
        round.faults.extend(copy.faults.iter().map(|what| format!("second time: {what}")));
        if let (Ok(a), Ok(b)) = (LogReader::open(&first), LogReader::open(&second)) {
            let differences = record::compare(&a, &b);
            identical &= differences.is_empty();
            if let Some(difference) = differences.first() {
                round.faults.push(format!("the same seed gave another log: {difference}"));
            }
            if let Ok(phases) = judge::phases(&a) {
                lockstep::running(&mut round.made, &phases);
            }
        }
        take(&mut result, &round, &run, campaign, args.keep);
        if !args.keep && identical {
            let _ = std::fs::remove_dir_all(&second);
        }
    }
    result.bit_identical = Some(identical);
    Ok(result)
}

/// p50 and max of what is there.
fn spread(values: impl Iterator<Item = f64>) -> Value {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    match values.last() {
        Some(max) => json!({ "count": values.len(), "p50": values[values.len() / 2], "max": max }),
        None => Value::Null,
    }
}

fn summarise(campaign: &Campaign, result: &Result) -> Value {
    let mut groups: BTreeMap<(&str, &str), Vec<&Judgement>> = BTreeMap::new();
    for judgement in &result.judgements {
        groups.entry((judgement.kind, judgement.target)).or_default().push(judgement);
    }
    let count = |all: &[&Judgement], outcome| all.iter().filter(|j| j.outcome == outcome).count();
    let rows: Vec<Value> = groups
        .iter()
        .map(|((kind, target), all)| {
            let passed = || all.iter().filter(|j| j.outcome == Outcome::Passed);
            json!({
                "kind": kind, "target": target, "made": all.len() - count(all, Outcome::Skipped),
                "passed": count(all, Outcome::Passed), "failed": count(all, Outcome::Failed),
                "host_stalled": count(all, Outcome::HostStalled), "skipped": count(all, Outcome::Skipped),
                "held_at_stale_count_max": all.iter().filter_map(|j| j.held_at_stale_count).max(),
                "loop_closed_ms": spread(passed().filter_map(|j| j.loop_closed_ms)),
                "back_ms": spread(passed().filter_map(|j| j.back_ms)),
                "bare_ms": spread(passed().filter_map(|j| j.bare_ms)),
                "running_ms": spread(passed().filter_map(|j| j.running_ms)),
                "missed_ticks": spread(passed().map(|j| j.missed_ticks as f64)),
                "jump_m_max": all.iter().filter_map(|j| j.jump_m).reduce(f64::max),
            })
        })
        .collect();
    let everything: Vec<&Judgement> = result.judgements.iter().collect();
    let (passed, failed) = (count(&everything, Outcome::Passed), count(&everything, Outcome::Failed));
    // Every fault of the campaign must have been judged once, whatever the host did in between.
    let mut judged: Vec<usize> =
        everything.iter().filter(|j| j.outcome != Outcome::HostStalled).map(|j| j.number).collect();
    judged.sort_unstable();
    judged.dedup();
    let never = (campaign.faults() as usize).saturating_sub(judged.len());
    let replays_fine =
        result.replays.values().all(|r| r.different == 0 && r.stopped.is_none() && r.ticks > 0);
    let identical = result.bit_identical != Some(false);
    json!({
        "campaign": campaign.name,
        "seed": campaign.seed,
        "drive": campaign.drive,
        "runs": result.runs,
        "faults": campaign.faults(),
        "passed_count": passed,
        "failed_count": failed,
        "host_stalled_count": count(&everything, Outcome::HostStalled),
        "skipped_count": count(&everything, Outcome::Skipped),
        "never_judged_count": never,
        "passed": failed == 0 && never == 0 && result.faults.is_empty() && replays_fine && identical,
        "groups": rows,
        "run_faults": result.faults,
        "stepped_again": result.replays,
        "bit_identical_twice": result.bit_identical,
        "kept": result.kept,
        "judgements": result.judgements,
    })
}

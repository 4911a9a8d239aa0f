//! A run against stated limits. What was not measured is withheld, never passed.

use crate::published::{published_for, worst_published};
use crate::summary::{RunSummary, TrackingFigures};

/// Limits a run is judged by. None: not judged.
#[derive(Debug, Clone, PartialEq)]
pub struct Limits {
    /// Lag of the tie-rod force behind its command. \[s\]
    pub force_lag_max_s: Option<f64>,
    /// Lag of the ball height behind its command. \[s\]
    pub height_lag_max_s: Option<f64>,
    /// Largest tie-rod force error over amplitude. [%] None: half the published figure of this
    /// manoeuvre, or half the worst published one where there is none.
    pub force_error_max_percent: Option<f64>,
    /// Root mean square tie-rod force error over amplitude. [%] None: as above.
    pub force_error_rms_percent: Option<f64>,
    /// Share of ticks whose command may be late for the output phase. \[1\]
    pub late_command_ratio_max: Option<f64>,
    /// Normalised error of a measured record. [%]
    pub record_error_max_percent: Option<f64>,
}

impl Default for Limits {
    /// The bench's own targets: lags of 5 ms and 10 ms, half the published errors, no late command.
    fn default() -> Self {
        Limits {
            force_lag_max_s: Some(0.005),
            height_lag_max_s: Some(0.010),
            force_error_max_percent: None,
            force_error_rms_percent: None,
            late_command_ratio_max: Some(0.0),
            record_error_max_percent: None,
        }
    }
}

/// How a verdict turned out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// Within the limit.
    Pass,
    /// Beyond it.
    Fail,
    /// Could not be told.
    Withheld,
}

/// A figure against its limit.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Verdict {
    /// What is judged.
    pub name: String,
    /// How it turned out.
    pub outcome: Outcome,
    /// What was found, with its unit, or why nothing was.
    pub found: String,
    /// The limit, with its unit.
    pub limit: String,
}

impl Verdict {
    /// Whether it is a fail.
    pub fn failed(&self) -> bool {
        self.outcome == Outcome::Fail
    }
}

fn verdict(name: &str, passed: bool, found: String, limit: &str) -> Verdict {
    let outcome = if passed { Outcome::Pass } else { Outcome::Fail };
    Verdict { name: name.to_owned(), outcome, found, limit: limit.to_owned() }
}

fn withheld(name: &str, reason: &str, limit: &str) -> Verdict {
    Verdict {
        name: name.to_owned(),
        outcome: Outcome::Withheld,
        found: reason.to_owned(),
        limit: limit.to_owned(),
    }
}

/// All verdicts on a run.
pub(crate) fn judge(summary: &RunSummary, limits: &Limits) -> Vec<Verdict> {
    let mut verdicts = vec![judge_state(summary), judge_log(summary), judge_solver(summary)];
    verdicts.extend(judge_late_commands(summary, limits));
    let published = published_for(&summary.scenario);
    for (i, side) in ["left", "right"].into_iter().enumerate() {
        let (peak, rms) = published.map_or_else(worst_published, |p| if i == 0 { p.left } else { p.right });
        let half = (peak / 2.0, rms / 2.0);
        let figures = &summary.force_tracking[i];
        let max = limits.force_error_max_percent.or(Some(half.0));
        let rms = limits.force_error_rms_percent.or(Some(half.1));
        verdicts.extend(at_most(
            &format!("Tie-rod force error {side}, peak"),
            figures,
            |f| f.error_max_percent,
            max,
            "%",
            1.0,
        ));
        verdicts.extend(at_most(
            &format!("Tie-rod force error {side}, rms"),
            figures,
            |f| f.error_rms_percent,
            rms,
            "%",
            1.0,
        ));
        verdicts.extend(at_most(
            &format!("Tie-rod force lag {side}"),
            figures,
            |f| f.lag_s,
            limits.force_lag_max_s,
            "ms",
            1e3,
        ));
        let heights = &summary.height_tracking[i];
        verdicts.extend(at_most(
            &format!("Ball height lag {side}"),
            heights,
            |f| f.lag_s,
            limits.height_lag_max_s,
            "ms",
            1e3,
        ));
    }
    if let Some(limit) = limits.record_error_max_percent {
        for overlay in &summary.overlays {
            let name = format!("Against measured: {}", overlay.title);
            let text = format!("≤ {limit:.1} % rms");
            verdicts.push(match overlay.normalised_rms_error_percent {
                Some(error) => verdict(&name, error <= limit, format!("{error:.1} %"), &text),
                None => withheld(&name, overlay.withheld.as_deref().unwrap_or("unknown"), &text),
            });
        }
    }
    verdicts
}

fn judge_state(summary: &RunSummary) -> Verdict {
    let (name, limit) = ("No trip", "no trip during the run");
    match (&summary.trip, &summary.end_state) {
        (Some(trip), _) => verdict(name, false, format!("code {} at {:.3} s", trip.code, trip.time_s), limit),
        (None, Some(state)) => verdict(name, true, format!("ended {state}"), limit),
        (None, None) => withheld(name, "the log has no rig status", limit),
    }
}

fn judge_log(summary: &RunSummary) -> Verdict {
    let (name, limit) = ("Log complete", "every tick of every region, file ended");
    let log = &summary.log;
    let missing: u64 = log.missing_ticks.values().sum();
    if summary.ticks == 0 {
        return verdict(name, false, "the log is empty".to_owned(), limit);
    }
    let mut faults = Vec::new();
    if missing > 0 {
        let regions: Vec<String> = log
            .missing_ticks
            .iter()
            .filter(|&(_, &n)| n > 0)
            .map(|(region, n)| format!("{region} {n}"))
            .collect();
        faults.push(format!("ticks missing: {}", regions.join(", ")));
    }
    if log.conflicting_ticks > 0 {
        faults.push(format!("{} ticks logged twice differently", log.conflicting_ticks));
    }
    if !log.finished {
        faults.push("the last file was not ended".to_owned());
    }
    let found = if faults.is_empty() { format!("{} ticks", summary.ticks) } else { faults.join(", ") };
    verdict(name, faults.is_empty(), found, limit)
}

fn judge_solver(summary: &RunSummary) -> Verdict {
    let (name, limit) = ("Suspension solver", "converged on every tick");
    match summary.solver.not_converged_ticks {
        None => withheld(name, "the log has no suspension state", limit),
        Some(0) => {
            let iterations = summary.solver.iterations_max.unwrap_or(0);
            verdict(name, true, format!("converged, at most {iterations} iterations"), limit)
        }
        Some(ticks) => verdict(name, false, format!("held its pose on {ticks} ticks"), limit),
    }
}

fn judge_late_commands(summary: &RunSummary, limits: &Limits) -> Option<Verdict> {
    let ratio_max = limits.late_command_ratio_max?;
    let name = "Commands in time";
    let limit = if ratio_max > 0.0 {
        format!("≤ {:.2} % of ticks late", 100.0 * ratio_max)
    } else {
        "none late".to_owned()
    };
    if summary.lockstep {
        return Some(withheld(name, "lockstep says nothing about real time", &limit));
    }
    let Some(late) = summary.late_command_count else {
        return Some(withheld(name, "the log has no rig status", &limit));
    };
    let ratio = late as f64 / (summary.ticks.max(1)) as f64;
    Some(verdict(name, ratio <= ratio_max, format!("{late} of {} late", summary.ticks), &limit))
}

fn at_most(
    name: &str,
    figures: &TrackingFigures,
    figure: impl Fn(&TrackingFigures) -> Option<f64>,
    limit: Option<f64>,
    unit: &str,
    scale: f64,
) -> Option<Verdict> {
    let limit = limit?;
    let text = format!("≤ {:.2} {unit}", limit * scale);
    Some(match figure(figures) {
        // A measurement ahead of its command is as wrong as one behind it.
        Some(value) => verdict(name, value.abs() <= limit, format!("{:.2} {unit}", value * scale), &text),
        None => withheld(
            name,
            figures.withheld.as_deref().unwrap_or("command and measurement are not alike enough"),
            &text,
        ),
    })
}

//! Where the tie-rod force error of a run comes from, in newtons.
//!
//! The error is what the suspension asks for at an instant minus what the steering unit feels at that instant, unfiltered,
//! while steering is active. It goes through a chain of signals of the log, so its parts add up at every tick:
//!
//! ```text
//! asked(t) − felt(t) =  asked(t) − command(t)                 late or missing commands
//!                     + command(t) − applied(t)               fade and clamping by safety
//!                     + applied(t) − applied(t − τ)           delay τ of the force behind its command, as measured
//!                     + applied(t − τ) − read(t)              control: friction, rack speed, rack acceleration, rest
//!                     + read(t) − felt(t)                     force cell: curve, hysteresis, noise, quantisation
//! ```
//!
//! asked: `suspension_state` of tick n, valid at the end of the tick; felt: the virtual plant's true force at the end of
//! tick n; read: the cell's reading taken when felt was sampled (its own transport delay found by best agreement, whole
//! ticks). Friction, rack speed and rack acceleration each take, in this order and by least squares, what they explain of
//! the control's part ([`metrics::budget::explain`]): friction as tanh(v/v_s) of the rack's speed. The cell's part splits
//! into offset, gain and curve (a cubic in the force) and what is left, which is shared out by variance: quantisation
//! q²/12 and noise σ² by the configuration, the rest hysteresis.
//! On hardware nobody knows the felt force: then the chain ends at the reading, and says so.

use metrics::budget::{budget, explain};
use metrics::correlation::lag;
use metrics::resample::bridge_gaps;
use metrics::statistics::rms;
use serde_json::Value;

use crate::run::Run;

/// Speed at which friction has three quarters of its full size. [m/s]
const STRIBECK_M_S: f64 = 0.002;
/// Longest delay looked for. [s]
const DELAY_MAX_S: f64 = 0.2;
/// Longest transport delay of a reading. [ticks]
const READ_DELAY_MAX: usize = 12;

/// One part of the budget.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct ForcePart {
    /// What it is.
    pub name: String,
    /// Its own root mean square. \[N\]
    pub rms_n: f64,
    /// Its largest magnitude; none where the part is known by its variance only. \[N\]
    pub peak_n: Option<f64>,
    /// What it contributes to the root mean square of the whole; negative where it makes up for others. \[N\]
    pub share_n: f64,
}

/// The tie-rod force error of one side and its parts.
#[derive(Debug, Clone, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct ForceBudget {
    /// Why there is none, if there is none.
    pub withheld: Option<String>,
    /// Whether the error is against the force cell, because the true force is not known.
    pub against_cell: bool,
    /// Root mean square of the error. \[N\]
    pub rms_n: Option<f64>,
    /// Its largest magnitude. \[N\]
    pub peak_n: Option<f64>,
    /// Sum of the parts' shares: the root mean square again. \[N\]
    pub sum_of_shares_n: Option<f64>,
    /// Delay of the force behind its command. \[s\]
    pub delay_s: Option<f64>,
    /// Parts in the chain's order.
    pub parts: Vec<ForcePart>,
}

/// Budgets of both sides.
pub(crate) fn force_budgets(run: &Run<'_>) -> [ForceBudget; 2] {
    ["left", "right"].map(|side| {
        of_side(run, side)
            .unwrap_or_else(|reason| ForceBudget { withheld: Some(reason), ..ForceBudget::default() })
    })
}

fn minus(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a - b).collect()
}

fn of_side(run: &Run<'_>, side: &str) -> Result<ForceBudget, String> {
    let column = |region: &str, name: &str| {
        let found = run.numbers(region, &format!("{name}.{side}"));
        found.ok_or_else(|| format!("the log has no {region}.{name}"))
    };
    let active = run.active().filter(|a| a.contains(&true)).ok_or("steering was never active")?;
    let mut asked = column("suspension_state", "tie_rod_force_n")?;
    // What is NaN in one part is left out of all: that is the window.
    asked.iter_mut().zip(&active).filter(|(_, active)| !**active).for_each(|(asked, _)| *asked = f64::NAN);
    let command = column("rig_status", "tie_rod_force_command_n")?;
    let applied = column("rig_status", "tie_rod_force_applied_n")?;
    let reading = column("rig_measurement", "tie_rod_force_n")?;
    let truth = column("rig_status", "true_tie_rod_force_n").unwrap_or_default();
    let against_cell = !truth.iter().any(|v| v.is_finite());
    // A reading of tick n+1 is of the end of tick n at the earliest.
    let read = if against_cell { later(&reading, 1) } else { aligned(&reading, &truth, &active) };
    let felt = if against_cell { &read } else { &truth };
    let delay_s = delay(run, &applied, felt, &active);
    let delayed = shifted(&applied, delay_s.unwrap_or(0.0) / run.period_s());

    let rack = run
        .numbers("rig_status", "true_rack_displacement_m")
        .filter(|rack| rack.iter().any(|x| x.is_finite()))
        .or_else(|| run.numbers("rig_measurement", "rack_displacement_m"))
        .ok_or("the log has no rack displacement")?;
    let speed = slope(&rack, run.period_s());
    let acceleration = slope(&speed, run.period_s());
    let friction: Vec<f64> = speed.iter().map(|v| (v / STRIBECK_M_S).tanh()).collect();

    let within = |values: Vec<f64>| -> Vec<f64> {
        values.into_iter().zip(&asked).map(|(v, asked)| if asked.is_nan() { f64::NAN } else { v }).collect()
    };
    let control = explain(&within(minus(&delayed, &read)), &[friction, speed, acceleration]);
    let mut names = vec![
        "late or missing commands",
        "fade and clamping by safety",
        "delay of the force behind its command",
    ];
    let mut parts = vec![minus(&asked, &command), minus(&command, &applied), minus(&applied, &delayed)];
    names.extend([
        "control: friction (with the sign of the rack's speed)",
        "control: rack speed",
        "control: rack acceleration (inertia)",
        "control: rest (gain, shape, valve)",
    ]);
    parts.extend(control);
    if !against_cell {
        let powers: Vec<Vec<f64>> = [0, 1, 2, 3].map(|p| truth.iter().map(|f| f.powi(p)).collect()).into();
        let cell = explain(&within(minus(&read, &truth)), &powers);
        let left = cell[4].clone();
        parts.push((0..left.len()).map(|i| (0..4).map(|p| cell[p][i]).sum()).collect());
        names.push("force cell: offset, gain, curve");
        parts.push(left);
        names.push("force cell: rest");
    }
    let found = budget(&parts).ok_or("no tick has all parts of the chain, or there is no error")?;
    let mut parts: Vec<ForcePart> = names
        .into_iter()
        .zip(&found.parts)
        .map(|(name, part)| ForcePart {
            name: name.to_owned(),
            rms_n: part.rms,
            peak_n: Some(part.peak),
            share_n: part.share,
        })
        .collect();
    if !against_cell {
        split_cell_rest(run, &mut parts);
    }
    Ok(ForceBudget {
        withheld: None,
        against_cell,
        rms_n: Some(found.rms),
        peak_n: Some(found.peak),
        sum_of_shares_n: Some(parts.iter().map(|part| part.share_n).sum()),
        delay_s,
        parts,
    })
}

/// Shares the rest of the cell's part out between hysteresis, noise and quantisation, by variance.
fn split_cell_rest(run: &Run<'_>, parts: &mut Vec<ForcePart>) {
    let Ok(configuration) = serde_json::from_str::<Value>(&run.log.header.configuration) else { return };
    let sensor = &configuration["rig"]["sensors"]["tie_rod_force"];
    let (Some(range), Some(noise)) = (sensor["range_n"].as_f64(), sensor["noise_n"].as_f64()) else { return };
    let Some(rest) = parts.pop() else { return };
    let step = range / 32767.0;
    let (quantisation, noise, whole) = (step * step / 12.0, noise * noise, rest.rms_n * rest.rms_n);
    let known = quantisation + noise;
    // Noise in a finite record may come out a little smaller than it is on average.
    let scale = if known > whole { whole / known } else { 1.0 };
    for (name, variance) in [
        ("force cell: hysteresis", (whole - known).max(0.0)),
        ("force cell: noise", scale * noise),
        ("force cell: quantisation", scale * quantisation),
    ] {
        parts.push(ForcePart {
            name: name.to_owned(),
            rms_n: variance.sqrt(),
            peak_n: None,
            share_n: if whole > 0.0 { rest.share_n * variance / whole } else { 0.0 },
        });
    }
}

/// The signal so many ticks later.
fn later(values: &[f64], ticks: usize) -> Vec<f64> {
    (0..values.len()).map(|i| values.get(i + ticks).copied().unwrap_or(f64::NAN)).collect()
}

/// The readings put where the force was sampled: by the delay of best agreement while steering is active.
fn aligned(reading: &[f64], truth: &[f64], active: &[bool]) -> Vec<f64> {
    let off = |ticks: usize| {
        let read = later(reading, ticks);
        let error: Vec<f64> = (0..truth.len()).filter(|&i| active[i]).map(|i| read[i] - truth[i]).collect();
        let mean = metrics::statistics::mean(&error);
        rms(&error.iter().map(|e| e - mean).collect::<Vec<_>>())
    };
    let best = (0..=READ_DELAY_MAX).min_by(|a, b| off(*a).total_cmp(&off(*b))).unwrap_or(1);
    later(reading, best)
}

/// Delay of the force behind its command while steering is active. [s]
fn delay(run: &Run<'_>, applied: &[f64], felt: &[f64], active: &[bool]) -> Option<f64> {
    let first = active.iter().position(|&a| a)?;
    let last = active.iter().rposition(|&a| a)?;
    let whole = |values: &[f64]| bridge_gaps(values.get(first..=last)?);
    let found = lag(&whole(applied)?, &whole(felt)?, run.period_s(), DELAY_MAX_S)?;
    (found.correlation > 0.9).then_some(found.lag_s)
}

/// The signal as it was `ticks` (not whole) before.
fn shifted(values: &[f64], ticks: f64) -> Vec<f64> {
    (0..values.len())
        .map(|i| {
            let at = i as f64 - ticks;
            let (low, part) = (at.floor(), at - at.floor());
            let value =
                |k: f64| if k < 0.0 { f64::NAN } else { values.get(k as usize).copied().unwrap_or(f64::NAN) };
            // Whole shifts need no neighbour.
            if part == 0.0 { value(low) } else { (1.0 - part) * value(low) + part * value(low + 1.0) }
        })
        .collect()
}

/// Derivative by central differences.
fn slope(values: &[f64], step_s: f64) -> Vec<f64> {
    let n = values.len();
    (0..n)
        .map(|i| {
            let (a, b) = (i.saturating_sub(1), (i + 1).min(n - 1));
            if a == b { f64::NAN } else { (values[b] - values[a]) / ((b - a) as f64 * step_s) }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shifting_by_parts_of_a_tick_is_linear() {
        let line: Vec<f64> = (0..10).map(f64::from).collect();
        assert!((shifted(&line, 2.25)[5] - 2.75).abs() < 1e-12);
        assert!(shifted(&line, 2.25)[1].is_nan());
        assert_eq!(shifted(&line, 0.0), line);
        assert_eq!(later(&line, 3)[..2], [3.0, 4.0]);
    }

    #[test]
    fn readings_are_put_where_they_were_taken() {
        let truth: Vec<f64> = (0..500).map(|i| (0.05 * f64::from(i)).sin()).collect();
        let reading: Vec<f64> = (0..500).map(|i| 0.3 + (0.05 * f64::from(i - 4)).sin()).collect();
        let read = aligned(&reading, &truth, &[true; 500]);
        assert!((0..490).all(|i| (read[i] - truth[i] - 0.3).abs() < 1e-9));
    }
}

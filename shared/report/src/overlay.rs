//! Measured signals laid over the bench's own, and how far the two are apart.

use metrics::compare::compare_record;
use record::LogReader;

use crate::run::Run;
use crate::source_figures::{LATERAL, STEERING, TORQUE};
use crate::summary::{LoopFigures, known, loop_figures};

/// Furthest a measured record is shifted to align it. \[s\]
const LAG_MAX_S: f64 = 1.0;

/// A measured signal and the bench's signal it belongs to.
#[derive(Debug, Clone, PartialEq)]
pub struct Overlay {
    /// What it is and where from, for the legend.
    pub title: String,
    /// Unit symbol; must be the target's.
    pub unit: String,
    /// Time on the run's clock. \[s\]
    pub time_s: Vec<f64>,
    /// Values.
    pub value: Vec<f64>,
    /// Full name of the bench's signal, e.g. `vehicle_state.acceleration_m_s2.y`.
    pub target: String,
}

/// How far the bench's signal is from a measured one.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct OverlayResult {
    /// Title of the measured signal.
    pub title: String,
    /// Full name of the bench's signal.
    pub target: String,
    /// Unit of both.
    pub unit: String,
    /// Why there is no comparison, if there is none.
    pub withheld: Option<String>,
    /// Time the bench's signal comes after the measured one at best agreement. \[s\]
    pub lag_s: Option<f64>,
    /// Correlation coefficient at that alignment.
    pub correlation: Option<f64>,
    /// Root mean square of the difference as it is. [unit]
    pub rms_error: Option<f64>,
    /// The same with the lag taken out. [unit]
    pub rms_error_aligned: Option<f64>,
    /// Aligned error over the measured root mean square. [%]
    pub normalised_rms_error_percent: Option<f64>,
    /// Largest aligned error over the measured peak. [%]
    pub normalised_peak_error_percent: Option<f64>,
    /// Largest magnitude measured. [unit]
    pub measured_peak: Option<f64>,
    /// Largest magnitude on the bench. [unit]
    pub simulated_peak: Option<f64>,
    /// Length of the common time. \[s\]
    pub duration_s: Option<f64>,
}

/// Compares a measured signal with the bench's.
pub(crate) fn compare_overlay(log: &LogReader, overlay: &Overlay) -> OverlayResult {
    let mut result = OverlayResult {
        title: overlay.title.clone(),
        target: overlay.target.clone(),
        unit: overlay.unit.clone(),
        withheld: None,
        lag_s: None,
        correlation: None,
        rms_error: None,
        rms_error_aligned: None,
        normalised_rms_error_percent: None,
        normalised_peak_error_percent: None,
        measured_peak: None,
        simulated_peak: None,
        duration_s: None,
    };
    let signal = match log.signal(&overlay.target) {
        Ok(signal) => signal,
        Err(error) => {
            result.withheld = Some(error.to_string());
            return result;
        }
    };
    if signal.unit != overlay.unit {
        result.withheld = Some(format!("unit {} does not fit {} of the bench", overlay.unit, signal.unit));
        return result;
    }
    let measured = (&overlay.time_s[..], &overlay.value[..]);
    match compare_record(measured, (&signal.time_s, &signal.value), LAG_MAX_S) {
        None => result.withheld = Some("no common time, or nothing measured".to_owned()),
        Some(c) => {
            result.lag_s = known(c.lag_s);
            result.correlation = known(c.correlation);
            result.rms_error = known(c.rms_error);
            result.rms_error_aligned = known(c.rms_error_aligned);
            result.normalised_rms_error_percent = known(100.0 * c.normalised_rms_error);
            result.normalised_peak_error_percent = known(100.0 * c.normalised_peak_error);
            result.measured_peak = known(c.measured_peak);
            result.simulated_peak = known(c.simulated_peak);
            result.duration_s = known(c.duration_s);
        }
    }
    result
}

/// A steering-torque loop of a measured record beside the bench's.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct RecordLoop {
    /// Over what the torque is: full name of the bench's signal.
    pub over: String,
    /// The record's. Units as those of the bench's.
    pub measured: LoopFigures,
    /// The bench's.
    pub bench: LoopFigures,
    /// Bench's gradient minus the record's, of the record's. [%]
    pub gradient_error_percent: Option<f64>,
    /// Bench's width minus the record's, of the record's. [%]
    pub width_error_percent: Option<f64>,
}

/// Measured torque over measured angle or lateral acceleration while the bench's steering was active, on the torque's own
/// time base. None unless both are recorded.
pub(crate) fn record_points(run: &Run<'_>, overlays: &[Overlay], over: &str) -> Option<(Vec<f64>, Vec<f64>)> {
    let of = |target: &str| overlays.iter().find(|o| o.target == target);
    let (x, torque) = (of(over)?, of(TORQUE)?);
    let (time_s, active) = (run.time_s(), run.active()?);
    let first = *time_s.first()?;
    let inside = |t: f64| {
        let at = (t - first) / run.period_s();
        at >= 0.0 && active.get(at as usize).copied().unwrap_or(false)
    };
    let x = metrics::resample::linear(&x.time_s, &x.value, &torque.time_s);
    let points = torque.time_s.iter().zip(x).zip(&torque.value);
    let points: (Vec<f64>, Vec<f64>) = points
        .filter(|((t, x), y)| inside(**t) && x.is_finite() && y.is_finite())
        .map(|((_, x), y)| (x, *y))
        .unzip();
    (points.0.len() > 1).then_some(points)
}

/// The measured steering-torque loops that can be had, beside the bench's.
pub(crate) fn record_loops(run: &Run<'_>, overlays: &[Overlay], bench: [LoopFigures; 2]) -> Vec<RecordLoop> {
    let mut found = Vec::new();
    for (over, bench) in [STEERING, LATERAL].into_iter().zip(bench) {
        let Some((x, y)) = record_points(run, overlays, over) else { continue };
        let measured = loop_figures(&x, &y);
        let percent = |bench: Option<f64>, measured: Option<f64>| {
            bench.zip(measured).and_then(|(b, m)| known(100.0 * (b - m) / m.abs()))
        };
        found.push(RecordLoop {
            over: over.to_owned(),
            measured,
            bench,
            gradient_error_percent: percent(bench.gradient, measured.gradient),
            width_error_percent: percent(bench.width_n_m, measured.width_n_m),
        });
    }
    found
}

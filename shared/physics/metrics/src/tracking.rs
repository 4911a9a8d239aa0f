//! How well a commanded quantity is reached, as the bench measures it (spec 4.4).
//!
//! Error = command\[n\] − the measurement available at n, over the window in which steering is active, in per
//! cent of half the peak-to-peak of the command in that window; both through the same zero-phase 50 Hz
//! filter. Lag: peak of the cross-correlation in the same window.

use crate::correlation::lag;
use crate::filter::{LowPass, TRACKING_CORNER_HZ};
use crate::resample::bridge_gaps;
use crate::statistics::{amplitude, peak, rms};

/// Least correlation at which two signals are alike enough for one to lag the other.
const CORRELATION_MIN: f64 = 0.9;
/// Longest lag looked for. \[s\]
const LAG_MAX_S: f64 = 0.2;

/// How well a command was reached.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tracking {
    /// Half the peak-to-peak of the filtered command in the window. [unit of the signal]
    pub amplitude: f64,
    /// Largest magnitude of the error. [unit of the signal]
    pub error_max: f64,
    /// Root mean square of the error. [unit of the signal]
    pub error_rms: f64,
    /// Largest error over amplitude. [%]
    pub error_max_percent: f64,
    /// Root mean square error over amplitude. [%]
    pub error_rms_percent: f64,
    /// Lag of the measurement behind the command, NaN if it cannot be told. \[s\]
    pub lag_s: f64,
    /// Samples in the window.
    pub samples: usize,
}

/// Why a figure is withheld.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Withheld {
    /// Steering was never active.
    NoActiveWindow,
    /// No sample in the window has both command and measurement.
    NoCommonSamples,
    /// The command does not vary in the window, so there is nothing to relate the error to.
    CommandConstant,
    /// The sampling rate is too low for the 50 Hz filter.
    SamplingTooSlow,
}

impl std::fmt::Display for Withheld {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Withheld::NoActiveWindow => "steering was never active",
            Withheld::NoCommonSamples => "command and measurement have no sample in common",
            Withheld::CommandConstant => "the command does not vary",
            Withheld::SamplingTooSlow => "sampled too slowly for the 50 Hz filter",
        })
    }
}

/// The filtered error, command minus measurement, at every sample.
///
/// # Errors
/// If the sampling is too slow.
pub fn error_signal(command: &[f64], measured: &[f64], sample_time_s: f64) -> Result<Vec<f64>, Withheld> {
    let filter = LowPass::butterworth(TRACKING_CORNER_HZ, sample_time_s).ok_or(Withheld::SamplingTooSlow)?;
    let (command, measured) = (filter.zero_phase(command), filter.zero_phase(measured));
    Ok(command.iter().zip(&measured).map(|(c, m)| c - m).collect())
}

/// How well `measured` follows `command` where `active` says so; all sampled together.
///
/// # Errors
/// If the figure would mean nothing: see [`Withheld`].
pub fn tracking(
    command: &[f64],
    measured: &[f64],
    active: &[bool],
    sample_time_s: f64,
) -> Result<Tracking, Withheld> {
    let filter = LowPass::butterworth(TRACKING_CORNER_HZ, sample_time_s).ok_or(Withheld::SamplingTooSlow)?;
    let (command, measured) = (filter.zero_phase(command), filter.zero_phase(measured));
    let n = command.len().min(measured.len()).min(active.len());
    let first = active[..n].iter().position(|&a| a).ok_or(Withheld::NoActiveWindow)?;
    let last = active[..n].iter().rposition(|&a| a).unwrap_or(first);
    let samples: Vec<(f64, f64)> = (first..=last)
        .filter(|&i| active[i] && command[i].is_finite() && measured[i].is_finite())
        .map(|i| (command[i], measured[i]))
        .collect();
    if samples.is_empty() {
        return Err(Withheld::NoCommonSamples);
    }
    let commands: Vec<f64> = samples.iter().map(|(c, _)| *c).collect();
    let error: Vec<f64> = samples.iter().map(|(c, m)| c - m).collect();
    let amplitude = amplitude(&commands);
    if amplitude <= 0.0 {
        return Err(Withheld::CommandConstant);
    }
    // A lag needs evenly spaced samples: a few holes are bridged, many forbid it.
    let span = last - first + 1;
    let lag = if samples.len() * 100 >= span * 99 {
        let whole = |values: &[f64]| bridge_gaps(&values[first..=last]).unwrap_or_default();
        lag(&whole(&command), &whole(&measured), sample_time_s, LAG_MAX_S)
    } else {
        None
    };
    let (error_max, error_rms) = (peak(&error), rms(&error));
    Ok(Tracking {
        amplitude,
        error_max,
        error_rms,
        error_max_percent: 100.0 * error_max / amplitude,
        error_rms_percent: 100.0 * error_rms / amplitude,
        lag_s: lag.filter(|lag| lag.correlation >= CORRELATION_MIN).map_or(f64::NAN, |lag| lag.lag_s),
        samples: samples.len(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    const T: f64 = 1e-3;

    fn sine(amplitude: f64, frequency_hz: f64, delay_s: f64) -> Vec<f64> {
        (0..10_000).map(|i| amplitude * (TAU * frequency_hz * (i as f64 * T - delay_s)).sin()).collect()
    }

    #[test]
    fn a_pure_delay_gives_the_error_of_two_shifted_sines() {
        let active: Vec<bool> = (0..10_000).map(|i| (2000..8000).contains(&i)).collect();
        let (f, delay) = (0.5, 0.004);
        let result = tracking(&sine(2000.0, f, 0.0), &sine(2000.0, f, delay), &active, T).unwrap();
        // sin(x) − sin(x − φ) = 2 sin(φ/2) cos(x − φ/2).
        let expected = 2.0 * (TAU * f * delay / 2.0).sin() * 100.0;
        assert!((result.error_max_percent - expected).abs() < 1e-3, "{result:?} {expected}");
        assert!((result.error_rms_percent - expected / 2_f64.sqrt()).abs() < 1e-3);
        assert!((result.amplitude - 2000.0).abs() < 0.01);
        assert!((result.lag_s - delay).abs() < 2e-5);
        assert_eq!(result.samples, 6000);
    }

    #[test]
    fn noise_above_the_corner_hardly_counts_and_an_offset_counts_in_full() {
        // Not to the very ends: there a filter has only one side to tell noise from signal.
        let active: Vec<bool> = (0..10_000).map(|i| (200..9800).contains(&i)).collect();
        let command = sine(1000.0, 0.3, 0.0);
        let noisy: Vec<f64> = command.iter().zip(sine(100.0, 300.0, 0.0)).map(|(c, n)| c + n).collect();
        assert!(tracking(&command, &noisy, &active, T).unwrap().error_rms_percent < 0.02);
        let offset: Vec<f64> = command.iter().map(|c| c + 30.0).collect();
        let result = tracking(&command, &offset, &active, T).unwrap();
        assert!(
            (result.error_max_percent - 3.0).abs() < 1e-6 && (result.error_rms_percent - 3.0).abs() < 1e-6
        );
    }

    #[test]
    fn a_few_missing_samples_leave_the_lag_and_many_do_not() {
        let (command, mut measured) = (sine(500.0, 0.7, 0.0), sine(500.0, 0.7, 0.006));
        let active = vec![true; 10_000];
        measured[4000..4050].fill(f64::NAN);
        let few = tracking(&command, &measured, &active, T).unwrap();
        assert!((few.lag_s - 0.006).abs() < 1e-4 && few.samples == 9950, "{few:?}");
        measured[4000..4500].fill(f64::NAN);
        assert!(tracking(&command, &measured, &active, T).unwrap().lag_s.is_nan());
    }

    #[test]
    fn signals_that_are_not_alike_have_no_lag() {
        let (command, other) = (sine(500.0, 0.7, 0.0), sine(500.0, 13.0, 0.0));
        let measured: Vec<f64> = command.iter().zip(&other).map(|(c, o)| c + o).collect();
        let result = tracking(&command, &measured, &[true; 10_000], T).unwrap();
        assert!(result.lag_s.is_nan() && result.error_rms_percent > 60.0, "{result:?}");
    }

    #[test]
    fn errors_outside_the_window_do_not_count() {
        let active: Vec<bool> = (0..10_000).map(|i| (3000..7000).contains(&i)).collect();
        let command = sine(1000.0, 0.5, 0.0);
        let mut measured = command.clone();
        measured[..2000].fill(5000.0);
        assert!(tracking(&command, &measured, &active, T).unwrap().error_max < 1e-6);
    }

    #[test]
    fn what_would_mean_nothing_is_withheld() {
        let sine = sine(1.0, 1.0, 0.0);
        let (on, off) = (vec![true; 10_000], vec![false; 10_000]);
        assert_eq!(tracking(&sine, &sine, &off, T), Err(Withheld::NoActiveWindow));
        assert_eq!(tracking(&vec![5.0; 10_000], &sine, &on, T), Err(Withheld::CommandConstant));
        assert_eq!(tracking(&sine, &vec![f64::NAN; 10_000], &on, T), Err(Withheld::NoCommonSamples));
        assert_eq!(tracking(&sine, &sine, &on, 0.02), Err(Withheld::SamplingTooSlow));
    }
}

//! A measured record against a simulation of it: aligned in time, error in the signal's unit and normalised
//! (spec 6.2).

use crate::correlation::{correlation, lag};
use crate::resample::{linear, median_step, uniform};
use crate::statistics::{peak, rms};

/// How far a simulated signal is from a measured one.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordComparison {
    /// Time the simulated signal comes after the measured one, at best agreement. \[s\]
    pub lag_s: f64,
    /// Correlation coefficient at that alignment.
    pub correlation: f64,
    /// Root mean square of simulated minus measured as they are. [unit of the signal]
    pub rms_error: f64,
    /// The same once the lag is taken out. [unit of the signal]
    pub rms_error_aligned: f64,
    /// Aligned error over the root mean square of the measured signal. \[1\]
    pub normalised_rms_error: f64,
    /// Largest magnitude of the aligned error over the measured peak. \[1\]
    pub normalised_peak_error: f64,
    /// Largest magnitude measured, in the common time. [unit of the signal]
    pub measured_peak: f64,
    /// Largest magnitude simulated, in the common time. [unit of the signal]
    pub simulated_peak: f64,
    /// Length of the common time. \[s\]
    pub duration_s: f64,
}

/// Compares a simulated signal with a measured one, each with its own time base; values that are not finite
/// are left out. Lags are searched within ±`lag_max_s`; where none can be told it is taken as 0.
///
/// None if the signals have less than 16 common samples, or the measured one is zero throughout.
pub fn compare_record(
    measured: (&[f64], &[f64]),
    simulated: (&[f64], &[f64]),
    lag_max_s: f64,
) -> Option<RecordComparison> {
    let measured = finite_part(measured);
    let simulated = finite_part(simulated);
    let start = measured.0.first()?.max(*simulated.0.first()?);
    let end = measured.0.last()?.min(*simulated.0.last()?);
    // The coarser of the two bases: interpolation must not pretend to know more.
    let step = median_step(&measured.0).max(median_step(&simulated.0));
    let grid = uniform(start, end, step);
    if grid.len() < 16 {
        return None;
    }
    let m = linear(&measured.0, &measured.1, &grid);
    let s = linear(&simulated.0, &simulated.1, &grid);
    let found = lag(&m, &s, step, lag_max_s);
    let lag_s = found.map_or(0.0, |found| found.lag_s);
    let shifted: Vec<f64> = grid.iter().map(|t| t + lag_s).collect();
    let aligned = linear(&simulated.0, &simulated.1, &shifted);
    let error: Vec<f64> = s.iter().zip(&m).map(|(s, m)| s - m).collect();
    let error_aligned: Vec<f64> = aligned.iter().zip(&m).map(|(s, m)| s - m).collect();
    let level = rms(&m);
    if level <= 0.0 {
        return None;
    }
    Some(RecordComparison {
        lag_s,
        correlation: found.map(|found| found.correlation).or_else(|| correlation(&m, &s)).unwrap_or(f64::NAN),
        rms_error: rms(&error),
        rms_error_aligned: rms(&error_aligned),
        normalised_rms_error: rms(&error_aligned) / level,
        normalised_peak_error: peak(&error_aligned) / peak(&m),
        measured_peak: peak(&m),
        simulated_peak: peak(&s),
        duration_s: end - start,
    })
}

fn finite_part((time, value): (&[f64], &[f64])) -> (Vec<f64>, Vec<f64>) {
    time.iter().copied().zip(value.iter().copied()).filter(|(t, v)| t.is_finite() && v.is_finite()).unzip()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn signal(t: f64) -> f64 {
        5.0 * (1.3 * t).sin() * (-0.02 * t * t).exp() + (4.1 * t).sin()
    }

    #[test]
    fn the_same_signal_late_and_scaled() {
        let measured: (Vec<f64>, Vec<f64>) =
            (0..2000).map(|i| i as f64 * 0.01).map(|t| (t, signal(t))).unzip();
        let simulated: (Vec<f64>, Vec<f64>) =
            (0..18_000).map(|i| 1.0 + i as f64 * 1e-3).map(|t| (t, 1.1 * signal(t - 0.06))).unzip();
        let result = compare_record((&measured.0, &measured.1), (&simulated.0, &simulated.1), 0.5).unwrap();
        assert!((result.lag_s - 0.06).abs() < 1e-3, "{result:?}");
        assert!((result.normalised_rms_error - 0.1).abs() < 2e-3, "{result:?}");
        assert!(result.rms_error > result.rms_error_aligned);
        assert!((result.simulated_peak / result.measured_peak - 1.1).abs() < 0.01);
        assert!(result.correlation > 0.999);
        assert!((result.duration_s - 17.999).abs() < 0.011);
    }

    #[test]
    fn signals_without_common_time_are_not_compared() {
        let t: Vec<f64> = (0..100).map(f64::from).collect();
        let late: Vec<f64> = t.iter().map(|t| t + 200.0).collect();
        assert_eq!(compare_record((&t, &t), (&late, &t), 1.0), None);
        assert_eq!(compare_record((&[], &[]), (&t, &t), 1.0), None);
        assert_eq!(compare_record((&t, &[0.0; 100]), (&t, &t), 1.0), None);
    }
}

//! A recorded signal made fit to drive with: samples with (nearly) the same time stamp averaged, optional
//! zero-phase low-pass, joined to a smooth curve.
//!
//! The low-pass is a second-order Butterworth run forward and backward (fourth order, no phase, −6 dB at the
//! cut-off), on the record resampled at its median spacing; it starts settled on the end values.

use crate::curve::Curve;
use config::TimeSeries;
use std::f64::consts::{PI, SQRT_2};

/// Samples closer than this share of the median spacing are one sample stamped twice.
const SAME_SHARE: f64 = 0.2;

/// Makes a curve of a recorded signal; `None` if it has no samples.
pub fn curve(series: &TimeSeries, low_pass_hz: Option<f64>) -> Option<Curve> {
    let spacing_s = series.median_spacing_s();
    let (time, value) = merged(series, SAME_SHARE * spacing_s);
    if time.is_empty() {
        return None;
    }
    match low_pass_hz {
        Some(cutoff_hz) if time.len() > 2 && cutoff_hz * spacing_s < 0.45 => {
            let (time, value) = resampled(&time, &value, spacing_s);
            Some(Curve::new(time, zero_phase(&value, cutoff_hz, spacing_s)))
        }
        _ => Some(Curve::new(time, value)),
    }
}

fn merged(series: &TimeSeries, closest_s: f64) -> (Vec<f64>, Vec<f64>) {
    let (mut times, mut values) = (Vec::new(), Vec::new());
    let mut group: Option<(f64, f64, f64, f64)> = None; // First time, sums, count.
    for (time, value) in series.time_s.iter().zip(&series.value) {
        group = match group {
            Some((first, sum_t, sum_v, n)) if time - first <= closest_s => {
                Some((first, sum_t + time, sum_v + value, n + 1.0))
            }
            done => {
                if let Some((_, sum_t, sum_v, n)) = done {
                    times.push(sum_t / n);
                    values.push(sum_v / n);
                }
                Some((*time, *time, *value, 1.0))
            }
        };
    }
    if let Some((_, sum_t, sum_v, n)) = group {
        times.push(sum_t / n);
        values.push(sum_v / n);
    }
    (times, values)
}

fn resampled(time: &[f64], value: &[f64], spacing_s: f64) -> (Vec<f64>, Vec<f64>) {
    let (first, last) = (time[0], time[time.len() - 1]);
    let count = ((last - first) / spacing_s).floor() as usize + 1;
    let mut i = 0;
    let places: Vec<f64> = (0..count).map(|k| first + k as f64 * spacing_s).collect();
    let values = places
        .iter()
        .map(|t| {
            while i + 2 < time.len() && time[i + 1] < *t {
                i += 1;
            }
            let share = ((t - time[i]) / (time[i + 1] - time[i])).clamp(0.0, 1.0);
            value[i] + share * (value[i + 1] - value[i])
        })
        .collect();
    (places, values)
}

fn zero_phase(value: &[f64], cutoff_hz: f64, spacing_s: f64) -> Vec<f64> {
    let mut forward = butterworth(value.iter().copied(), cutoff_hz, spacing_s);
    forward.reverse();
    let mut both = butterworth(forward.into_iter(), cutoff_hz, spacing_s);
    both.reverse();
    both
}

/// Second-order Butterworth low-pass by the bilinear transform, started settled on the first value.
fn butterworth(values: impl Iterator<Item = f64>, cutoff_hz: f64, spacing_s: f64) -> Vec<f64> {
    let w = (PI * cutoff_hz * spacing_s).tan();
    let norm = 1.0 / (1.0 + SQRT_2 * w + w * w);
    let b = w * w * norm;
    let (a1, a2) = (2.0 * (w * w - 1.0) * norm, (1.0 - SQRT_2 * w + w * w) * norm);
    let mut past: Option<[f64; 4]> = None; // x[n−1], x[n−2], y[n−1], y[n−2]
    values
        .map(|x| {
            let [x1, x2, y1, y2] = past.unwrap_or([x; 4]);
            let y = b * (x + 2.0 * x1 + x2) - a1 * y1 - a2 * y2;
            past = Some([x, x1, y, y1]);
            y
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    fn sampled(signal: impl Fn(f64) -> f64) -> TimeSeries {
        let time_s: Vec<f64> = (0..2000).map(|i| f64::from(i) * 5e-3).collect();
        TimeSeries { value: time_s.iter().map(|t| signal(*t)).collect(), time_s }
    }

    #[test]
    fn repeated_time_stamps_are_averaged() {
        let series = TimeSeries {
            time_s: vec![0.0, 1.0, 1.0, 1.001, 2.0, 3.0],
            value: vec![0.0, 1.0, 2.0, 6.0, 4.0, 4.0],
        };
        let curve = curve(&series, None).unwrap();
        assert!((curve.at(3.001 / 3.0).value - 3.0).abs() < 1e-12);
        assert!(curve.at(1.0005).rate.abs() < 10.0);
    }

    #[test]
    fn low_pass_keeps_the_slow_without_delay_and_stops_the_fast() {
        let slow = |t: f64| (TAU * 0.5 * t).sin();
        let series = sampled(|t| slow(t) + 0.3 * (TAU * 60.0 * t).sin());
        let curve = curve(&series, Some(10.0)).unwrap();
        for i in 1000..9000 {
            let t = f64::from(i) * 1e-3;
            assert!((curve.at(t).value - slow(t)).abs() < 2e-3, "at {t}");
        }
    }

    #[test]
    fn at_the_cut_off_half_is_left() {
        let curve = curve(&sampled(|t| (TAU * 10.0 * t).sin()), Some(10.0)).unwrap();
        let peak = (3000..7000).map(|i| curve.at(f64::from(i) * 1e-3).value).fold(0.0, f64::max);
        assert!((peak - 0.5).abs() < 0.01, "{peak}");
    }
}

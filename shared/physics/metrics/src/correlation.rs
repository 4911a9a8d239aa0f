//! How much one signal lags another: the peak of their cross-correlation.

/// A lag and how well the signals then agree.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lag {
    /// Time the response comes after the reference; negative if before. \[s\]
    pub lag_s: f64,
    /// Correlation coefficient at that lag, at most 1.
    pub correlation: f64,
}

/// Lag of `response` behind `reference`, sampled together every `step_s`, searched within ±`lag_max_s`.
///
/// At each lag the correlation coefficient is that of the overlapping parts, means removed; the peak is
/// refined by a parabola through its neighbours. None if a signal does not vary, is too short (less than
/// 16 samples of overlap), holds values that are not finite, or the peak lies at the border of the search.
pub fn lag(reference: &[f64], response: &[f64], step_s: f64, lag_max_s: f64) -> Option<Lag> {
    let n = reference.len().min(response.len());
    let all_finite = reference[..n].iter().chain(&response[..n]).all(|v| v.is_finite());
    if n < 32 || !all_finite || !(step_s > 0.0 && lag_max_s >= step_s) {
        return None;
    }
    let reach = ((lag_max_s / step_s).round() as usize).min(n - 16) as isize;
    let at = |lag: isize| coefficient(&reference[..n], &response[..n], lag);
    let mut best: Option<(isize, f64)> = None;
    for lag in -reach..=reach {
        if let Some(value) = at(lag)
            && best.is_none_or(|(_, peak)| value > peak)
        {
            best = Some((lag, value));
        }
    }
    let (shift, peak) = best?;
    if shift.abs() == reach {
        return None;
    }
    let (before, after) = (at(shift - 1)?, at(shift + 1)?);
    let bend = before - 2.0 * peak + after;
    let part = if bend < 0.0 { (0.5 * (before - after) / bend).clamp(-0.5, 0.5) } else { 0.0 };
    Some(Lag { lag_s: (shift as f64 + part) * step_s, correlation: peak - 0.25 * (before - after) * part })
}

/// Correlation coefficient of reference[i] with response[i + lag].
fn coefficient(reference: &[f64], response: &[f64], lag: isize) -> Option<f64> {
    let n = reference.len();
    let skip = lag.unsigned_abs();
    let (a, b) = if lag >= 0 {
        (&reference[..n - skip], &response[skip..])
    } else {
        (&reference[skip..], &response[..n - skip])
    };
    correlation(a, b)
}

/// Correlation coefficient of two signals; None if one does not vary.
pub fn correlation(a: &[f64], b: &[f64]) -> Option<f64> {
    let n = a.len().min(b.len()) as f64;
    let (mean_a, mean_b) = (a.iter().sum::<f64>() / n, b.iter().sum::<f64>() / n);
    let (mut aa, mut bb, mut ab) = (0.0, 0.0, 0.0);
    for (x, y) in a.iter().zip(b) {
        let (x, y) = (x - mean_a, y - mean_b);
        aa += x * x;
        bb += y * y;
        ab += x * y;
    }
    let value = ab / (aa * bb).sqrt();
    value.is_finite().then_some(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn signal(t: f64) -> f64 {
        (3.0 * t).sin() + 0.5 * (11.0 * t + 1.0).sin() + 7.0
    }

    #[test]
    fn a_known_delay_is_found_to_a_part_of_a_sample() {
        for delay in [0.0, 0.0042, -0.0137, 0.1] {
            let reference: Vec<f64> = (0..5000).map(|i| signal(i as f64 * 1e-3)).collect();
            let response: Vec<f64> = (0..5000).map(|i| 0.3 * signal(i as f64 * 1e-3 - delay) - 2.0).collect();
            let found = lag(&reference, &response, 1e-3, 0.2).unwrap();
            assert!((found.lag_s - delay).abs() < 5e-5, "{delay}: {found:?}");
            assert!(found.correlation > 0.99999, "{found:?}");
        }
    }

    #[test]
    fn what_cannot_be_known_is_withheld() {
        let sine: Vec<f64> = (0..500).map(|i| (i as f64 * 0.05).sin()).collect();
        assert_eq!(lag(&sine, &vec![1.0; 500], 1e-3, 0.1), None, "a constant has no lag");
        assert_eq!(lag(&sine[..20], &sine[..20], 1e-3, 0.1), None, "too short");
        let ramp: Vec<f64> = (0..500).map(|i| (i * i) as f64).collect();
        let late: Vec<f64> = (0..500).map(|i| ((i as f64 - 60.0).max(0.0)).powi(2)).collect();
        assert_eq!(lag(&ramp, &late, 1e-3, 0.02), None, "the peak lies outside the search");
    }
}

//! Signals onto other time bases, by straight lines between samples, never beyond their ends.

/// The signal at the times `at`; NaN outside its span and next to a value that is absent. `time` must
/// ascend; of equal times the last counts.
pub fn linear(time: &[f64], value: &[f64], at: &[f64]) -> Vec<f64> {
    at.iter().map(|&t| linear_at(time, value, t)).collect()
}

/// The signal at one time.
pub fn linear_at(time: &[f64], value: &[f64], t: f64) -> f64 {
    let n = time.len().min(value.len());
    let after = time[..n].partition_point(|&x| x <= t);
    if after == 0 {
        return f64::NAN;
    }
    let (t0, v0) = (time[after - 1], value[after - 1]);
    if t0 == t {
        return v0;
    }
    if after == n {
        return f64::NAN;
    }
    let (t1, v1) = (time[after], value[after]);
    v0 + (v1 - v0) * ((t - t0) / (t1 - t0))
}

/// Times from `start` to at most `end` in equal steps; empty for a step that is not positive.
pub fn uniform(start: f64, end: f64, step: f64) -> Vec<f64> {
    if !(step > 0.0 && end >= start && (end - start).is_finite()) {
        return Vec::new();
    }
    let count = ((end - start) / step + 1e-9) as usize;
    (0..=count).map(|i| start + step * i as f64).collect()
}

/// The median step of a time base; NaN for fewer than two samples.
pub fn median_step(time: &[f64]) -> f64 {
    let mut steps: Vec<f64> = time.windows(2).map(|w| w[1] - w[0]).collect();
    steps.sort_by(f64::total_cmp);
    steps.get(steps.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Values that are not finite replaced by a straight line between their neighbours, and at the ends by the
/// nearest. None if there is no finite value.
pub fn bridge_gaps(values: &[f64]) -> Option<Vec<f64>> {
    let mut out = values.to_vec();
    let first = values.iter().position(|v| v.is_finite())?;
    out[..first].fill(values[first]);
    let mut last = first;
    for i in first + 1..values.len() {
        if !values[i].is_finite() {
            continue;
        }
        let span = (i - last) as f64;
        for j in last + 1..i {
            out[j] = values[last] + (values[i] - values[last]) * ((j - last) as f64 / span);
        }
        last = i;
    }
    out[last + 1..].fill(values[last]);
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn straight_lines_inside_nothing_outside() {
        let (t, v) = ([0.0, 1.0, 3.0], [0.0, 10.0, -10.0]);
        let out = linear(&t, &v, &[-0.1, 0.0, 0.5, 1.0, 2.0, 3.0, 3.1]);
        assert!(out[0].is_nan() && out[6].is_nan());
        assert_eq!(out[1..6], [0.0, 5.0, 10.0, 0.0, -10.0]);
        assert!(linear_at(&[], &[], 0.0).is_nan());
    }

    #[test]
    fn grids() {
        assert_eq!(uniform(0.0, 0.3, 0.1).len(), 4);
        assert!(uniform(0.0, 1.0, 0.0).is_empty() && uniform(1.0, 0.0, 0.1).is_empty());
        assert_eq!(median_step(&[0.0, 1.0, 2.0, 7.0]), 1.0);
    }

    #[test]
    fn gaps_are_bridged() {
        let nan = f64::NAN;
        assert_eq!(bridge_gaps(&[nan, 1.0, nan, nan, 4.0, nan]).unwrap(), [1.0, 1.0, 2.0, 3.0, 4.0, 4.0]);
        assert_eq!(bridge_gaps(&[nan]), None);
    }
}

//! Root mean square, peak, percentiles. Values that are not finite are absent and left out.

/// Root of the mean of squares; NaN without a finite value.
pub fn rms(values: &[f64]) -> f64 {
    let (sum, count) = finite(values).fold((0.0, 0_usize), |(sum, n), v| (sum + v * v, n + 1));
    if count == 0 { f64::NAN } else { (sum / count as f64).sqrt() }
}

/// Mean; NaN without a finite value.
pub fn mean(values: &[f64]) -> f64 {
    let (sum, count) = finite(values).fold((0.0, 0_usize), |(sum, n), v| (sum + v, n + 1));
    if count == 0 { f64::NAN } else { sum / count as f64 }
}

/// Largest magnitude; NaN without a finite value.
pub fn peak(values: &[f64]) -> f64 {
    finite(values).map(f64::abs).reduce(f64::max).unwrap_or(f64::NAN)
}

/// Smallest and largest value.
pub fn range(values: &[f64]) -> Option<(f64, f64)> {
    finite(values)
        .fold(None, |range, v| Some(range.map_or((v, v), |(a, b): (f64, f64)| (a.min(v), b.max(v)))))
}

/// Half the peak-to-peak value; NaN without a finite value.
pub fn amplitude(values: &[f64]) -> f64 {
    range(values).map_or(f64::NAN, |(low, high)| 0.5 * (high - low))
}

fn finite(values: &[f64]) -> impl Iterator<Item = f64> + '_ {
    values.iter().copied().filter(|v| v.is_finite())
}

/// A distribution in a few numbers. Percentiles by nearest rank: each is a value that occurred.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Distribution {
    /// Finite values.
    pub count: usize,
    /// Smallest.
    pub min: f64,
    /// Mean.
    pub mean: f64,
    /// Median.
    pub p50: f64,
    /// 99th percentile.
    pub p99: f64,
    /// 99.9th percentile.
    pub p99_9: f64,
    /// Largest.
    pub max: f64,
}

impl Distribution {
    /// The distribution of the finite values; None if there are none.
    pub fn of(values: &[f64]) -> Option<Distribution> {
        let mut sorted: Vec<f64> = finite(values).collect();
        sorted.sort_by(f64::total_cmp);
        let (&min, &max) = (sorted.first()?, sorted.last()?);
        Some(Distribution {
            count: sorted.len(),
            min,
            mean: mean(&sorted),
            p50: percentile_of_sorted(&sorted, 50.0),
            p99: percentile_of_sorted(&sorted, 99.0),
            p99_9: percentile_of_sorted(&sorted, 99.9),
            max,
        })
    }
}

/// Percentile of ascending values by nearest rank; NaN of none.
pub fn percentile_of_sorted(sorted: &[f64], percent: f64) -> f64 {
    // 99.9/100·1000 is a hair above 999 in doubles: without the margin the rank would be one too high.
    let rank = (percent / 100.0 * sorted.len() as f64 - 1e-9).ceil().max(1.0) as usize;
    sorted.get(rank.min(sorted.len()).wrapping_sub(1)).copied().unwrap_or(f64::NAN)
}

/// Values counted in bins of equal width on a logarithmic axis.
#[derive(Debug, Clone, PartialEq)]
pub struct LogHistogram {
    /// Borders of the bins, one more than counts.
    pub borders: Vec<f64>,
    /// Values in each bin.
    pub counts: Vec<u64>,
    /// Values below the first border, zero and negative ones among them.
    pub below: u64,
    /// Values at or above the last border.
    pub above: u64,
}

impl LogHistogram {
    /// Counts the finite values between `low` and `high` (both positive) in `bins` bins.
    pub fn of(values: &[f64], low: f64, high: f64, bins: usize) -> LogHistogram {
        debug_assert!(low > 0.0 && high > low && bins > 0);
        let step = (high / low).ln() / bins as f64;
        let borders = (0..=bins).map(|i| low * (step * i as f64).exp()).collect();
        let mut histogram = LogHistogram { borders, counts: vec![0; bins], below: 0, above: 0 };
        for value in finite(values) {
            if value < low {
                histogram.below += 1;
            } else {
                match histogram.counts.get_mut(((value / low).ln() / step) as usize) {
                    Some(count) => *count += 1,
                    None => histogram.above += 1,
                }
            }
        }
        histogram
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_of_known_signals() {
        let sine: Vec<f64> =
            (0..1000).map(|i| 3.0 * (i as f64 * std::f64::consts::TAU / 100.0).sin()).collect();
        assert!((rms(&sine) - 3.0 / 2_f64.sqrt()).abs() < 1e-12);
        assert!((peak(&sine) - 3.0).abs() < 1e-12);
        assert!((amplitude(&[-1.0, 5.0, f64::NAN]) - 3.0).abs() < 1e-15);
        assert!(mean(&sine).abs() < 1e-12);
        assert_eq!(rms(&[f64::NAN, 2.0, f64::INFINITY]), 2.0);
        assert!(rms(&[]).is_nan() && peak(&[f64::NAN]).is_nan());
    }

    #[test]
    fn percentiles_are_values_that_occurred() {
        let values: Vec<f64> = (1..=1000).rev().map(f64::from).collect();
        let d = Distribution::of(&values).unwrap();
        assert_eq!((d.min, d.p50, d.p99, d.p99_9, d.max), (1.0, 500.0, 990.0, 999.0, 1000.0));
        assert_eq!(Distribution::of(&[7.0]).unwrap().p50, 7.0);
        assert_eq!(Distribution::of(&[f64::NAN]), None);
    }

    #[test]
    fn histogram_counts_every_value_once() {
        let values = [0.0, -1.0, 1e-6, 1.5e-6, 9.9e-4, 1e-3, 5.0, f64::NAN];
        let h = LogHistogram::of(&values, 1e-6, 1e-3, 30);
        assert_eq!((h.below, h.above), (2, 2));
        assert_eq!(h.counts.iter().sum::<u64>(), 3);
        assert_eq!((h.counts[0], h.counts[29]), (1, 1));
        assert!((h.borders[10] / 1e-5 - 1.0).abs() < 1e-12);
    }
}

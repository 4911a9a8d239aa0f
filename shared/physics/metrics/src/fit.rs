//! Straight lines through data, steady parts of a run, and loops: gradient and hysteresis width.

/// A straight line through points by least squares.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Line {
    /// Gradient.
    pub slope: f64,
    /// Value at 0.
    pub intercept: f64,
    /// Share of the variance the line explains, 0 to 1.
    pub r_squared: f64,
    /// Standard error of the gradient.
    pub slope_standard_error: f64,
    /// Points used.
    pub count: usize,
}

/// The line of least squares through the points whose both values are finite. None if x does not vary or
/// there are fewer than two.
pub fn line(x: &[f64], y: &[f64]) -> Option<Line> {
    let points: Vec<(f64, f64)> =
        x.iter().copied().zip(y.iter().copied()).filter(|(x, y)| x.is_finite() && y.is_finite()).collect();
    let n = points.len() as f64;
    if points.len() < 2 {
        return None;
    }
    let (mean_x, mean_y) = points.iter().fold((0.0, 0.0), |(a, b), (x, y)| (a + x / n, b + y / n));
    let (mut xx, mut yy, mut xy) = (0.0, 0.0, 0.0);
    for (x, y) in &points {
        let (x, y) = (x - mean_x, y - mean_y);
        xx += x * x;
        yy += y * y;
        xy += x * y;
    }
    if xx <= 0.0 {
        return None;
    }
    let slope = xy / xx;
    let residual = (yy - slope * xy).max(0.0);
    Some(Line {
        slope,
        intercept: mean_y - slope * mean_x,
        r_squared: if yy > 0.0 { 1.0 - residual / yy } else { 1.0 },
        slope_standard_error: if points.len() > 2 { (residual / (n - 2.0) / xx).sqrt() } else { f64::NAN },
        count: points.len(),
    })
}

/// The line through the points with x within `centre` ± `half_width`: the local gradient.
pub fn gradient(x: &[f64], y: &[f64], centre: f64, half_width: f64) -> Option<Line> {
    let near: Vec<(f64, f64)> =
        x.iter().copied().zip(y.iter().copied()).filter(|(x, _)| (x - centre).abs() <= half_width).collect();
    let (x, y): (Vec<f64>, Vec<f64>) = near.into_iter().unzip();
    line(&x, &y)
}

/// Parts of at least `samples_min` samples in which the signal stays within ±`tolerance` of the middle of
/// its range there, as ranges of indices; greedy from the start, without overlap.
pub fn steady_parts(value: &[f64], tolerance: f64, samples_min: usize) -> Vec<std::ops::Range<usize>> {
    let mut parts = Vec::new();
    let mut start = 0;
    while start < value.len() {
        let (mut low, mut high) = (value[start], value[start]);
        let mut end = start;
        while end < value.len() && value[end].is_finite() {
            (low, high) = (low.min(value[end]), high.max(value[end]));
            if high - low > 2.0 * tolerance {
                break;
            }
            end += 1;
        }
        if end - start >= samples_min.max(1) {
            parts.push(start..end);
            start = end;
        } else {
            start += 1;
        }
    }
    parts
}

/// A loop of y over x where it crosses a value of x.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Crossing {
    /// Mean of y where x rises through the value.
    pub rising: f64,
    /// Mean of y where x falls through it.
    pub falling: f64,
    /// Rising minus falling: the width of the hysteresis.
    pub width: f64,
    /// Crossings used, rising and falling together.
    pub count: usize,
}

/// y where x crosses `at` between two neighbouring points, and whether x falls there.
fn met(x: &[f64], y: &[f64], at: f64) -> Option<(bool, f64)> {
    let (before, after) = (x[0] - at, x[1] - at);
    let rising = before < 0.0 && after >= 0.0;
    let falling = before > 0.0 && after <= 0.0;
    let value = y[0] + (y[1] - y[0]) * (before / (before - after));
    ((rising || falling) && value.is_finite()).then_some((falling, value))
}

/// Sum and number of values met rising and falling, as means. None unless there are both.
fn means([(up, ups), (down, downs)]: [(f64, usize); 2]) -> Option<Crossing> {
    if ups == 0 || downs == 0 {
        return None;
    }
    let (rising, falling) = (up / ups as f64, down / downs as f64);
    Some(Crossing { rising, falling, width: rising - falling, count: ups + downs })
}

/// y where x crosses `at`, rising and falling. None unless it does both.
pub fn crossing(x: &[f64], y: &[f64], at: f64) -> Option<Crossing> {
    let mut sums = [(0.0, 0_usize); 2];
    for (x, y) in x.windows(2).zip(y.windows(2)) {
        if let Some((falling, value)) = met(x, y, at) {
            let (sum, count) = &mut sums[usize::from(falling)];
            *sum += value;
            *count += 1;
        }
    }
    means(sums)
}

/// As [`crossing`], but only on the way from `least` or more on the one side of `at` to `least` or more on the other: a
/// signal that trembles about the value crosses it often and says nothing of the loop.
pub fn passage(x: &[f64], y: &[f64], at: f64, least: f64) -> Option<Crossing> {
    let mut sums = [(0.0, 0_usize); 2];
    let (mut side, mut sum, mut count) = (0.0, 0.0, 0_usize);
    for (x, y) in x.windows(2).zip(y.windows(2)) {
        if let Some((_, value)) = met(x, y, at) {
            sum += value;
            count += 1;
        }
        let off = x[1] - at;
        if off.abs() < least || off.is_nan() {
            continue;
        }
        if off.signum() == -side && count > 0 {
            let (means, passages) = &mut sums[usize::from(off < 0.0)];
            *means += sum / count as f64;
            *passages += 1;
        }
        (side, sum, count) = (off.signum(), 0.0, 0);
    }
    means(sums)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    #[test]
    fn a_line_is_found_exactly_and_its_error_matches_the_textbook() {
        let x: Vec<f64> = (0..50).map(f64::from).collect();
        let y: Vec<f64> = x.iter().map(|x| 3.0 - 0.25 * x).collect();
        let fit = line(&x, &y).unwrap();
        assert!((fit.slope + 0.25).abs() < 1e-14 && (fit.intercept - 3.0).abs() < 1e-12);
        assert!(fit.r_squared > 1.0 - 1e-12);
        // Anscombe's first set: slope 0.5001, intercept 3.0001, r² 0.6665, standard error 0.1179.
        let x = [10.0, 8.0, 13.0, 9.0, 11.0, 14.0, 6.0, 4.0, 12.0, 7.0, 5.0];
        let y = [8.04, 6.95, 7.58, 8.81, 8.33, 9.96, 7.24, 4.26, 10.84, 4.82, 5.68];
        let fit = line(&x, &y).unwrap();
        assert!((fit.slope - 0.5001).abs() < 1e-4 && (fit.intercept - 3.0001).abs() < 1e-4, "{fit:?}");
        assert!((fit.r_squared - 0.6665).abs() < 1e-4 && (fit.slope_standard_error - 0.1179).abs() < 1e-4);
        assert_eq!(line(&[1.0, 1.0], &[0.0, 2.0]), None);
    }

    #[test]
    fn gradient_is_local() {
        let x: Vec<f64> = (-100..=100).map(|i| f64::from(i) * 0.01).collect();
        let y: Vec<f64> = x.iter().map(|x| x * x * x).collect();
        let near = gradient(&x, &y, 0.8, 0.055).unwrap();
        assert!((near.slope - 3.0 * 0.64).abs() < 0.01 && near.count == 11, "{near:?}");
        assert!(gradient(&x, &y, 0.0, 0.05).unwrap().slope < 0.01);
    }

    #[test]
    fn steady_parts_are_where_the_signal_stands() {
        let mut value = vec![1.0; 100];
        value.extend((0..50).map(|i| 1.0 + 0.1 * f64::from(i)));
        value.extend(vec![6.0; 80]);
        let parts = steady_parts(&value, 0.01, 40);
        assert_eq!(parts.len(), 2);
        assert_eq!(parts[0], 0..101);
        assert_eq!(parts[1], 150..230);
        assert!(steady_parts(&[f64::NAN; 10], 1.0, 2).is_empty());
    }

    #[test]
    fn the_width_of_an_ellipse_at_its_centre() {
        // y lags x by φ: at x = 0 rising y = −b sin φ, falling + b sin φ.
        let phase = 0.3_f64;
        let (x, y): (Vec<f64>, Vec<f64>) = (0..20_000)
            .map(|i| i as f64 * 1e-3 * TAU * 0.2)
            .map(|w| (w.sin(), 4.0 * (w - phase).sin()))
            .unzip();
        let found = crossing(&x, &y, 0.0).unwrap();
        assert!((found.width + 8.0 * phase.sin()).abs() < 1e-5, "{found:?}");
        assert_eq!(crossing(&x, &y, 2.0), None);
        // The same loop, then trembling about the middle: only passages are the loop's.
        let trembling = (0..5000).map(|i| f64::from(i) * 0.05).map(|w| (0.01 * w.sin(), 0.02 * w.sin()));
        let (tx, ty): (Vec<f64>, Vec<f64>) = trembling.unzip();
        let (x, y) = ([x, tx.clone()].concat(), [y, ty.clone()].concat());
        assert!(crossing(&x, &y, 0.0).unwrap().width.abs() < 0.3 * found.width.abs());
        let passed = passage(&x, &y, 0.0, 0.1).unwrap();
        assert!((passed.width - found.width).abs() < 1e-4 && passed.count < found.count + 1, "{passed:?}");
        assert_eq!(passage(&tx, &ty, 0.0, 0.1), None);
    }
}

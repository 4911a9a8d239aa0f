//! Fewer points for the eye, no peak lost: of each stretch the smallest and the largest value stay.

/// Points (x, y) with at most about `points` of them; NaN marks a gap and stays one. `x` ascends.
pub(crate) fn min_max(x: &[f64], y: &[f64], points: usize) -> (Vec<f64>, Vec<f64>) {
    let n = x.len().min(y.len());
    if n <= points || points < 4 {
        return (x[..n].to_vec(), y[..n].to_vec());
    }
    let stretch = n.div_ceil(points / 2);
    let (mut out_x, mut out_y) = (Vec::with_capacity(points + 2), Vec::with_capacity(points + 2));
    let mut keep = |i: usize| {
        out_x.push(x[i]);
        out_y.push(y[i]);
    };
    keep(0);
    for start in (1..n - 1).step_by(stretch) {
        let end = (start + stretch).min(n - 1);
        let finite = || (start..end).filter(|&i| y[i].is_finite());
        let low = finite().min_by(|&a, &b| y[a].total_cmp(&y[b]));
        let high = finite().max_by(|&a, &b| y[a].total_cmp(&y[b]));
        let gap = (start..end).find(|&i| !y[i].is_finite());
        let mut kept = [low, high, gap].into_iter().flatten().collect::<Vec<_>>();
        kept.sort_unstable();
        kept.dedup();
        kept.into_iter().for_each(&mut keep);
    }
    keep(n - 1);
    (out_x, out_y)
}

/// Every how manieth point of a curve in the plane to keep it at about `points`.
pub(crate) fn stride(len: usize, points: usize) -> usize {
    len.div_ceil(points.max(1)).max(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn peaks_ends_and_gaps_survive() {
        let x: Vec<f64> = (0..100_000).map(f64::from).collect();
        let mut y: Vec<f64> = x.iter().map(|x| (x * 0.001).sin()).collect();
        y[54_321] = 9.0;
        y[77_777] = -7.0;
        y[30_000..30_400].fill(f64::NAN);
        let (dx, dy) = min_max(&x, &y, 2000);
        assert!(dx.len() <= 3003, "{}", dx.len());
        assert!(dx.windows(2).all(|w| w[0] < w[1]));
        assert_eq!((dx[0], dx[dx.len() - 1]), (0.0, 99_999.0));
        let at = |value: f64| dx[dy.iter().position(|&v| v == value).unwrap()];
        assert_eq!((at(9.0), at(-7.0)), (54_321.0, 77_777.0));
        assert!(dy.iter().any(|v| v.is_nan()), "a gap must not be drawn over");
        let short = min_max(&x[..10], &y[..10], 2000);
        assert_eq!(short.0.len(), 10);
    }
}

//! Points joined by monotone cubics [Fritsch and Butland 1984, eq. 4 with Brodlie's weights; "PCHIP"]:
//! continuous rate, no overshoot between points; flat at both ends, constant beyond them.

use crate::shape::Motion;

/// A curve through points.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    at: Vec<f64>,
    value: Vec<f64>,
    slope: Vec<f64>,
}

impl Curve {
    /// Through points at strictly increasing places, at least one of them.
    pub fn new(at: Vec<f64>, value: Vec<f64>) -> Self {
        assert!(!at.is_empty() && at.len() == value.len(), "a curve needs as many values as places");
        assert!(at.windows(2).all(|pair| pair[1] > pair[0]), "a curve's places must increase");
        let mut slope = vec![0.0; at.len()];
        for i in 1..at.len().saturating_sub(1) {
            let (before, after) = (at[i] - at[i - 1], at[i + 1] - at[i]);
            let (d0, d1) = ((value[i] - value[i - 1]) / before, (value[i + 1] - value[i]) / after);
            if d0 * d1 > 0.0 {
                let (w0, w1) = (2.0 * after + before, after + 2.0 * before);
                slope[i] = (w0 + w1) / (w0 / d0 + w1 / d1);
            }
        }
        Self { at, value, slope }
    }

    /// Value and derivative. Takes one binary search.
    pub fn at(&self, x: f64) -> Motion {
        let last = self.at.len() - 1;
        // Written so that NaN ends at the first value.
        if x >= self.at[last] {
            return Motion::rest(self.value[last]);
        }
        let next = self.at.partition_point(|place| *place <= x);
        if next == 0 || x.is_nan() {
            return Motion::rest(self.value[0]);
        }
        let (i, j) = (next - 1, next);
        let h = self.at[j] - self.at[i];
        let u = (x - self.at[i]) / h;
        let rise = self.value[j] - self.value[i];
        let (m0, m1) = (self.slope[i] * h, self.slope[j] * h);
        let (a, b) = (m0 - rise, rise - m1);
        // Hermite cubic: v0 + u·rise + u(1−u)·[(1−u)·a + u·b].
        let value = self.value[i] + u * rise + u * (1.0 - u) * ((1.0 - u) * a + u * b);
        let bend = (1.0 - 2.0 * u) * ((1.0 - u) * a + u * b) + u * (1.0 - u) * (b - a);
        Motion { value, rate: (rise + bend) / h }
    }

    /// The last place.
    pub fn end(&self) -> f64 {
        self.at[self.at.len() - 1]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn goes_through_its_points_without_overshoot_and_is_smooth() {
        let curve = Curve::new(vec![0.0, 1.0, 2.0, 4.0], vec![0.0, 1.0, 1.0, 5.0]);
        for (x, y) in [(0.0, 0.0), (1.0, 1.0), (2.0, 1.0), (4.0, 5.0), (9.0, 5.0), (-1.0, 0.0)] {
            assert!((curve.at(x).value - y).abs() < 1e-14);
        }
        let mut before = curve.at(0.0);
        for i in 1..=4000 {
            let x = f64::from(i) * 1e-3;
            let now = curve.at(x);
            assert!(now.value >= before.value - 1e-15, "overshoot at {x}");
            assert!((now.rate - before.rate).abs() < 0.02, "jump of the rate at {x}");
            let mean = (now.value - before.value) / 1e-3;
            assert!(
                (mean - 0.5 * (now.rate + before.rate)).abs() < 1e-5,
                "rate is not the derivative at {x}"
            );
            before = now;
        }
        assert_eq!(curve.at(f64::NAN).value, 0.0);
    }
}

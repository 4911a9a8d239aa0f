//! Characteristic curves: straight lines between points, end slopes continued, without search cost that grows
//! with time (the tables are short).

/// A curve y(x) through given points.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    x: Vec<f64>,
    y: Vec<f64>,
}

impl Curve {
    /// Through the points (x, y); `x` increasing, at least two, as the configuration has checked.
    ///
    /// `scale_x` and `scale_y` bring the file's units to SI.
    #[must_use]
    pub fn new(x: &[f64], y: &[f64], scale_x: f64, scale_y: f64) -> Self {
        assert!(x.len() >= 2 && x.len() == y.len(), "a curve needs matching points");
        assert!(x.windows(2).all(|w| w[0] < w[1]), "a curve's abscissa must increase");
        Self { x: x.iter().map(|v| v * scale_x).collect(), y: y.iter().map(|v| v * scale_y).collect() }
    }

    fn segment(&self, x: f64) -> usize {
        let last = self.x.len() - 2;
        let mut k = 0;
        while k < last && x >= self.x[k + 1] {
            k += 1;
        }
        k
    }

    /// Value and slope at `x`.
    #[must_use]
    pub fn value_and_slope(&self, x: f64) -> (f64, f64) {
        let k = self.segment(x);
        let slope = (self.y[k + 1] - self.y[k]) / (self.x[k + 1] - self.x[k]);
        (self.y[k] + slope * (x - self.x[k]), slope)
    }

    /// Value at `x`.
    #[must_use]
    pub fn value(&self, x: f64) -> f64 {
        self.value_and_slope(x).0
    }

    /// Value at `x`, held constant outside the points.
    #[must_use]
    pub fn held(&self, x: f64) -> f64 {
        self.value(x.clamp(self.x[0], self.x[self.x.len() - 1]))
    }

    /// The inverse of a strictly monotonic curve, if it is one.
    #[must_use]
    pub fn inverse(&self) -> Option<Self> {
        if self.y.windows(2).all(|w| w[0] < w[1]) {
            Some(Self { x: self.y.clone(), y: self.x.clone() })
        } else if self.y.windows(2).all(|w| w[0] > w[1]) {
            Some(Self {
                x: self.y.iter().rev().copied().collect(),
                y: self.x.iter().rev().copied().collect(),
            })
        } else {
            None
        }
    }
}

/// A family of curves y(x) at increasing values of a parameter p, linear between them, held at the ends.
#[derive(Debug, Clone, PartialEq)]
pub struct Family {
    p: Vec<f64>,
    curves: Vec<Curve>,
}

impl Family {
    /// One row of `y` for each `p`.
    #[must_use]
    pub fn new(p: &[f64], x: &[f64], y: &[Vec<f64>], scale_y: f64) -> Self {
        assert!(!p.is_empty() && p.len() == y.len(), "one curve for each parameter value");
        Self { p: p.to_vec(), curves: y.iter().map(|row| Curve::new(x, row, 1.0, scale_y)).collect() }
    }

    /// Value at (p, x); x held at the ends.
    #[must_use]
    pub fn held(&self, p: f64, x: f64) -> f64 {
        let last = self.p.len() - 1;
        if last == 0 || p <= self.p[0] {
            return self.curves[0].held(x);
        }
        if p >= self.p[last] {
            return self.curves[last].held(x);
        }
        let mut k = 0;
        while k + 1 < last && p >= self.p[k + 1] {
            k += 1;
        }
        let w = (p - self.p[k]) / (self.p[k + 1] - self.p[k]);
        (1.0 - w) * self.curves[k].held(x) + w * self.curves[k + 1].held(x)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_between_points_and_beyond() {
        let c = Curve::new(&[0.0, 1.0, 3.0], &[0.0, 2.0, 0.0], 1.0, 1.0);
        assert_eq!(c.value(0.5), 1.0);
        assert_eq!(c.value(2.0), 1.0);
        assert_eq!(c.value(-1.0), -2.0);
        assert_eq!(c.value(4.0), -1.0);
        assert_eq!(c.held(4.0), 0.0);
        assert_eq!(c.value_and_slope(2.5).1, -1.0);
        assert!(c.inverse().is_none());
        let up = Curve::new(&[0.0, 2.0], &[1.0, 5.0], 1.0, 1.0);
        assert_eq!(up.inverse().map(|i| i.value(3.0)), Some(1.0));
    }

    #[test]
    fn family_is_linear_in_its_parameter() {
        let f = Family::new(&[0.0, 10.0], &[0.0, 1.0], &[vec![0.0, 10.0], vec![0.0, 20.0]], 1.0);
        assert_eq!(f.held(5.0, 1.0), 15.0);
        assert_eq!(f.held(-5.0, 0.5), 5.0);
        assert_eq!(f.held(50.0, 2.0), 20.0);
    }
}

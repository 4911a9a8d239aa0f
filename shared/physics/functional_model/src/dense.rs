//! Small dense linear algebra on caller-owned storage, so that a step can refresh its matrices without allocation:
//! LU with partial pivoting on row-scaled values, and the matrix exponential by scaling and squaring with the (6, 6)
//! Pade approximant (Moler and Van Loan 2003, SIAM Rev. 45, 3, method 3). Row-major.

/// LU factors of an n x n matrix.
#[derive(Debug, Clone, Default)]
pub(crate) struct Lu {
    pub n: usize,
    pub a: Vec<f64>,
    row: Vec<usize>,
    work: Vec<f64>,
    scale: Vec<f64>,
}

impl Lu {
    pub fn new(n: usize) -> Lu {
        Lu { n, a: vec![0.0; n * n], row: vec![0; n], work: vec![0.0; n], scale: vec![0.0; n] }
    }

    /// Factors `self.a` in place. False when it is singular to working precision (the factors are then unusable).
    pub fn factor(&mut self) -> bool {
        let (a, row, scale) = (&mut self.a[..], &mut self.row[..], &mut self.scale[..]);
        // The sizes of most models, with the loops unrolled.
        match self.n {
            0 => true,
            1 => factor::<1>(1, a, row, scale),
            2 => factor::<2>(2, a, row, scale),
            3 => factor::<3>(3, a, row, scale),
            4 => factor::<4>(4, a, row, scale),
            5 => factor::<5>(5, a, row, scale),
            6 => factor::<6>(6, a, row, scale),
            n => factor::<0>(n, a, row, scale),
        }
    }

    /// Solves in place.
    pub fn solve(&mut self, b: &mut [f64]) {
        let (a, row, work) = (&self.a[..], &self.row[..], &mut self.work[..]);
        match self.n {
            0 => {}
            1 => solve::<1>(1, a, row, work, b),
            2 => solve::<2>(2, a, row, work, b),
            3 => solve::<3>(3, a, row, work, b),
            4 => solve::<4>(4, a, row, work, b),
            5 => solve::<5>(5, a, row, work, b),
            6 => solve::<6>(6, a, row, work, b),
            n => solve::<0>(n, a, row, work, b),
        }
    }
}

/// The factors, rows exchanged in place, reciprocal pivots on the diagonal. `N` = n where it is known at compile time,
/// else 0.
#[inline(always)]
fn factor<const N: usize>(n: usize, a: &mut [f64], row: &mut [usize], scale: &mut [f64]) -> bool {
    let n = if N > 0 { N } else { n };
    let (a, row, scale) = (&mut a[..n * n], &mut row[..n], &mut scale[..n]);
    for i in 0..n {
        row[i] = i;
        let mut largest = 0.0f64;
        let mut sum = 0.0;
        for j in 0..n {
            largest = largest.max(a[i * n + j].abs());
            sum += a[i * n + j];
        }
        if largest == 0.0 || !sum.is_finite() {
            return false;
        }
        scale[i] = 1.0 / largest;
    }
    for k in 0..n {
        let mut best = k;
        let mut size = 0.0;
        for i in k..n {
            let s = a[i * n + k].abs() * scale[i];
            if s > size {
                size = s;
                best = i;
            }
        }
        if size < 1e-14 {
            return false;
        }
        if best != k {
            row.swap(k, best);
            scale.swap(k, best);
            for j in 0..n {
                a.swap(k * n + j, best * n + j);
            }
        }
        let inverse = 1.0 / a[k * n + k];
        a[k * n + k] = inverse;
        for i in k + 1..n {
            let f = a[i * n + k] * inverse;
            a[i * n + k] = f;
            if f != 0.0 {
                for j in k + 1..n {
                    a[i * n + j] -= f * a[k * n + j];
                }
            }
        }
    }
    true
}

#[inline(always)]
fn solve<const N: usize>(n: usize, a: &[f64], row: &[usize], work: &mut [f64], b: &mut [f64]) {
    let n = if N > 0 { N } else { n };
    let (a, row, work, b) = (&a[..n * n], &row[..n], &mut work[..n], &mut b[..n]);
    for i in 0..n {
        let mut s = b[row[i]];
        for j in 0..i {
            s -= a[i * n + j] * work[j];
        }
        work[i] = s;
    }
    for i in (0..n).rev() {
        let mut s = work[i];
        for j in i + 1..n {
            s -= a[i * n + j] * b[j];
        }
        b[i] = s * a[i * n + i];
    }
}

/// c = a * b, all n x n.
fn multiply(n: usize, a: &[f64], b: &[f64], c: &mut [f64]) {
    c.fill(0.0);
    for i in 0..n {
        for k in 0..n {
            let f = a[i * n + k];
            if f != 0.0 {
                for j in 0..n {
                    c[i * n + j] += f * b[k * n + j];
                }
            }
        }
    }
}

/// Working storage of the exponential.
#[derive(Debug, Clone, Default)]
pub(crate) struct Exponential {
    n: usize,
    a: Vec<f64>,
    power: Vec<f64>,
    next: Vec<f64>,
    numerator: Vec<f64>,
    lu: Lu,
    column: Vec<f64>,
    scale: Vec<f64>,
}

impl Exponential {
    pub fn new(n: usize) -> Exponential {
        let m = || vec![0.0; n * n];
        Exponential {
            n,
            a: m(),
            power: m(),
            next: m(),
            numerator: m(),
            lu: Lu::new(n),
            column: vec![0.0; n],
            scale: vec![1.0; n],
        }
    }

    /// result = exp(h * a)
    pub fn of(&mut self, a: &[f64], h: f64, result: &mut [f64]) {
        let n = self.n;
        for (d, v) in self.a.iter_mut().zip(a) {
            *d = v * h;
        }
        self.balance();
        let norm = (0..n)
            .map(|i| self.a[i * n..(i + 1) * n].iter().map(|v| v.abs()).sum::<f64>())
            .fold(0.0f64, f64::max);
        let squarings = if norm > 0.25 { ((norm / 0.25).log2().ceil() as i32).clamp(0, 60) } else { 0 };
        let s = 0.5f64.powi(squarings);
        for d in &mut self.a {
            *d *= s;
        }
        self.power.fill(0.0);
        for i in 0..n {
            self.power[i * n + i] = 1.0;
        }
        self.numerator.copy_from_slice(&self.power);
        self.lu.a.copy_from_slice(&self.power);
        let (q, mut c, mut sign) = (6, 1.0, 1.0);
        for k in 1..=q {
            c *= f64::from(q - k + 1) / f64::from(k * (2 * q - k + 1));
            multiply(n, &self.a, &self.power, &mut self.next);
            std::mem::swap(&mut self.power, &mut self.next);
            sign = -sign;
            for i in 0..n * n {
                self.numerator[i] += c * self.power[i];
                self.lu.a[i] += sign * c * self.power[i];
            }
        }
        // With the norm at most a quarter the denominator is close to the identity: never singular.
        let _ = self.lu.factor();
        for j in 0..n {
            for i in 0..n {
                self.column[i] = self.numerator[i * n + j];
            }
            self.lu.solve(&mut self.column);
            for i in 0..n {
                result[i * n + j] = self.column[i];
            }
        }
        for _ in 0..squarings {
            multiply(n, result, result, &mut self.next);
            result.copy_from_slice(&self.next);
        }
        for i in 0..n {
            for j in 0..n {
                result[i * n + j] *= self.scale[i] / self.scale[j];
            }
        }
    }

    /// Similarity by powers of two that evens rows and columns out (Osborne 1960, J. ACM 7, 338). Without it the
    /// column of an input in other units (a flow into a stiff volume) alone would force so many squarings that the
    /// slow part of the exponential is lost in rounding ("overscaling").
    fn balance(&mut self) {
        let n = self.n;
        self.scale.fill(1.0);
        for _ in 0..6 {
            for i in 0..n {
                let (mut row, mut column) = (0.0f64, 0.0f64);
                for j in (0..n).filter(|j| *j != i) {
                    row += self.a[i * n + j].abs();
                    column += self.a[j * n + i].abs();
                }
                // A zero row (inputs, the constant) or column (pure integrals) may be scaled down at will.
                let f = if row > 0.0 && column > 0.0 {
                    (row / column).sqrt()
                } else if column > 1e-3 {
                    1e-3 / column
                } else if row > 1e-3 {
                    row / 1e-3
                } else {
                    continue;
                };
                let f = f.log2().round().clamp(-300.0, 300.0).exp2();
                if f == 1.0 {
                    continue;
                }
                self.scale[i] *= f;
                for j in 0..n {
                    self.a[i * n + j] /= f;
                }
                for j in 0..n {
                    self.a[j * n + i] *= f;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exponential_of_a_rotation_and_of_a_stiff_decay() {
        let mut e = Exponential::new(2);
        let mut r = [0.0; 4];
        e.of(&[0.0, -3.0, 3.0, 0.0], 0.7, &mut r);
        assert!((r[0] - 2.1f64.cos()).abs() < 1e-14 && (r[2] - 2.1f64.sin()).abs() < 1e-14);
        e.of(&[-1.2, 1.2e13, 0.0, 0.0], 1e-4, &mut r);
        let want = 1e13 * -(-1.2e-4f64).exp_m1();
        assert!((r[1] / want - 1.0).abs() < 1e-13, "an input in large units: {} {want}", r[1]);
        e.of(&[-1e6, 0.0, 0.0, -1.0], 1.0, &mut r);
        assert!(r[0].abs() < 1e-30 && (r[3] - (-1.0f64).exp()).abs() < 1e-9);
    }

    #[test]
    fn lu_solves_and_notices_singular() {
        let mut lu = Lu::new(3);
        lu.a.copy_from_slice(&[0.0, 2.0, 1.0, 1e9, 0.0, 1e9, 3.0, 1.0, 0.0]);
        assert!(lu.factor());
        let mut b = [5.0, 4e9, 5.0];
        lu.solve(&mut b);
        assert!((2.0 * b[1] + b[2] - 5.0).abs() < 1e-12);
        assert!((b[0] + b[2] - 4.0).abs() < 1e-12);
        assert!((3.0 * b[0] + b[1] - 5.0).abs() < 1e-12);
        lu.a.copy_from_slice(&[1.0, 2.0, 3.0, 2.0, 4.0, 6.0, 1.0, 0.0, 1.0]);
        assert!(!lu.factor());
    }
}

//! Dense LU with partial pivoting, PA = LU, in place, for solves with A and with Aᵀ [Golub & Van Loan, §3.4].

use super::SingularRow;

/// Relative size below which a pivot counts as zero.
const PIVOT_MIN: f64 = 1e-14;

/// Dense LU of an n×n matrix; row-major; the workspace is allocated once.
#[derive(Debug, Clone)]
pub struct DenseLu {
    n: usize,
    lu: Vec<f64>,
    /// Row of A that became row k.
    row_of: Vec<usize>,
    odd: bool,
    work: Vec<f64>,
}

impl DenseLu {
    /// Workspace for n×n.
    #[must_use]
    pub fn new(n: usize) -> Self {
        Self { n, lu: vec![0.0; n * n], row_of: (0..n).collect(), odd: false, work: vec![0.0; n] }
    }

    /// Order of the matrix.
    #[must_use]
    pub fn order(&self) -> usize {
        self.n
    }

    /// The matrix to fill before `factor`, row-major, n×n.
    pub fn matrix_mut(&mut self) -> &mut [f64] {
        &mut self.lu
    }

    /// Factors the matrix that was filled in.
    ///
    /// # Errors
    /// The row in which no pivot was left.
    pub fn factor(&mut self) -> Result<(), SingularRow> {
        // One body of code; the orders of single bodies and pairs get loops of known length.
        match self.n {
            6 => self.factor_fixed::<6>(),
            12 => self.factor_fixed::<12>(),
            n => self.factor_of_order(n),
        }
    }

    /// As below, with a length that the compiler knows: no bounds to check.
    fn factor_fixed<const N: usize>(&mut self) -> Result<(), SingularRow> {
        let (rows, _) = self.lu.as_chunks_mut::<N>();
        let (Ok(a), Ok(row_of)) =
            (<&mut [[f64; N]; N]>::try_from(rows), <&mut [usize; N]>::try_from(&mut self.row_of[..]))
        else {
            return Err(SingularRow(0));
        };
        *row_of = std::array::from_fn(|k| k);
        let mut odd = false;
        // The largest pivot so far stands for the size of the matrix.
        let mut scale = 0.0_f64;
        for k in 0..N {
            let mut best = k;
            for i in k + 1..N {
                if a[i][k].abs() > a[best][k].abs() {
                    best = i;
                }
            }
            let pivot = a[best][k];
            scale = scale.max(pivot.abs());
            // Negated so that NaN counts as singular.
            if !(pivot.abs() > PIVOT_MIN * scale) {
                return Err(SingularRow(row_of[best]));
            }
            if best != k {
                a.swap(k, best);
                row_of.swap(k, best);
                odd = !odd;
            }
            let inverse = 1.0 / pivot;
            // Whole rows, with what is done already masked out: loops of one known length.
            let mut pivot_row = a[k];
            pivot_row[..=k].fill(0.0);
            for row in &mut a[k + 1..] {
                let l = row[k] * inverse;
                for c in 0..N {
                    row[c] -= l * pivot_row[c];
                }
                row[k] = l;
            }
        }
        self.odd = odd;
        Ok(())
    }

    fn factor_of_order(&mut self, n: usize) -> Result<(), SingularRow> {
        let lu = &mut self.lu[..n * n];
        let row_of = &mut self.row_of[..n];
        for (k, row) in row_of.iter_mut().enumerate() {
            *row = k;
        }
        self.odd = false;
        let scale = lu.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        for k in 0..n {
            let mut best = k;
            for i in k + 1..n {
                if lu[i * n + k].abs() > lu[best * n + k].abs() {
                    best = i;
                }
            }
            let pivot = lu[best * n + k];
            // Negated so that NaN counts as singular.
            if !(pivot.abs() > PIVOT_MIN * scale) {
                return Err(SingularRow(row_of[best]));
            }
            if best != k {
                let (upper, lower) = lu.split_at_mut(best * n);
                upper[k * n..k * n + n].swap_with_slice(&mut lower[..n]);
                row_of.swap(k, best);
                self.odd = !self.odd;
            }
            let inverse = 1.0 / pivot;
            let (upper, lower) = lu.split_at_mut((k + 1) * n);
            let pivot_row = &upper[k * n..(k + 1) * n];
            for row in lower.chunks_exact_mut(n) {
                let l = row[k] * inverse;
                row[k] = l;
                for c in k + 1..n {
                    row[c] -= l * pivot_row[c];
                }
            }
        }
        Ok(())
    }

    /// Whether det A > 0.
    #[must_use]
    pub fn determinant_positive(&self) -> bool {
        (0..self.n).filter(|k| self.lu[k * self.n + k] < 0.0).count().is_multiple_of(2) != self.odd
    }

    /// x ← A⁻¹ x.
    pub fn solve(&mut self, x: &mut [f64]) {
        match self.n {
            6 => self.solve_fixed::<6>(x),
            12 => self.solve_fixed::<12>(x),
            n => self.solve_of_order(n, x),
        }
    }

    /// The factors and the order of rows with a length that the compiler knows.
    fn fixed<const N: usize>(&self) -> Option<(&[[f64; N]; N], &[usize; N])> {
        let (rows, _) = self.lu.as_chunks::<N>();
        Some((rows.try_into().ok()?, self.row_of[..].try_into().ok()?))
    }

    fn solve_fixed<const N: usize>(&self, x: &mut [f64]) {
        let Some((a, row_of)) = self.fixed::<N>() else { return };
        let mut y: [f64; N] = std::array::from_fn(|k| x[row_of[k]]);
        for k in 1..N {
            for c in 0..k {
                y[k] -= a[k][c] * y[c];
            }
        }
        for k in (0..N).rev() {
            for c in k + 1..N {
                y[k] -= a[k][c] * y[c];
            }
            y[k] /= a[k][k];
        }
        x[..N].copy_from_slice(&y);
    }

    fn solve_transposed_fixed<const N: usize>(&self, x: &mut [f64]) {
        let Some((a, row_of)) = self.fixed::<N>() else { return };
        let mut y: [f64; N] = std::array::from_fn(|k| x[k]);
        for k in 0..N {
            y[k] /= a[k][k];
            for c in k + 1..N {
                y[c] -= a[k][c] * y[k];
            }
        }
        for k in (0..N).rev() {
            for c in 0..k {
                y[c] -= a[k][c] * y[k];
            }
        }
        for k in 0..N {
            x[row_of[k]] = y[k];
        }
    }

    fn solve_of_order(&mut self, n: usize, x: &mut [f64]) {
        let (lu, work, row_of) = (&self.lu[..n * n], &mut self.work[..n], &self.row_of[..n]);
        for k in 0..n {
            work[k] = x[row_of[k]];
        }
        for k in 0..n {
            let mut y = work[k];
            for c in 0..k {
                y -= lu[k * n + c] * work[c];
            }
            work[k] = y;
        }
        for k in (0..n).rev() {
            let mut y = work[k];
            for c in k + 1..n {
                y -= lu[k * n + c] * work[c];
            }
            work[k] = y / lu[k * n + k];
        }
        x[..n].copy_from_slice(work);
    }

    /// x ← A⁻ᵀ x.
    pub fn solve_transposed(&mut self, x: &mut [f64]) {
        match self.n {
            6 => self.solve_transposed_fixed::<6>(x),
            12 => self.solve_transposed_fixed::<12>(x),
            n => self.solve_transposed_of_order(n, x),
        }
    }

    fn solve_transposed_of_order(&mut self, n: usize, x: &mut [f64]) {
        let (lu, work, row_of) = (&self.lu[..n * n], &mut self.work[..n], &self.row_of[..n]);
        work.copy_from_slice(&x[..n]);
        for k in 0..n {
            let y = work[k] / lu[k * n + k];
            work[k] = y;
            for c in k + 1..n {
                work[c] -= lu[k * n + c] * y;
            }
        }
        for k in (0..n).rev() {
            let y = work[k];
            for c in 0..k {
                work[c] -= lu[k * n + c] * y;
            }
        }
        for k in 0..n {
            x[row_of[k]] = work[k];
        }
    }
}

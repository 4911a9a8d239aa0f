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
        let n = self.n;
        for (k, row) in self.row_of.iter_mut().enumerate() {
            *row = k;
        }
        self.odd = false;
        let scale = self.lu.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        for k in 0..n {
            let mut best = k;
            for i in k + 1..n {
                if self.lu[i * n + k].abs() > self.lu[best * n + k].abs() {
                    best = i;
                }
            }
            let pivot = self.lu[best * n + k];
            // Negated so that NaN counts as singular.
            if !(pivot.abs() > PIVOT_MIN * scale) {
                return Err(SingularRow(self.row_of[best]));
            }
            if best != k {
                let (upper, lower) = self.lu.split_at_mut(best * n);
                upper[k * n..k * n + n].swap_with_slice(&mut lower[..n]);
                self.row_of.swap(k, best);
                self.odd = !self.odd;
            }
            let inverse = 1.0 / pivot;
            let (upper, lower) = self.lu.split_at_mut((k + 1) * n);
            let pivot_row = &upper[k * n + k + 1..(k + 1) * n];
            for row in lower.chunks_exact_mut(n) {
                let l = row[k] * inverse;
                row[k] = l;
                if l != 0.0 {
                    for (x, u) in row[k + 1..].iter_mut().zip(pivot_row) {
                        *x -= l * u;
                    }
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
        let n = self.n;
        for k in 0..n {
            self.work[k] = x[self.row_of[k]];
        }
        for k in 0..n {
            let sum: f64 = (0..k).map(|c| self.lu[k * n + c] * self.work[c]).sum();
            self.work[k] -= sum;
        }
        for k in (0..n).rev() {
            let sum: f64 = (k + 1..n).map(|c| self.lu[k * n + c] * self.work[c]).sum();
            self.work[k] = (self.work[k] - sum) / self.lu[k * n + k];
        }
        x[..n].copy_from_slice(&self.work);
    }

    /// x ← A⁻ᵀ x.
    pub fn solve_transposed(&mut self, x: &mut [f64]) {
        let n = self.n;
        self.work.copy_from_slice(&x[..n]);
        for k in 0..n {
            let y = self.work[k] / self.lu[k * n + k];
            self.work[k] = y;
            for c in k + 1..n {
                self.work[c] -= self.lu[k * n + c] * y;
            }
        }
        for k in (0..n).rev() {
            let y = self.work[k];
            for c in 0..k {
                self.work[c] -= self.lu[k * n + c] * y;
            }
        }
        for k in 0..n {
            x[self.row_of[k]] = self.work[k];
        }
    }
}

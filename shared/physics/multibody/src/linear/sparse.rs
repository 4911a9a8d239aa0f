//! Sparse LU with an elimination order chosen once [Markowitz 1957; Duff, Erisman & Reid, *Direct Methods
//! for Sparse Matrices*, ch. 7–10], then refactored row by row along the fixed pattern.
//!
//! The order is chosen on a sample of the matrix by least fill among pivots that are large in their column.
//! A refactoring that meets a small pivot or large growth says so; the caller then falls back on the dense
//! LU with partial pivoting. One solve with A and one with Aᵀ; no allocation after construction.

use super::SingularRow;

/// Share of the column's largest entry that a pivot must have when the order is chosen.
const PIVOT_SHARE: f64 = 0.1;
/// Multipliers beyond this lose too many digits: refuse the fixed order.
const GROWTH_MAX: f64 = 1e5;
/// A pivot below this share of its row's largest entry counts as vanished.
const PIVOT_MIN: f64 = 1e-13;

/// One entry of the pattern: its place in the matrix, and where its value comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Entry {
    /// Row.
    pub row: usize,
    /// Column.
    pub column: usize,
    /// Handed to the value function at refactoring. Two entries at one place add up.
    pub source: usize,
}

/// LU along a fixed pattern and order. Indices below are elimination steps unless said otherwise.
#[derive(Debug, Clone)]
pub struct SparseLu {
    n: usize,
    /// Matrix row and column eliminated at each step.
    row_of: Vec<u32>,
    column_of: Vec<u32>,
    order_odd: bool,
    /// Input entries by step: (source, column step).
    input_start: Vec<u32>,
    input: Vec<(u32, u32)>,
    /// Pattern of L (before `diagonal`) and U (from `diagonal` on) by step, columns ascending.
    start: Vec<u32>,
    diagonal: Vec<u32>,
    columns: Vec<u32>,
    values: Vec<f64>,
    inverse_pivot: Vec<f64>,
    positive: bool,
    work: Vec<f64>,
}

impl SparseLu {
    /// Chooses the order on the sample values of the entries.
    ///
    /// # Errors
    /// A row in which no pivot was left.
    pub fn new(n: usize, entries: &[Entry], value: impl Fn(usize) -> f64) -> Result<Self, SingularRow> {
        let mut a = vec![0.0; n * n];
        let mut pattern = vec![false; n * n];
        for e in entries {
            a[e.row * n + e.column] += value(e.source);
            pattern[e.row * n + e.column] = true;
        }
        let (rows, columns) = choose_order(n, &mut a, &mut pattern)?;
        let mut step_of_row = vec![0; n];
        let mut step_of_column = vec![0; n];
        for k in 0..n {
            step_of_row[rows[k]] = k;
            step_of_column[columns[k]] = k;
        }
        let mut lu = Self {
            n,
            row_of: rows.iter().map(|&x| x as u32).collect(),
            column_of: columns.iter().map(|&x| x as u32).collect(),
            order_odd: is_odd(&rows) != is_odd(&columns),
            input_start: vec![0],
            input: Vec::new(),
            start: vec![0],
            diagonal: Vec::new(),
            columns: Vec::new(),
            values: Vec::new(),
            inverse_pivot: vec![0.0; n],
            positive: true,
            work: vec![0.0; n],
        };
        for k in 0..n {
            for e in entries.iter().filter(|e| step_of_row[e.row] == k) {
                lu.input.push((e.source as u32, step_of_column[e.column] as u32));
            }
            lu.input_start.push(lu.input.len() as u32);
            // After `choose_order` the pattern holds the fill.
            for c in 0..n {
                if c == k {
                    lu.diagonal.push(lu.columns.len() as u32);
                }
                if pattern[rows[k] * n + columns[c]] {
                    lu.columns.push(c as u32);
                }
            }
            lu.start.push(lu.columns.len() as u32);
        }
        lu.values = vec![0.0; lu.columns.len()];
        Ok(lu)
    }

    /// Entries of L and U together.
    #[must_use]
    pub fn fill(&self) -> usize {
        self.columns.len()
    }

    /// Refactors with the values that `value` gives for each entry's source.
    ///
    /// # Errors
    /// The matrix row at which a pivot vanished or the growth was too large.
    #[inline]
    pub fn factor(&mut self, value: impl Fn(usize) -> f64) -> Result<(), SingularRow> {
        let mut negative = 0_u32;
        for k in 0..self.n {
            let (start, diagonal, end) =
                (self.start[k] as usize, self.diagonal[k] as usize, self.start[k + 1] as usize);
            for &c in &self.columns[start..end] {
                self.work[c as usize] = 0.0;
            }
            for &(source, c) in &self.input[self.input_start[k] as usize..self.input_start[k + 1] as usize] {
                self.work[c as usize] += value(source as usize);
            }
            for at in start..diagonal {
                let c = self.columns[at] as usize;
                let l = self.work[c] * self.inverse_pivot[c];
                self.values[at] = l;
                if l == 0.0 {
                    continue;
                }
                if !(l.abs() < GROWTH_MAX) {
                    return Err(SingularRow(self.row_of[k] as usize));
                }
                let upper = self.diagonal[c] as usize + 1..self.start[c + 1] as usize;
                for (&column, &u) in self.columns[upper.clone()].iter().zip(&self.values[upper]) {
                    self.work[column as usize] -= l * u;
                }
            }
            let mut largest = 0.0_f64;
            for at in diagonal..end {
                let x = self.work[self.columns[at] as usize];
                self.values[at] = x;
                largest = largest.max(x.abs());
            }
            let pivot = self.values[diagonal];
            if !(pivot.abs() > PIVOT_MIN * largest && largest > PIVOT_MIN) {
                return Err(SingularRow(self.row_of[k] as usize));
            }
            negative += u32::from(pivot < 0.0);
            self.inverse_pivot[k] = 1.0 / pivot;
        }
        self.positive = negative.is_multiple_of(2) != self.order_odd;
        Ok(())
    }

    /// Whether det A > 0.
    #[must_use]
    pub fn determinant_positive(&self) -> bool {
        self.positive
    }

    /// x ← A⁻¹ x.
    pub fn solve(&mut self, x: &mut [f64]) {
        for k in 0..self.n {
            let lower = self.start[k] as usize..self.diagonal[k] as usize;
            let mut y = x[self.row_of[k] as usize];
            for (&c, &l) in self.columns[lower.clone()].iter().zip(&self.values[lower]) {
                y -= l * self.work[c as usize];
            }
            self.work[k] = y;
        }
        for k in (0..self.n).rev() {
            let upper = self.diagonal[k] as usize + 1..self.start[k + 1] as usize;
            let mut y = self.work[k];
            for (&c, &u) in self.columns[upper.clone()].iter().zip(&self.values[upper]) {
                y -= u * self.work[c as usize];
            }
            self.work[k] = y * self.inverse_pivot[k];
        }
        for k in 0..self.n {
            x[self.column_of[k] as usize] = self.work[k];
        }
    }

    /// x ← A⁻ᵀ x.
    pub fn solve_transposed(&mut self, x: &mut [f64]) {
        for k in 0..self.n {
            self.work[k] = x[self.column_of[k] as usize];
        }
        for k in 0..self.n {
            let y = self.work[k] * self.inverse_pivot[k];
            self.work[k] = y;
            let upper = self.diagonal[k] as usize + 1..self.start[k + 1] as usize;
            for (&c, &u) in self.columns[upper.clone()].iter().zip(&self.values[upper]) {
                self.work[c as usize] -= u * y;
            }
        }
        for k in (0..self.n).rev() {
            let y = self.work[k];
            let lower = self.start[k] as usize..self.diagonal[k] as usize;
            for (&c, &l) in self.columns[lower.clone()].iter().zip(&self.values[lower]) {
                self.work[c as usize] -= l * y;
            }
        }
        for k in 0..self.n {
            x[self.row_of[k] as usize] = self.work[k];
        }
    }
}

/// Eliminates the sample, least fill first; on return `pattern` includes the fill of L and U.
fn choose_order(
    n: usize,
    a: &mut [f64],
    pattern: &mut [bool],
) -> Result<(Vec<usize>, Vec<usize>), SingularRow> {
    let mut rows_left: Vec<usize> = (0..n).collect();
    let mut columns_left: Vec<usize> = (0..n).collect();
    let (mut rows, mut columns) = (Vec::new(), Vec::new());
    for _ in 0..n {
        let mut best: Option<(usize, f64, usize, usize)> = None;
        for (ci, &c) in columns_left.iter().enumerate() {
            let largest = rows_left.iter().fold(0.0_f64, |m, r| m.max(a[r * n + c].abs()));
            let in_column = rows_left.iter().filter(|r| pattern[*r * n + c]).count();
            for (ri, &r) in rows_left.iter().enumerate() {
                let size = a[r * n + c].abs();
                if size <= 1e-12 || size < PIVOT_SHARE * largest {
                    continue;
                }
                let in_row = columns_left.iter().filter(|c| pattern[r * n + **c]).count();
                let cost = (in_row - 1) * (in_column - 1);
                if best.is_none_or(|(least, share, _, _)| {
                    cost < least || (cost == least && size / largest > share + 1e-9)
                }) {
                    best = Some((cost, size / largest, ri, ci));
                }
            }
        }
        let Some((_, _, ri, ci)) = best else {
            return Err(SingularRow(rows_left[0]));
        };
        let (row, column) = (rows_left.remove(ri), columns_left.remove(ci));
        rows.push(row);
        columns.push(column);
        for &r in &rows_left {
            if !pattern[r * n + column] {
                continue;
            }
            let factor = a[r * n + column] / a[row * n + column];
            for &c in &columns_left {
                if pattern[row * n + c] {
                    pattern[r * n + c] = true;
                    a[r * n + c] -= factor * a[row * n + c];
                }
            }
        }
    }
    Ok((rows, columns))
}

/// Parity of a permutation.
fn is_odd(permutation: &[usize]) -> bool {
    let mut seen = vec![false; permutation.len()];
    let mut odd = false;
    for first in 0..permutation.len() {
        let mut at = first;
        let mut length = 0;
        while !seen[at] {
            seen[at] = true;
            at = permutation[at];
            length += 1;
        }
        odd ^= length > 0 && length % 2 == 0;
    }
    odd
}

#[cfg(test)]
mod tests {
    use super::{Entry, SparseLu};
    use crate::linear::DenseLu;

    /// A fixed pseudo-random sequence in [-1, 1].
    fn random(seed: &mut u64) -> f64 {
        *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((*seed >> 11) as f64) / ((1_u64 << 52) as f64) - 1.0
    }

    #[test]
    fn agrees_with_the_dense_factors_on_random_sparse_matrices() {
        let mut seed = 7;
        for n in [1, 2, 5, 24, 36] {
            for _ in 0..20 {
                let mut a = vec![0.0; n * n];
                let mut entries = Vec::new();
                for row in 0..n {
                    for column in 0..n {
                        if row == (column + 3) % n || random(&mut seed) > 0.75 {
                            a[row * n + column] = random(&mut seed) + if row == column { 0.5 } else { 0.0 };
                            entries.push(Entry { row, column, source: row * n + column });
                        }
                    }
                }
                let mut dense = DenseLu::new(n);
                dense.matrix_mut().copy_from_slice(&a);
                let Ok(mut sparse) = SparseLu::new(n, &entries, |k| a[k]) else { continue };
                if dense.factor().is_err() || sparse.factor(|k| a[k]).is_err() {
                    continue;
                }
                assert_eq!(sparse.determinant_positive(), dense.determinant_positive(), "n = {n}");
                let b: Vec<f64> = (0..n).map(|_| random(&mut seed)).collect();
                let (mut x, mut y) = (b.clone(), b.clone());
                sparse.solve(&mut x);
                sparse.solve_transposed(&mut y);
                for k in 0..n {
                    let forward: f64 = (0..n).map(|c| a[k * n + c] * x[c]).sum();
                    let transposed: f64 = (0..n).map(|c| a[c * n + k] * y[c]).sum();
                    let scale = x.iter().chain(&y).fold(1.0_f64, |m, v| m.max(v.abs()));
                    assert!((forward - b[k]).abs() < 1e-9 * scale, "n = {n}");
                    assert!((transposed - b[k]).abs() < 1e-9 * scale, "n = {n}");
                }
                let (mut x2, mut y2) = (b.clone(), b.clone());
                dense.solve(&mut x2);
                dense.solve_transposed(&mut y2);
                let scale = x.iter().chain(&y).fold(1.0_f64, |m, v| m.max(v.abs()));
                assert!((0..n).all(|k| (x[k] - x2[k]).abs() < 1e-6 * scale * scale));
                assert!((0..n).all(|k| (y[k] - y2[k]).abs() < 1e-6 * scale * scale));
            }
        }
    }

    #[test]
    fn a_vanishing_pivot_names_a_row() {
        let entries = [(0, 0), (0, 1), (1, 0), (1, 1)].map(|(row, column)| Entry {
            row,
            column,
            source: 2 * row + column,
        });
        let good = [1.0, 2.0, 3.0, 4.0];
        let singular = [1.0, 2.0, 2.0, 4.0];
        assert!(SparseLu::new(2, &entries, |k| singular[k]).is_err());
        let mut lu = SparseLu::new(2, &entries, |k| good[k]).unwrap();
        assert!(lu.factor(|k| good[k]).is_ok());
        assert!(lu.factor(|k| singular[k]).is_err());
        assert!(lu.factor(|_| f64::NAN).is_err());
    }
}

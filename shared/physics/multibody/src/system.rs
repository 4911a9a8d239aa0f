//! The linear system of a mechanism: its Jacobian, factored sparse along a fixed order, dense with
//! partial pivoting where that order loses digits. General: knows rows and columns only.

use crate::body::{Placed, Pose};
use crate::constraint::{Drive, Row};
use crate::failure::AssemblyError;
use crate::linear::{DenseLu, Entry, SingularRow, SparseLu, dependent_rows};
use crate::mechanism::Mechanism;

/// Largest |Φ| that design poses may leave. [m or m²]
const CLOSURE_MAX: f64 = 1e-9;

/// Jacobian factors of a mechanism with as many equations as coordinates.
#[derive(Debug, Clone)]
pub struct JacobianSystem {
    entries: Vec<Entry>,
    sparse: SparseLu,
    dense: DenseLu,
    used_dense: bool,
}

/// The row's entry behind a source number.
#[inline]
fn value(rows: &[Row], source: usize) -> f64 {
    rows[source >> 4].jac[source & 15]
}

impl JacobianSystem {
    /// Checks the mechanism at its design poses and chooses the elimination order there.
    ///
    /// # Errors
    /// When equations and coordinates differ in number, a constraint is not met, or rows are redundant.
    pub fn new(
        name: &str,
        mechanism: &Mechanism,
        design: &[Pose],
        drives: &[Drive],
    ) -> Result<Self, AssemblyError> {
        let n = mechanism.coordinates();
        let mechanism_name = || name.to_owned();
        let mut rows = vec![Row::ZERO; mechanism.rows()];
        mechanism.evaluate(design, drives, &mut rows);
        let constraint_name =
            |row: usize| mechanism.constraints()[mechanism.constraint_of_row(row)].name.clone();
        if let Some((row, worst)) = rows.iter().enumerate().find(|(_, row)| !(row.phi.abs() < CLOSURE_MAX)) {
            let (constraint, residual) = (constraint_name(row), worst.phi.abs());
            return Err(AssemblyError::NotClosed { mechanism: mechanism_name(), constraint, residual });
        }
        let redundant = dependent_rows(&mechanism.dense_jacobian(&rows), mechanism.rows(), n);
        let redundant_error = |found: &[usize]| {
            let mut constraints: Vec<String> = found.iter().map(|row| constraint_name(*row)).collect();
            constraints.dedup();
            AssemblyError::Redundant { mechanism: mechanism_name(), constraints }
        };
        if !redundant.is_empty() && mechanism.rows() <= n {
            return Err(redundant_error(&redundant));
        }
        if mechanism.rows() != n {
            return Err(AssemblyError::NotDetermined {
                mechanism: mechanism_name(),
                coordinates: n,
                rows: mechanism.rows(),
            });
        }
        let entries = pattern(mechanism, design, drives);
        let sparse = SparseLu::new(n, &entries, |source| value(&rows, source))
            .map_err(|SingularRow(row)| redundant_error(&[row]))?;
        Ok(Self { entries, sparse, dense: DenseLu::new(n), used_dense: false })
    }

    /// Factors the Jacobian in `rows`.
    ///
    /// # Errors
    /// The row at which it is singular.
    #[inline]
    pub fn factor(&mut self, rows: &[Row]) -> Result<(), SingularRow> {
        self.used_dense = self.sparse.factor(|source| value(rows, source)).is_err();
        if self.used_dense { self.factor_dense(rows) } else { Ok(()) }
    }

    fn factor_dense(&mut self, rows: &[Row]) -> Result<(), SingularRow> {
        let n = self.dense.order();
        let matrix = self.dense.matrix_mut();
        matrix.fill(0.0);
        for e in &self.entries {
            matrix[e.row * n + e.column] += value(rows, e.source);
        }
        self.dense.factor()
    }

    /// x ← Φ_q⁻¹ x.
    pub fn solve(&mut self, x: &mut [f64]) {
        if self.used_dense { self.dense.solve(x) } else { self.sparse.solve(x) }
    }

    /// x ← Φ_q⁻ᵀ x.
    pub fn solve_transposed(&mut self, x: &mut [f64]) {
        if self.used_dense { self.dense.solve_transposed(x) } else { self.sparse.solve_transposed(x) }
    }

    /// Whether det Φ_q > 0: changes only across a dead point.
    #[must_use]
    pub fn determinant_positive(&self) -> bool {
        if self.used_dense { self.dense.determinant_positive() } else { self.sparse.determinant_positive() }
    }

    /// Entries of the sparse factors.
    #[must_use]
    pub fn fill(&self) -> usize {
        self.sparse.fill()
    }
}

/// The places that can be non-zero: found by evaluating at poses turned every which way.
fn pattern(mechanism: &Mechanism, design: &[Pose], drives: &[Drive]) -> Vec<Entry> {
    let n = mechanism.rows();
    let mut seen = vec![[false; 12]; n];
    let mut rows = vec![Row::ZERO; n];
    for sample in 0..4_u32 {
        let placed: Vec<Placed> = design
            .iter()
            .enumerate()
            .map(|(body, pose)| {
                // Arbitrary, but the same each time.
                let phase = f64::from(sample) * 1.7 + body as f64 * 0.9;
                let turn = spatial::Vector3::new(phase.sin(), (2.3 * phase).cos(), (3.1 * phase).sin());
                let shift =
                    0.1 * spatial::Vector3::new((1.9 * phase).cos(), phase.sin(), (2.7 * phase).cos());
                Placed::new(&pose.moved(&shift, &(0.8 * turn)))
            })
            .collect();
        mechanism.evaluate_placed(&placed, drives, &mut rows);
        for (row, seen) in rows.iter().zip(&mut seen) {
            for local in 0..12 {
                seen[local] |= row.jac[local] != 0.0;
            }
        }
    }
    let mut entries = Vec::new();
    for (row, seen) in seen.iter().enumerate() {
        let constraint = mechanism.constraint_of_row(row);
        for local in (0..12).filter(|local| seen[*local]) {
            if let Some(column) = mechanism.column(constraint, local) {
                entries.push(Entry { row, column, source: row << 4 | local });
            }
        }
    }
    entries
}

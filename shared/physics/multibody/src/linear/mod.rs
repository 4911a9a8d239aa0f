//! Small linear algebra with workspaces allocated once: dense LU, sparse LU with a fixed elimination
//! order, and the search for dependent rows.

pub mod dense;
pub mod rank;
pub mod sparse;

pub use dense::DenseLu;
pub use rank::dependent_rows;
pub use sparse::{Entry, SparseLu};

/// A pivot vanished in this row (of the matrix handed in): the matrix is singular to working precision.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SingularRow(pub usize);

//! Which rows of a matrix depend on the others: Gaussian elimination with full pivoting.

/// Relative size of the largest remaining entry below which the remaining rows count as dependent.
const RANK_TOLERANCE: f64 = 1e-9;

/// Rows (of `rows`×`columns`, row-major) that are linear combinations of the others, largest pivots first
/// kept. Empty when the rows are independent. For assembly and diagnosis; allocates.
#[must_use]
pub fn dependent_rows(matrix: &[f64], rows: usize, columns: usize) -> Vec<usize> {
    let mut a: Vec<f64> = matrix.to_vec();
    // Rows of different units are scaled to unit length first.
    for row in a.chunks_exact_mut(columns) {
        let norm = row.iter().map(|x| x * x).sum::<f64>().sqrt();
        if norm > 0.0 {
            row.iter_mut().for_each(|x| *x /= norm);
        }
    }
    let mut left: Vec<usize> = (0..rows).collect();
    let mut columns_left: Vec<usize> = (0..columns).collect();
    while !left.is_empty() && !columns_left.is_empty() {
        let (mut best, mut at) = (0.0, (0, 0));
        for (i, r) in left.iter().enumerate() {
            for (j, c) in columns_left.iter().enumerate() {
                let size = a[r * columns + c].abs();
                if size > best {
                    (best, at) = (size, (i, j));
                }
            }
        }
        if best < RANK_TOLERANCE {
            break;
        }
        let (row, column) = (left.remove(at.0), columns_left.remove(at.1));
        let pivot = a[row * columns + column];
        for r in &left {
            let factor = a[r * columns + column] / pivot;
            for c in &columns_left {
                a[r * columns + c] -= factor * a[row * columns + c];
            }
        }
    }
    left
}

#[cfg(test)]
mod tests {
    use super::dependent_rows;

    #[test]
    fn finds_the_dependent_row_and_only_it() {
        let a = [1.0, 2.0, 3.0, 0.0, 1.0, 1.0, 1.0, 3.0, 4.0];
        assert_eq!(dependent_rows(&a, 3, 3).len(), 1);
        assert!(dependent_rows(&[1.0, 2.0, 3.0, 4.0], 2, 2).is_empty());
        assert_eq!(dependent_rows(&[0.0, 0.0, 3.0, 4.0], 2, 2), [0]);
    }
}

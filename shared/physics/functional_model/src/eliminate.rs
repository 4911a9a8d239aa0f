//! Sparse Gaussian elimination of the linear equations of a network, with Markowitz ordering and threshold
//! pivoting (Duff, Erisman and Reid, Direct Methods for Sparse Matrices, ch. 7 and 10) on rows and columns scaled by
//! powers of two. Rectangular and rank-deficient systems are the point: what is left over are the constraints.

/// Sorted (column, coefficient); the row says sum = 0.
pub(crate) type Row = Vec<(u32, f64)>;

/// Result of an elimination.
#[derive(Debug, Default)]
pub(crate) struct Eliminated {
    /// (column, its value as a sum over columns that are not pivots), in pivot order.
    pub solved: Vec<(u32, Row)>,
    /// Rows without pivot columns left: their original row, the row, and rows that went into it.
    pub left: Vec<(usize, Row, Vec<usize>)>,
}

/// A pivot must reach this fraction of the largest candidate in its row.
const THRESHOLD: f64 = 0.05;
/// A sum within this many times its own rounding noise is zero. The noise of each entry is carried along (running
/// error analysis, Higham, Accuracy and Stability of Numerical Algorithms, 3.3): a fixed tolerance would either
/// keep rounding as a coupling that is not there, or drop a small one that is.
const NOISE_FACTOR: f64 = 16.0;

/// Sorted (column, coefficient, rounding noise).
type Noisy = Vec<(u32, f64, f64)>;

struct Active {
    origin: usize,
    row: Noisy,
    made_of: Vec<usize>,
    /// Used as a pivot row only when no other row will do.
    late: bool,
}

fn power_of_two(v: f64) -> f64 {
    if v > 0.0 && v.is_finite() { (-v.log2().round()).clamp(-500.0, 500.0).exp2() } else { 1.0 }
}

/// Eliminates columns by group (0 first); a column of no group is never a pivot.
pub(crate) fn eliminate(rows: &[Row], columns: usize, group: &dyn Fn(u32) -> Option<u8>) -> Eliminated {
    eliminate_keeping(rows, columns, group, &|_| false)
}

/// The same, sparing some rows: they are pivot rows only when no other row will do, so that they come out as they
/// went in plus multiples of the others.
pub(crate) fn eliminate_keeping(
    rows: &[Row],
    columns: usize,
    group: &dyn Fn(u32) -> Option<u8>,
    late: &dyn Fn(usize) -> bool,
) -> Eliminated {
    let (row_scale, column_scale) = scales(rows, columns);
    let mut active: Vec<Active> = rows
        .iter()
        .enumerate()
        .map(|(i, r)| Active {
            origin: i,
            row: r
                .iter()
                .map(|(c, v)| {
                    let v = v * row_scale[i] * column_scale[*c as usize];
                    // Whole numbers up to a power of two are exact: signs and identities of couplings.
                    let exact = v == 0.0 || v.abs().log2().fract() == 0.0;
                    (*c, v, if exact { 0.0 } else { v.abs() * f64::EPSILON })
                })
                .collect(),
            made_of: vec![i],
            late: late(i),
        })
        .collect();
    let groups: Vec<Option<u8>> = (0..columns as u32).map(group).collect();
    let last = groups.iter().flatten().max().copied().unwrap_or(0);
    let mut done: Vec<(usize, u32, Noisy)> = Vec::new();
    let mut count = vec![0u32; columns];
    for g in 0..=last {
        count.fill(0);
        for a in &active {
            for (c, ..) in &a.row {
                if groups[*c as usize] == Some(g) {
                    count[*c as usize] += 1;
                }
            }
        }
        while let Some((at, column)) = choose(&active, &groups, g, &count) {
            let pivot = active.swap_remove(at);
            for (c, ..) in &pivot.row {
                if groups[*c as usize] == Some(g) {
                    count[*c as usize] -= 1;
                }
            }
            let Ok(k) = pivot.row.binary_search_by_key(&column, |e| e.0) else { continue };
            let value = pivot.row[k].1;
            for a in &mut active {
                let Ok(j) = a.row.binary_search_by_key(&column, |e| e.0) else { continue };
                let factor = a.row[j].1 / value;
                let doubt = (a.row[j].2 + factor.abs() * pivot.row[k].2) / value.abs();
                for (c, ..) in &a.row {
                    if groups[*c as usize] == Some(g) {
                        count[*c as usize] -= 1;
                    }
                }
                a.row = subtract(&a.row, factor, doubt, &pivot.row, column);
                for (c, ..) in &a.row {
                    if groups[*c as usize] == Some(g) {
                        count[*c as usize] += 1;
                    }
                }
                for m in &pivot.made_of {
                    if a.made_of.len() < 12 && !a.made_of.contains(m) {
                        a.made_of.push(*m);
                    }
                }
            }
            done.push((pivot.origin, column, pivot.row));
        }
    }
    let solved = back_substitute(&done, columns, &column_scale);
    let mut left: Vec<_> = active
        .into_iter()
        .map(|a| {
            let row = a
                .row
                .iter()
                .map(|(c, v, _)| (*c, v / row_scale[a.origin] / column_scale[*c as usize]))
                .collect();
            (a.origin, row, a.made_of)
        })
        .collect();
    left.sort_by_key(|l| l.0);
    Eliminated { solved, left }
}

fn scales(rows: &[Row], columns: usize) -> (Vec<f64>, Vec<f64>) {
    let mut row_scale = vec![1.0; rows.len()];
    let mut column_scale = vec![1.0f64; columns];
    for _ in 0..3 {
        for (i, r) in rows.iter().enumerate() {
            let (mut low, mut high) = (f64::INFINITY, 0.0f64);
            for (c, v) in r {
                let a = (v * column_scale[*c as usize]).abs();
                if a > 0.0 {
                    low = low.min(a);
                    high = high.max(a);
                }
            }
            if high > 0.0 {
                row_scale[i] = power_of_two((low * high).sqrt());
            }
        }
        let mut low = vec![f64::INFINITY; columns];
        let mut high = vec![0.0f64; columns];
        for (i, r) in rows.iter().enumerate() {
            for (c, v) in r {
                let a = (v * row_scale[i]).abs();
                if a > 0.0 {
                    low[*c as usize] = low[*c as usize].min(a);
                    high[*c as usize] = high[*c as usize].max(a);
                }
            }
        }
        for c in 0..columns {
            if high[c] > 0.0 {
                column_scale[c] = power_of_two((low[c] * high[c]).sqrt());
            }
        }
    }
    (row_scale, column_scale)
}

/// Markowitz: the admissible pivot that can fill in least; ties to the larger, then the first.
fn choose(active: &[Active], groups: &[Option<u8>], g: u8, count: &[u32]) -> Option<(usize, u32)> {
    let mut best: Option<(u64, f64, usize, usize, u32)> = None;
    // A late row costs more than any other.
    const LATE: u64 = 1 << 40;
    for (at, a) in active.iter().enumerate() {
        let mut largest = 0.0f64;
        let mut entries = 0u64;
        for (c, v, _) in &a.row {
            if groups[*c as usize] == Some(g) {
                largest = largest.max(v.abs());
                entries += 1;
            }
        }
        if entries == 0 || best.as_ref().is_some_and(|b| b.0 == 0 && entries > 1) {
            continue;
        }
        for (c, v, _) in &a.row {
            if groups[*c as usize] != Some(g) || v.abs() < THRESHOLD * largest {
                continue;
            }
            let cost = (entries - 1) * u64::from(count[*c as usize] - 1) + if a.late { LATE } else { 0 };
            // Sizes are compared coarsely, so that rounding cannot change the order.
            let size = v.abs().log2().round();
            let better = match &best {
                None => true,
                Some(b) => (cost, -size, a.origin, *c) < (b.0, -b.1, b.3, b.4),
            };
            if better {
                best = Some((cost, size, at, a.origin, *c));
            }
        }
    }
    best.map(|b| (b.2, b.4))
}

/// a - factor * b, without the column just eliminated; `doubt` is the noise of the factor.
fn subtract(a: &Noisy, factor: f64, doubt: f64, b: &Noisy, without: u32) -> Noisy {
    let mut out = Noisy::with_capacity(a.len() + b.len());
    let (mut i, mut j) = (0, 0);
    while i < a.len() || j < b.len() {
        let ca = a.get(i).map_or(u32::MAX, |e| e.0);
        let cb = b.get(j).map_or(u32::MAX, |e| e.0);
        let column = ca.min(cb);
        let (mut value, mut noise) = (0.0, 0.0);
        if ca == column {
            value = a[i].1;
            noise = a[i].2;
            i += 1;
        }
        if cb == column {
            let term = factor * b[j].1;
            // Multiplying by a whole power of two is exact, and so is subtracting it from nothing.
            let rounding = if factor.abs() == 1.0 { 0.0 } else { term.abs() * f64::EPSILON };
            noise += factor.abs() * b[j].2 + doubt * b[j].1.abs() + rounding;
            let before = value;
            value -= term;
            if before != 0.0 && value != 0.0 {
                noise += value.abs() * f64::EPSILON;
            }
            j += 1;
        }
        if column != without && value != 0.0 && value.abs() > NOISE_FACTOR * noise {
            out.push((column, value, noise));
        }
    }
    out
}

fn back_substitute(done: &[(usize, u32, Noisy)], columns: usize, column_scale: &[f64]) -> Vec<(u32, Row)> {
    let mut at_pivot = vec![usize::MAX; columns];
    for (k, d) in done.iter().enumerate() {
        at_pivot[d.1 as usize] = k;
    }
    let mut solved: Vec<Row> = vec![Row::new(); done.len()];
    let mut dense = vec![0.0; columns];
    let mut size = vec![0.0f64; columns];
    for k in (0..done.len()).rev() {
        let (_, column, row) = &done[k];
        let pivot = row.iter().find(|e| e.0 == *column).map_or(1.0, |e| e.1);
        let mut touched: Vec<u32> = Vec::new();
        let mut add = |c: u32, v: f64, dense: &mut [f64], size: &mut [f64]| {
            if size[c as usize] == 0.0 {
                touched.push(c);
            }
            dense[c as usize] += v;
            size[c as usize] = size[c as usize].max(v.abs());
        };
        for (c, v, _) in row {
            if c == column || *v == 0.0 {
                continue;
            }
            let v = -v / pivot;
            // A pivot column in a row is always of a later pivot: earlier ones were eliminated.
            let p = at_pivot[*c as usize];
            if p == usize::MAX {
                add(*c, v, &mut dense, &mut size);
            } else {
                for (d, w) in &solved[p] {
                    add(*d, v * w, &mut dense, &mut size);
                }
            }
        }
        touched.sort_unstable();
        for c in touched {
            let (v, s) = (dense[c as usize], size[c as usize]);
            if v.abs() > 4.0 * f64::EPSILON * s {
                solved[k].push((c, v));
            }
            dense[c as usize] = 0.0;
            size[c as usize] = 0.0;
        }
    }
    done.iter()
        .zip(solved)
        .map(|(d, row)| {
            let s = column_scale[d.1 as usize];
            (d.1, row.into_iter().map(|(c, v)| (c, v * s / column_scale[c as usize])).collect())
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn solves_and_finds_what_is_left() {
        // 2a + b + 3k = 0, a - b + k = 0, and the sum of both again.
        let rows = vec![
            vec![(0, 2.0), (1, 1.0), (2, 3.0)],
            vec![(0, 1.0), (1, -1.0), (2, 1.0)],
            vec![(0, 3.0), (2, 4.0), (3, 1.0)],
        ];
        let e = eliminate(&rows, 4, &|c| (c < 2).then_some(0));
        assert_eq!(e.solved.len(), 2);
        for (c, row) in &e.solved {
            let want = if *c == 0 { -4.0 / 3.0 } else { -1.0 / 3.0 };
            let at: f64 = row.iter().filter(|r| r.0 == 2).map(|r| r.1).sum();
            let d: f64 = row.iter().filter(|r| r.0 == 3).map(|r| r.1).sum();
            // The third row may have been used as a pivot row; then column 3 appears.
            assert!((at - want).abs() < 1e-12 || d != 0.0);
        }
        assert_eq!(e.left.len(), 1);
        assert_eq!(e.left[0].1.len(), 1);
        assert_eq!(e.left[0].1[0].0, 3);
    }
}

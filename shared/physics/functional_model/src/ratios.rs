//! Ratios and gyrators of a part (patent 34, 0057): lossless couplings written once, their transposed half derived.

use crate::document::Raw;
use crate::error::Rule;
use crate::expand::Shape;
use crate::flat::{Equation, Flat, Gives};
use crate::instances::Tree;
use crate::pool::Id;

/// Lossless couplings inside a part: q_o = sum K_i q_i, and the dual of each q_i = -s_o/s_i K_i^T (dual of q_o),
/// so that the power of all its ports sums to zero whatever K is (ratios: across to across; gyrators: mixed).
pub(crate) fn ratios(tree: &mut Tree, flat: &mut Flat, index: usize, block: usize, raw: &Raw) {
    let path = flat.blocks[block].path.clone();
    for r in &raw.ratios {
        let at = format!("{path} ratio {}", r.gives.text);
        let ports = flat.blocks[block].ports.clone();
        let find = |name: &str| {
            ports.iter().find_map(|p| {
                if p.across.0 == name {
                    Some((p, &p.across.1, &p.through.1, p.unit.0, true))
                } else if p.through.0 == name {
                    Some((p, &p.through.1, &p.across.1, p.unit.1, false))
                } else {
                    None
                }
            })
        };
        let Some((out, out_ids, out_dual, out_unit, out_across)) = find(&r.gives.text) else {
            tree.fail(
                &r.gives.place,
                Rule::UnknownName,
                &at,
                format!("no port of this part has '{}'", r.gives.text),
            );
            continue;
        };
        let rows_n = out_ids.len();
        let mut main: Vec<Vec<(Id, f64)>> =
            out_ids.iter().map(|v| vec![(flat.pool.variable(*v as usize), 1.0)]).collect();
        let mut good = true;
        for (of, is) in &r.terms {
            let Some((input, in_ids, in_dual, in_unit, in_across)) = find(&of.text) else {
                tree.fail(
                    &of.place,
                    Rule::UnknownName,
                    &at,
                    format!("no port of this part has '{}'", of.text),
                );
                good = false;
                continue;
            };
            if !r.gyrator && (out_across != in_across) {
                tree.fail(
                    &of.place,
                    Rule::Format,
                    &at,
                    "a ratio joins across to across; for across to through write gyrator",
                );
                good = false;
            }
            let k = match tree.expand_in(&mut flat.pool, index, is) {
                Ok(k) => k,
                Err(trouble) => {
                    tree.trouble(is, &at, trouble);
                    good = false;
                    continue;
                }
            };
            if let Some(u) = k.unit
                && u != out_unit.over(in_unit)
            {
                tree.fail(
                    &is.place,
                    Rule::Unit,
                    &at,
                    format!(
                        "is = \"{}\" is {u}, {} per {} is {}",
                        is.text,
                        r.gives.text,
                        of.text,
                        out_unit.over(in_unit)
                    ),
                );
                good = false;
            }
            let cols_n = in_ids.len();
            let entries = match k.shape {
                Shape::Scalar if rows_n == cols_n => crate::expand::matrix(&k, rows_n, &mut flat.pool),
                Shape::Vector(n) if n == rows_n && cols_n == 1 => Some(k.parts.clone()),
                Shape::Vector(n) if n == rows_n && n == cols_n => {
                    crate::expand::matrix(&k, n, &mut flat.pool)
                }
                Shape::Matrix(a, b) if a == rows_n && b == cols_n => Some(k.parts.clone()),
                _ => None,
            };
            let Some(entries) = entries else {
                tree.fail(
                    &is.place,
                    Rule::Dimension,
                    &at,
                    format!(
                        "is is {}, {} has {rows_n} and {} has {cols_n} component(s)",
                        k.shape, r.gives.text, of.text
                    ),
                );
                good = false;
                continue;
            };
            for (i, row) in main.iter_mut().enumerate() {
                for (j, v) in in_ids.iter().enumerate() {
                    let v = flat.pool.variable(*v as usize);
                    row.push((flat.pool.mul(entries[i * cols_n + j], v), -1.0));
                }
            }
            for (j, v) in in_dual.iter().enumerate() {
                let mut terms = vec![(flat.pool.variable(*v as usize), input.sign())];
                for (i, o) in out_dual.iter().enumerate() {
                    let o = flat.pool.variable(*o as usize);
                    terms.push((flat.pool.mul(entries[i * cols_n + j], o), out.sign()));
                }
                let residual = flat.pool.sum(&terms, 0.0);
                let residual = flat.pool.scale(residual, input.sign());
                flat.equations.push(Equation {
                    residual,
                    block: Some(block),
                    label: format!("transposed ratio {} of {path}", r.gives.text),
                    gives: Gives::Variable(*v),
                    place: r.gives.place.clone(),
                });
            }
        }
        if !good {
            continue;
        }
        for (row, v) in main.iter().zip(out_ids) {
            let residual = flat.pool.sum(row, 0.0);
            flat.equations.push(Equation {
                residual,
                block: Some(block),
                label: format!("ratio {} of {path}", r.gives.text),
                gives: Gives::Variable(*v),
                place: r.gives.place.clone(),
            });
        }
    }
}

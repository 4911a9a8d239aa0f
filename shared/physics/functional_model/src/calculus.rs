//! Work on expressions: evaluation, substitution, partial and total derivatives, and what they depend on.

use std::collections::BTreeMap;

use crate::pool::{Fun, Id, Node, Pool};
use crate::tables::Table;

/// Values of all leaves.
pub(crate) struct Leaves<'a> {
    pub parameters: &'a [f64],
    pub variables: &'a [f64],
    pub rates: &'a [f64],
    pub time: f64,
    pub tables: &'a [Table],
}

/// Evaluates many expressions at once (composition time; allocates).
pub(crate) fn evaluate(pool: &Pool, roots: &[Id], leaves: &Leaves) -> Vec<f64> {
    let order = pool.below(roots);
    let mut value = vec![0.0; pool.len()];
    let mut args = Vec::new();
    for id in order {
        let v = match pool.node(id) {
            Node::Number(n) => *n,
            Node::Parameter(i) => leaves.parameters[*i as usize],
            Node::Variable(i) => leaves.variables[*i as usize],
            Node::Rate(i) => leaves.rates[*i as usize],
            Node::Time => leaves.time,
            Node::Sum(terms, c) => terms.iter().fold(*c, |s, (t, k)| s + k * value[*t as usize]),
            Node::Product(factors) => {
                factors.iter().fold(1.0, |p, (t, e)| multiply_power(p, value[*t as usize], *e))
            }
            Node::Call(f, a) => {
                args.clear();
                args.extend(a.iter().map(|i| value[*i as usize]));
                f.apply(&args)
            }
            Node::Table { table, along, args: a } => {
                args.clear();
                args.extend(a.iter().map(|i| value[*i as usize]));
                leaves.tables[*table as usize].look_up(&args, *along)
            }
        };
        value[id as usize] = v;
    }
    roots.iter().map(|r| value[*r as usize]).collect()
}

/// p * base^e, with the common exponents spelt out so that compiled and composed numbers agree to the bit.
#[inline]
pub(crate) fn multiply_power(p: f64, base: f64, e: f64) -> f64 {
    if e == 1.0 {
        p * base
    } else if e == -1.0 {
        p / base
    } else if e == 2.0 {
        p * (base * base)
    } else if e == 0.5 {
        p * base.sqrt()
    } else if e.fract() == 0.0 && e.abs() < 64.0 {
        p * base.powi(e as i32)
    } else {
        p * base.powf(e)
    }
}

/// Rewrites expressions, replacing leaves by `replace` where it gives something.
pub(crate) fn substitute(
    pool: &mut Pool,
    roots: &[Id],
    replace: &mut dyn FnMut(&mut Pool, &Node) -> Option<Id>,
) -> Vec<Id> {
    let order = pool.below(roots);
    let mut map: BTreeMap<Id, Id> = BTreeMap::new();
    for id in order {
        let node = pool.node(id).clone();
        let new = match &node {
            Node::Number(_) => id,
            Node::Parameter(_) | Node::Variable(_) | Node::Rate(_) | Node::Time => {
                replace(pool, &node).unwrap_or(id)
            }
            Node::Sum(terms, c) => {
                let terms: Vec<_> = terms.iter().map(|(t, k)| (map[t], *k)).collect();
                pool.sum(&terms, *c)
            }
            Node::Product(factors) => {
                let factors: Vec<_> = factors.iter().map(|(t, e)| (map[t], *e)).collect();
                pool.product(&factors)
            }
            Node::Call(f, a) => {
                let a: Vec<_> = a.iter().map(|i| map[i]).collect();
                pool.call(*f, &a)
            }
            Node::Table { table, along, args } => {
                let args: Vec<_> = args.iter().map(|i| map[i]).collect();
                pool.table(*table, *along, &args)
            }
        };
        map.insert(id, new);
    }
    roots.iter().map(|r| map[r]).collect()
}

/// Leaves an expression depends on.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Depends {
    pub variables: Vec<u32>,
    pub rates: Vec<u32>,
    pub time: bool,
    pub parameters: bool,
}

pub(crate) fn depends(pool: &Pool, id: Id) -> Depends {
    let mut d = Depends::default();
    for n in pool.below(&[id]) {
        match pool.node(n) {
            Node::Variable(i) => d.variables.push(*i),
            Node::Rate(i) => d.rates.push(*i),
            Node::Time => d.time = true,
            Node::Parameter(_) => d.parameters = true,
            _ => {}
        }
    }
    d.variables.sort_unstable();
    d.rates.sort_unstable();
    d
}

/// Partial derivatives of one root with respect to several leaves, by forward accumulation over its graph.
pub(crate) fn partials(pool: &mut Pool, root: Id, leaves: &[Id]) -> Vec<Id> {
    leaves
        .iter()
        .map(|leaf| derivative(pool, root, &mut |p, n| if n == *leaf { Some(p.number(1.0)) } else { None }))
        .collect()
}

/// Total time derivative: variables move with their rates, except those `held` says stand still.
pub(crate) fn time_derivative(pool: &mut Pool, root: Id, held: &dyn Fn(u32) -> bool) -> Id {
    derivative(pool, root, &mut |p, n| match *p.node(n) {
        Node::Variable(i) if !held(i) => Some(p.rate(i as usize)),
        Node::Time => Some(p.number(1.0)),
        _ => None,
    })
}

/// Derivative along a direction: `seed` gives the derivative of a leaf (none = zero).
pub(crate) fn derivative(pool: &mut Pool, root: Id, seed: &mut dyn FnMut(&mut Pool, Id) -> Option<Id>) -> Id {
    let order = pool.below(&[root]);
    let zero = pool.number(0.0);
    let mut d: BTreeMap<Id, Id> = BTreeMap::new();
    for id in order {
        let node = pool.node(id).clone();
        let new = match &node {
            Node::Number(_) => zero,
            Node::Parameter(_) | Node::Variable(_) | Node::Rate(_) | Node::Time => {
                seed(pool, id).unwrap_or(zero)
            }
            Node::Sum(terms, _) => {
                let terms: Vec<_> = terms.iter().map(|(t, k)| (d[t], *k)).collect();
                pool.sum(&terms, 0.0)
            }
            Node::Product(factors) => {
                let mut terms = Vec::new();
                for (at, (t, e)) in factors.iter().enumerate() {
                    let dt = d[t];
                    if pool.is_zero(dt) {
                        continue;
                    }
                    let mut term = factors.clone();
                    term[at].1 = e - 1.0;
                    term.push((dt, 1.0));
                    terms.push((pool.product(&term), *e));
                }
                pool.sum(&terms, 0.0)
            }
            Node::Call(f, a) => {
                let mut terms = Vec::new();
                for at in 0..a.len() {
                    let da = d[&a[at]];
                    if pool.is_zero(da) {
                        continue;
                    }
                    let partial = call_partial(pool, *f, a, at, id);
                    terms.push((pool.mul(partial, da), 1.0));
                }
                pool.sum(&terms, 0.0)
            }
            Node::Table { table, along, args } => {
                let mut terms = Vec::new();
                for (at, arg) in args.iter().enumerate() {
                    let da = d[arg];
                    // Tables are piecewise linear or cubic; second derivatives are not needed and taken as zero.
                    if pool.is_zero(da) || *along != 0 {
                        continue;
                    }
                    let slope = pool.table(*table, at as u8 + 1, args);
                    terms.push((pool.mul(slope, da), 1.0));
                }
                pool.sum(&terms, 0.0)
            }
        };
        d.insert(id, new);
    }
    d[&root]
}

/// Partial derivative of a function along its argument `at`; `whole` is the call itself.
fn call_partial(pool: &mut Pool, fun: Fun, a: &[Id], at: usize, whole: Id) -> Id {
    let x = a[0];
    let one = pool.number(1.0);
    match fun {
        Fun::Sin => pool.call(Fun::Cos, &[x]),
        Fun::Cos => {
            let s = pool.call(Fun::Sin, &[x]);
            pool.scale(s, -1.0)
        }
        Fun::Tan => {
            let square = pool.product(&[(whole, 2.0)]);
            pool.add(one, square)
        }
        Fun::Asin | Fun::Acos => {
            let square = pool.product(&[(x, 2.0)]);
            let rest = pool.sub(one, square);
            let inverse = pool.product(&[(rest, -0.5)]);
            pool.scale(inverse, if fun == Fun::Asin { 1.0 } else { -1.0 })
        }
        Fun::Atan => {
            let square = pool.product(&[(x, 2.0)]);
            let sum = pool.add(one, square);
            pool.product(&[(sum, -1.0)])
        }
        Fun::Atan2 => {
            let (yy, xx) = (pool.product(&[(a[0], 2.0)]), pool.product(&[(a[1], 2.0)]));
            let square = pool.add(yy, xx);
            let inverse = pool.call(Fun::SafeInverse, &[square]);
            let top = pool.mul(a[1 - at], inverse);
            pool.scale(top, if at == 0 { 1.0 } else { -1.0 })
        }
        Fun::Exp => whole,
        Fun::Ln => pool.product(&[(x, -1.0)]),
        Fun::Sinh => pool.call(Fun::Cosh, &[x]),
        Fun::Cosh => pool.call(Fun::Sinh, &[x]),
        Fun::Tanh => {
            let square = pool.product(&[(whole, 2.0)]);
            pool.sub(one, square)
        }
        Fun::Abs => pool.call(Fun::Sign, &[x]),
        Fun::Min | Fun::Max => {
            let (low, high) = if fun == Fun::Min { (a[0], a[1]) } else { (a[1], a[0]) };
            let first = pool.call(Fun::LessEqual, &[low, high]);
            if at == 0 { first } else { pool.sub(one, first) }
        }
        Fun::Norm => {
            let inverse = pool.call(Fun::SafeInverse, &[whole]);
            pool.mul(a[at], inverse)
        }
        Fun::SafeInverse => {
            let square = pool.product(&[(whole, 2.0)]);
            pool.scale(square, -1.0)
        }
        Fun::Power => {
            if at == 0 {
                let less = pool.sub(a[1], one);
                let power = pool.call(Fun::Power, &[a[0], less]);
                pool.mul(a[1], power)
            } else {
                let ln = pool.call(Fun::Ln, &[a[0]]);
                pool.mul(whole, ln)
            }
        }
        Fun::If => {
            let zero = pool.number(0.0);
            match at {
                1 => pool.call(Fun::If, &[a[0], one, zero]),
                2 => pool.call(Fun::If, &[a[0], zero, one]),
                _ => zero,
            }
        }
        Fun::Sign | Fun::Less | Fun::LessEqual | Fun::And | Fun::Or | Fun::Not => pool.number(0.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every function's derivative against a central difference.
    #[test]
    fn derivatives_agree_with_differences() {
        let mut pool = Pool::default();
        let (x, y) = (pool.variable(0), pool.variable(1));
        let tables = vec![Table::linear(vec![0.0, 1.0, 3.0], vec![0.0, 2.0, 3.0])];
        let mut roots = Vec::new();
        for f in [
            Fun::Sin,
            Fun::Cos,
            Fun::Tan,
            Fun::Asin,
            Fun::Acos,
            Fun::Atan,
            Fun::Exp,
            Fun::Ln,
            Fun::Sinh,
            Fun::Cosh,
            Fun::Tanh,
            Fun::Abs,
            Fun::SafeInverse,
        ] {
            roots.push(pool.call(f, &[x]));
        }
        for f in [Fun::Atan2, Fun::Min, Fun::Max, Fun::Norm, Fun::Power] {
            let xy = pool.mul(x, y);
            roots.push(pool.call(f, &[xy, y]));
        }
        let less = pool.call(Fun::Less, &[x, y]);
        let square = pool.product(&[(x, 3.0), (y, -0.5)]);
        roots.push(pool.call(Fun::If, &[less, square, y]));
        roots.push(pool.table(0, 0, &[x]));
        let at = |x: f64, y: f64, pool: &Pool, r: &[Id], tables: &[Table]| {
            let leaves = Leaves { parameters: &[], variables: &[x, y], rates: &[], time: 0.0, tables };
            evaluate(pool, r, &leaves)
        };
        let (x0, y0, h) = (0.4, 0.9, 1e-6);
        for root in roots {
            let d = partials(&mut pool, root, &[x, y]);
            let exact = at(x0, y0, &pool, &d, &tables);
            let dx = (at(x0 + h, y0, &pool, &[root], &tables)[0]
                - at(x0 - h, y0, &pool, &[root], &tables)[0])
                / (2.0 * h);
            let dy = (at(x0, y0 + h, &pool, &[root], &tables)[0]
                - at(x0, y0 - h, &pool, &[root], &tables)[0])
                / (2.0 * h);
            assert!((exact[0] - dx).abs() < 1e-8, "{:?}: {} against {dx}", pool.node(root), exact[0]);
            assert!((exact[1] - dy).abs() < 1e-8, "{:?}: {} against {dy}", pool.node(root), exact[1]);
        }
    }
}

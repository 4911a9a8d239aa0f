//! Named matrices of a composed system at an operating point:
//!     E dx/dt = A x + B u + a_1        y = C x + D u + c_1
//! Exact for what is linear between samples; the tangent elsewhere (with the constant column making it exact at the
//! point itself). E keeps the storages' own numbers (a mass, a reduced mass M1 + N^2 M2).

use crate::calculus::{Leaves, derivative, evaluate};
use crate::eliminate::{Row, eliminate, eliminate_keeping};
use crate::error::{ModelError, Rule};
use crate::flat::{Flat, Gives, Kind};
use crate::kernel::{Newton, leaf_column};
use crate::model::System;
use crate::pool::{Id, Node};
use crate::reduce::{ONE, TIME, of_column, rate_column_of, split_linear};

/// Where to linearise. Empty vectors stand for the start values (states, sampled) and zero (inputs).
#[derive(Debug, Clone, Default, PartialEq)]
pub struct OperatingPoint {
    /// States, in the order of [`System::state_names`].
    pub states: Vec<f64>,
    /// Inputs, in the order of [`System::input_names`].
    pub inputs: Vec<f64>,
    /// Sampled variables of mechanisms, in the order of [`System::sampled_names`].
    pub sampled: Vec<f64>,
    /// Time, s.
    pub time_s: f64,
}

/// Row-major matrix.
pub type Table = Vec<Vec<f64>>;

/// The matrices and their names. SI units.
#[derive(Debug, Clone, PartialEq)]
pub struct Matrices {
    /// Names of the states: columns of E, A and C, rows of E, A and B.
    pub states: Vec<String>,
    /// Names of the inputs: columns of B and D.
    pub inputs: Vec<String>,
    /// Names of the outputs: rows of C and D.
    pub outputs: Vec<String>,
    /// Storage matrix.
    pub e: Table,
    /// System matrix.
    pub a: Table,
    /// Input matrix.
    pub b: Table,
    /// The column "1" of the state rows.
    pub state_constant: Vec<f64>,
    /// Output matrix.
    pub c: Table,
    /// Feed-through.
    pub d: Table,
    /// The column "1" of the output rows.
    pub output_constant: Vec<f64>,
}

impl System {
    /// Names of the sampled variables.
    pub fn sampled_names(&self) -> Vec<String> {
        let flat = self.flat.borrow();
        self.kernel.sampled.iter().map(|v| flat.variables[*v as usize].name.clone()).collect()
    }

    /// Matrices at the start values, inputs zero.
    ///
    /// # Errors
    /// When the system has no solution there.
    pub fn matrices(&self) -> Result<Matrices, Vec<ModelError>> {
        self.matrices_at(&OperatingPoint::default())
    }

    /// Matrices at an operating point.
    ///
    /// # Errors
    /// When the system has no solution there, or E is singular there.
    pub fn matrices_at(&self, point: &OperatingPoint) -> Result<Matrices, Vec<ModelError>> {
        let k = &self.kernel;
        let mut known = self.start_known();
        let (n, nu, nm) = (k.states.len(), k.inputs.len(), k.sampled.len());
        for (from, at, len) in [(&point.states, 0, n), (&point.inputs, n, nu), (&point.sampled, n + nu, nm)] {
            if from.len() == len {
                known[at..at + len].copy_from_slice(from);
            }
        }
        known[n + nu + nm] = point.time_s;
        let mut core = self.start_core();
        let mut newton = Newton::new(k);
        let file = crate::error::Place { file: self.file.as_str().into(), line: 0 };
        let solve = newton.solve(k, &k.args, &k.equations, &known, &mut core, k.affine_in_core);
        if !solve.converged {
            return Err(vec![file.error(
                Rule::SingularLoop,
                "",
                "the equations have no unique solution at this operating point",
            )]);
        }
        let outputs = self.outputs();
        let mut flat = self.flat.borrow_mut();
        let flat = &mut *flat;
        // All variables and rates at the point.
        let columns: Vec<u32> = (0..2 + 2 * flat.variables.len() as u32).collect();
        let all = k.rows(&columns);
        let value: Vec<f64> = (0..columns.len()).map(|c| all.value(c, &known, &core)).collect();
        let tangent = |flat: &mut Flat, residual: Id| -> Row {
            let (mut row, rest) = split_linear(&mut flat.pool, residual);
            let Some(rest) = rest else { return row };
            let (values, rates): (Vec<f64>, Vec<f64>) = (
                (0..flat.variables.len()).map(|v| value[2 + 2 * v]).collect(),
                (0..flat.variables.len()).map(|v| value[3 + 2 * v]).collect(),
            );
            let mut leaves: Vec<u32> =
                flat.pool.below(&[rest]).iter().filter_map(|id| leaf_column(flat.pool.node(*id))).collect();
            leaves.sort_unstable();
            let mut roots = vec![rest];
            for c in &leaves {
                roots.push(derivative(&mut flat.pool, rest, &mut |pool, id| {
                    (leaf_column(pool.node(id)) == Some(*c)).then(|| pool.number(1.0))
                }));
            }
            let at = Leaves {
                parameters: &[],
                variables: &values,
                rates: &rates,
                time: known[n + nu + nm],
                tables: &flat.tables,
            };
            let numbers = evaluate(&flat.pool, &roots, &at);
            let mut constant = numbers[0];
            for (c, d) in leaves.iter().zip(&numbers[1..]) {
                let sampled = of_column(*c)
                    .is_some_and(|(v, r)| !r && flat.variables[v as usize].kind == Kind::Sampled);
                if sampled || *c == TIME {
                    continue;
                }
                constant -= d * value[*c as usize];
                add(&mut row, *c, *d);
            }
            add(&mut row, ONE, constant);
            row
        };
        let rows: Vec<Row> = self.dae.equations.iter().map(|e| tangent(flat, e.residual)).collect();
        // Sampled variables and time count into the constant column here.
        let fold = |flat: &Flat, row: Row| -> Row {
            let mut out = Row::new();
            for (c, v) in row {
                let sampled =
                    of_column(c).is_some_and(|(w, r)| !r && flat.variables[w as usize].kind == Kind::Sampled);
                if sampled || c == TIME {
                    let x = if c == TIME { known[n + nu + nm] } else { value[c as usize] };
                    add(&mut out, ONE, v * x);
                } else {
                    add(&mut out, c, v);
                }
            }
            out
        };
        let mut rows: Vec<Row> = rows.into_iter().map(|r| fold(flat, r)).collect();
        // One more row and unknown per output: y - expression = 0.
        let base = columns.len() as u32;
        let values = flat.parameter_values();
        let dependent = self.dae.dependent.clone();
        for (i, (_, id, _)) in outputs.iter().enumerate() {
            let id = crate::calculus::substitute(&mut flat.pool, &[*id], &mut |pool, node| match node {
                Node::Parameter(p) => Some(pool.number(values[*p as usize])),
                Node::Rate(v) => dependent.iter().find(|d| d.0 == *v).map(|d| pool.variable(d.1 as usize)),
                _ => None,
            })[0];
            let row = tangent(flat, id);
            let mut row = fold(flat, row);
            for e in &mut row {
                e.1 = -e.1;
            }
            row.push((base + i as u32, 1.0));
            rows.push(row);
        }
        let kinds: Vec<Kind> = flat.variables.iter().map(|v| v.kind).collect();
        let width = columns.len() + outputs.len();
        // First everything but rates, for the descriptor form; then the rates too, for the outputs.
        // The storages' own rows come out as they went in, so that E holds masses and not multiples of them.
        let storage: Vec<bool> = (0..rows.len())
            .map(|r| {
                self.dae.equations.get(r).is_some_and(|e| {
                    let rate = match flat.equations[e.origin].gives {
                        Gives::Rate(v) => flat.variables[v as usize].kind == Kind::State,
                        _ => false,
                    };
                    e.order == 0 && rate
                })
            })
            .collect();
        let first = eliminate_keeping(
            &rows,
            width,
            &|c| {
                if c >= base {
                    return Some(0);
                }
                match of_column(c) {
                    Some((v, false)) if kinds[v as usize] == Kind::Algebraic => Some(0),
                    _ => None,
                }
            },
            &|r| storage[r],
        );
        let full = eliminate(&rows, width, &|c| {
            if c >= base {
                return Some(0);
            }
            match of_column(c) {
                Some((v, false)) if kinds[v as usize] == Kind::Algebraic => Some(0),
                Some((v, true)) if kinds[v as usize] == Kind::State => Some(1),
                _ => None,
            }
        });
        if first.left.len() != n || full.left.iter().any(|l| !l.1.is_empty()) {
            return Err(vec![file.error(
                Rule::SingularLoop,
                "",
                "the equations are singular at this operating point",
            )]);
        }
        let states = k.states.clone();
        let entry = |row: &Row, c: u32| row.iter().find(|e| e.0 == c).map_or(0.0, |e| e.1);
        let mut m = Matrices {
            states: states.iter().map(|v| flat.variables[*v as usize].name.clone()).collect(),
            inputs: k.inputs.iter().map(|v| flat.variables[*v as usize].name.clone()).collect(),
            outputs: outputs.iter().map(|o| o.0.clone()).collect(),
            e: vec![],
            a: vec![],
            b: vec![],
            state_constant: vec![],
            c: vec![],
            d: vec![],
            output_constant: vec![],
        };
        let mut left: Vec<&Row> = first.left.iter().map(|l| &l.1).collect();
        for v in &states {
            let c = rate_column_of(*v);
            let Some(best) = (0..left.len()).max_by(|a, b| share(left[*a], c).total_cmp(&share(left[*b], c)))
            else {
                break;
            };
            let row = left.remove(best);
            let sign = if entry(row, c) < 0.0 { -1.0 } else { 1.0 };
            m.e.push(states.iter().map(|w| sign * entry(row, rate_column_of(*w))).collect());
            m.a.push(
                states.iter().map(|w| clean(-sign * entry(row, crate::reduce::column_of(*w)))).collect(),
            );
            m.b.push(
                k.inputs.iter().map(|w| clean(-sign * entry(row, crate::reduce::column_of(*w)))).collect(),
            );
            m.state_constant.push(clean(-sign * entry(row, ONE)));
        }
        m.without_kinematic_rates();
        for i in 0..outputs.len() {
            let none = Row::new();
            let row = full.solved.iter().find(|s| s.0 == base + i as u32).map_or(&none, |s| &s.1);
            m.c.push(states.iter().map(|w| entry(row, crate::reduce::column_of(*w))).collect());
            m.d.push(k.inputs.iter().map(|w| entry(row, crate::reduce::column_of(*w))).collect());
            m.output_constant.push(entry(row, ONE));
        }
        Ok(m)
    }
}

impl Matrices {
    /// Rows that hold one rate only (an angle's theta' = w) are put into the others, where a transport term may have
    /// left theta', so that E holds storages only.
    fn without_kinematic_rates(&mut self) {
        let n = self.states.len();
        for i in 0..n {
            if self.e[i][i] == 0.0 || (0..n).any(|j| j != i && self.e[i][j] != 0.0) {
                continue;
            }
            for j in (0..n).filter(|j| *j != i) {
                let f = self.e[j][i] / self.e[i][i];
                if f != 0.0 {
                    self.e[j][i] = 0.0;
                    for k in 0..n {
                        self.a[j][k] -= f * self.a[i][k];
                    }
                    for k in 0..self.inputs.len() {
                        self.b[j][k] -= f * self.b[i][k];
                    }
                    self.state_constant[j] -= f * self.state_constant[i];
                }
            }
        }
    }
}

fn clean(v: f64) -> f64 {
    if v == 0.0 { 0.0 } else { v }
}

/// How much of a row's storage belongs to a rate.
fn share(row: &Row, column: u32) -> f64 {
    let total: f64 = row.iter().filter(|e| of_column(e.0).is_some_and(|c| c.1)).map(|e| e.1.abs()).sum();
    let own = row.iter().find(|e| e.0 == column).map_or(0.0, |e| e.1.abs());
    if total > 0.0 { own / total } else { 0.0 }
}

fn add(row: &mut Row, column: u32, value: f64) {
    match row.binary_search_by_key(&column, |e| e.0) {
        Ok(k) => row[k].1 += value,
        Err(k) => row.insert(k, (column, value)),
    }
}

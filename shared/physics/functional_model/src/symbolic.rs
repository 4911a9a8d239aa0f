//! The system's matrices as text in the names of the parameters. Elimination is repeated symbolically, its pivots
//! chosen by the numbers (at the parameters and at a nearby set, so that a coincidence is not taken for a rule).
//! Shared pieces become definitions `k1 = ...`; every line reads back with the expression language
//! ([`evaluate_symbolic`]). What is not linear appears as named terms `n1 = ...` beside the matrices.

use std::collections::BTreeMap;

use crate::calculus::{Leaves, depends, derivative, evaluate, substitute};
use crate::error::{ModelError, Place, Rule};
use crate::expand::{Scope, Trouble, Value, expand};
use crate::flat::{Flat, Gives, Kind};
use crate::kernel::leaf_column;
use crate::model::System;
use crate::pool::{Fun, Id, Node, Pool};
use crate::reduce::{ONE, TIME, column_of, of_column, rate_column_of};
use crate::syntax;
use crate::tables::Table;
use crate::units::Unit;

/// Symbolic matrices.
#[derive(Debug, Clone, PartialEq)]
pub struct Symbolic {
    /// `k1 = ...` in order of use; non-linear terms `n1 = ...` among them.
    pub definitions: Vec<(String, String)>,
    /// (`A[road.x.x, road.x.y]`, expression), non-zero entries only. Matrices: E, A, B, C, D; the constant column is
    /// the column `1` of A and C; non-linear terms are columns `n1` of A and C.
    pub entries: Vec<(String, String)>,
}

impl std::fmt::Display for Symbolic {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for (name, text) in self.definitions.iter().chain(&self.entries) {
            writeln!(f, "{name} = {text}")?;
        }
        Ok(())
    }
}

/// A coefficient with its values at two parameter sets.
#[derive(Debug, Clone, Copy)]
struct Entry {
    column: u32,
    id: Id,
    value: [f64; 2],
}

type SymbolicRow = Vec<Entry>;
/// Pivot columns with their rows, in order.
type Pivots = Vec<(u32, SymbolicRow)>;
/// Late row, fill-in, not plain +-1, row, column: smaller is better.
type Cost = (bool, usize, bool, usize, u32);

struct Work<'a> {
    flat: &'a mut Flat,
    parameters: [Vec<f64>; 2],
    variables: [Vec<f64>; 2],
    rates: Vec<f64>,
}

impl Work<'_> {
    fn values(&self, id: Id) -> [f64; 2] {
        [0, 1].map(|k| {
            let at = Leaves {
                parameters: &self.parameters[k],
                variables: &self.variables[k],
                rates: &self.rates,
                time: 0.0,
                tables: &self.flat.tables,
            };
            evaluate(&self.flat.pool, &[id], &at)[0]
        })
    }

    /// a - f b without a column; entries that vanish at both sets are zero.
    fn subtract(&mut self, a: &SymbolicRow, f: Entry, b: &SymbolicRow, without: u32) -> SymbolicRow {
        let mut out = SymbolicRow::new();
        let (mut i, mut j) = (0, 0);
        while i < a.len() || j < b.len() {
            let (ca, cb) = (a.get(i).map_or(u32::MAX, |e| e.column), b.get(j).map_or(u32::MAX, |e| e.column));
            let column = ca.min(cb);
            let left = (ca == column).then(|| {
                i += 1;
                a[i - 1]
            });
            let right = (cb == column).then(|| {
                j += 1;
                b[j - 1]
            });
            if column == without {
                continue;
            }
            let entry = match (left, right) {
                (Some(l), None) => l,
                (l, Some(r)) => {
                    let product = self.flat.pool.mul(f.id, r.id);
                    let (id, base) = match l {
                        Some(l) => (self.flat.pool.sub(l.id, product), l.value),
                        None => (self.flat.pool.scale(product, -1.0), [0.0; 2]),
                    };
                    let term = [0, 1].map(|k| f.value[k] * r.value[k]);
                    let value = [0, 1].map(|k| base[k] - term[k]);
                    let gone = |k: usize| value[k].abs() <= 1e-11 * base[k].abs().max(term[k].abs());
                    if self.flat.pool.is_zero(id) || (gone(0) && gone(1)) {
                        continue;
                    }
                    Entry { column, id, value }
                }
                (None, None) => continue,
            };
            out.push(entry);
        }
        out
    }

    /// Eliminates columns; gives pivot rows in order and what is left.
    fn eliminate(
        &mut self,
        rows: Vec<(usize, SymbolicRow)>,
        pivotable: &dyn Fn(u32) -> bool,
        late: &dyn Fn(usize) -> bool,
    ) -> (Pivots, Vec<(usize, SymbolicRow)>) {
        let mut active = rows;
        let mut done = Vec::new();
        loop {
            let mut counts: BTreeMap<u32, usize> = BTreeMap::new();
            for (_, r) in &active {
                for e in r.iter().filter(|e| pivotable(e.column)) {
                    *counts.entry(e.column).or_insert(0) += 1;
                }
            }
            let mut best: Option<(Cost, usize)> = None;
            for (at, (origin, r)) in active.iter().enumerate() {
                let candidates: Vec<&Entry> = r.iter().filter(|e| pivotable(e.column)).collect();
                let largest = candidates.iter().fold(0.0f64, |m, e| m.max(e.value[0].abs()));
                for e in &candidates {
                    // Units differ within a row, so the bar is low; a pivot must only not be accidental.
                    if e.value[0].abs() < 1e-9 * largest || e.value[1] == 0.0 {
                        continue;
                    }
                    let plain = matches!(self.flat.pool.as_number(e.id), Some(n) if n.abs() == 1.0);
                    let cost = (candidates.len() - 1) * (counts[&e.column] - 1);
                    let key =
                        (late(*origin), if plain { cost } else { 4 * cost + 1 }, !plain, *origin, e.column);
                    if best.as_ref().is_none_or(|b| key < b.0) {
                        best = Some((key, at));
                    }
                }
            }
            let Some((key, at)) = best else { break };
            let column = key.4;
            let (_, pivot_row) = active.swap_remove(at);
            let Some(pivot) = pivot_row.iter().find(|e| e.column == column).copied() else { break };
            for k in 0..active.len() {
                let Some(e) = active[k].1.iter().find(|e| e.column == column).copied() else { continue };
                let f = Entry {
                    column,
                    id: self.flat.pool.div(e.id, pivot.id),
                    value: [0, 1].map(|s| e.value[s] / pivot.value[s]),
                };
                let row = std::mem::take(&mut active[k].1);
                active[k].1 = self.subtract(&row, f, &pivot_row, column);
            }
            done.push((column, pivot_row));
        }
        active.sort_by_key(|a| a.0);
        (done, active)
    }

    /// Value of a pivot column in terms of columns that are no pivots.
    fn solved(&mut self, done: &[(u32, SymbolicRow)], wanted: u32) -> Option<SymbolicRow> {
        let at = done.iter().position(|d| d.0 == wanted)?;
        let (column, row) = &done[at];
        let pivot = row.iter().find(|e| e.column == *column).copied()?;
        let minus =
            Entry { column: 0, id: self.flat.pool.scale(pivot.id, -1.0), value: pivot.value.map(|v| -v) };
        let mut out: SymbolicRow = row
            .iter()
            .filter(|e| e.column != *column)
            .map(|e| Entry {
                column: e.column,
                id: self.flat.pool.div(e.id, minus.id),
                value: [0, 1].map(|k| e.value[k] / minus.value[k]),
            })
            .collect();
        // Later pivots may still appear: put them in, in order.
        for (later, later_row) in &done[at + 1..] {
            let Some(e) = out.iter().find(|e| e.column == *later).copied() else { continue };
            let Some(p) = later_row.iter().find(|x| x.column == *later).copied() else { continue };
            let f = Entry {
                column: *later,
                id: self.flat.pool.div(e.id, p.id),
                value: [0, 1].map(|k| e.value[k] / p.value[k]),
            };
            out = self.subtract(&out, f, later_row, *later);
        }
        Some(out)
    }
}

impl System {
    /// Symbolic matrices.
    ///
    /// # Errors
    /// When a rigid join goes through a non-linear coefficient: such a system has its numbers, but no text.
    pub fn symbolic(&self) -> Result<Symbolic, ModelError> {
        let outputs = self.outputs();
        let mut guard = self.flat.borrow_mut();
        let n_variables = guard.variables.len();
        let parameters = guard.parameter_values();
        let shifted: Vec<f64> =
            parameters.iter().enumerate().map(|(i, v)| v * (1.07 + 0.013 * (i % 7) as f64) + 1e-9).collect();
        let at = |k: usize| -> Vec<f64> {
            (0..n_variables).map(|i| 0.37 + 0.11 * ((i * 29 + k * 13) % 17) as f64).collect()
        };
        let mut w = Work {
            parameters: [parameters, shifted],
            variables: [at(0), at(1)],
            rates: vec![0.41; n_variables],
            flat: &mut guard,
        };
        let mut terms: Vec<(String, Id)> = Vec::new();
        let base = 2 + 2 * n_variables as u32;
        let n_outputs = outputs.len() as u32;
        let dependent = self.dae.dependent.clone();
        let mut rows: Vec<(usize, SymbolicRow)> = Vec::new();
        let count = w.flat.equations.len();
        for i in 0..count {
            let residual = w.flat.equations[i].residual;
            let row = linear_row(&mut w, residual, &dependent, &mut terms, base + n_outputs);
            rows.push((i, row));
        }
        for (k, (_, id, _)) in outputs.iter().enumerate() {
            let mut row = linear_row(&mut w, *id, &dependent, &mut terms, base + n_outputs);
            for e in &mut row {
                e.id = w.flat.pool.scale(e.id, -1.0);
                e.value = e.value.map(|v| -v);
            }
            let one = w.flat.pool.number(1.0);
            row.push(Entry { column: base + k as u32, id: one, value: [1.0; 2] });
            row.sort_by_key(|e| e.column);
            rows.push((count + k, row));
        }
        let kinds: Vec<Kind> = w.flat.variables.iter().map(|v| v.kind).collect();
        let storage: Vec<bool> = (0..count)
            .map(|i| matches!(w.flat.equations[i].gives, Gives::Rate(v) if kinds[v as usize] == Kind::State))
            .collect();
        let output = |c: u32| c >= base && c < base + n_outputs;
        let algebraic = |c: u32| {
            output(c)
                || matches!(of_column(c), Some((v, false)) if c < base && kinds[v as usize] == Kind::Algebraic)
        };
        let is_dependent = |v: u32| dependent.iter().any(|d| d.0 == v);
        let rate_column = |v: u32| match dependent.iter().find(|d| d.0 == v) {
            Some(d) => column_of(d.1),
            None => rate_column_of(v),
        };
        // Constraints show when dependent states still count as states; their derivatives join the rows.
        let mut next = rows.len();
        for _ in 0..4 {
            let free = |c: u32| {
                let state = matches!(of_column(c), Some((v, false)) if c < base && is_dependent(v));
                let rate =
                    matches!(of_column(c), Some((v, true)) if c < base && kinds[v as usize] == Kind::State);
                (algebraic(c) && !state) || rate
            };
            let (_, left) = w.eliminate(rows.clone(), &free, &|r| storage.get(r).copied().unwrap_or(false));
            let left: Vec<_> = left.into_iter().filter(|l| !l.1.is_empty()).collect();
            let known: usize = rows.iter().filter(|r| r.0 >= count + outputs.len()).count();
            if left.len() <= known {
                break;
            }
            let mut grew = false;
            for (_, row) in left.into_iter().skip(known) {
                let mut derived = SymbolicRow::new();
                for e in &row {
                    match of_column(e.column) {
                        Some((v, false)) if e.column < base => {
                            derived.push(Entry { column: rate_column(v), ..*e })
                        }
                        None if e.column == ONE => {}
                        _ => return Err(refused(self)),
                    }
                }
                derived.sort_by_key(|e| e.column);
                if !derived.is_empty() {
                    rows.push((next, derived));
                    next += 1;
                    grew = true;
                }
            }
            if !grew {
                break;
            }
        }
        let (done, left) =
            w.eliminate(rows.clone(), &algebraic, &|r| storage.get(r).copied().unwrap_or(false));
        let left: Vec<SymbolicRow> = left.into_iter().map(|l| l.1).filter(|r| !r.is_empty()).collect();
        if left.len() != self.kernel.states.len() {
            return Err(refused(self));
        }
        let rates =
            |c: u32| matches!(of_column(c), Some((v, true)) if c < base && kinds[v as usize] == Kind::State);
        let (rate_done, _) = w.eliminate(left.iter().cloned().enumerate().collect(), &rates, &|_| false);
        let mut all = done;
        all.extend(rate_done);
        let mut found: Vec<(String, Id)> = Vec::new();
        let term_name =
            |c: u32| terms.get((c - base - n_outputs) as usize).map_or("?".to_string(), |t| t.0.clone());
        let name = |flat: &Flat, c: u32| match of_column(c) {
            _ if c >= base => term_name(c),
            Some((v, _)) => flat.variables[v as usize].name.clone(),
            None if c == TIME => "t".into(),
            None => "1".into(),
        };
        let mut left = left;
        for v in &self.kernel.states {
            let c = rate_column_of(*v);
            let Some(best) = left
                .iter()
                .position(|r| r.iter().filter(|e| rates(e.column)).all(|e| e.column == c))
                .or_else(|| left.iter().position(|r| r.iter().any(|e| e.column == c)))
            else {
                continue;
            };
            let row = left.remove(best);
            let state = w.flat.variables[*v as usize].name.clone();
            let negative = row.iter().any(|e| e.column == c && e.value[0] < 0.0);
            for e in &row {
                let sign = if negative { -1.0 } else { 1.0 };
                let other = name(w.flat, e.column);
                if rates(e.column) {
                    found.push((format!("E[{state}, {other}]"), w.flat.pool.scale(e.id, sign)));
                } else {
                    let matrix = matrix_of(w.flat, e.column, base);
                    found.push((
                        format!("{}[{state}, {other}]", if matrix { "B" } else { "A" }),
                        w.flat.pool.scale(e.id, -sign),
                    ));
                }
            }
        }
        for (k, (output, ..)) in outputs.iter().enumerate() {
            for e in w.solved(&all, base + k as u32).unwrap_or_default() {
                let matrix = matrix_of(w.flat, e.column, base);
                found.push((
                    format!("{}[{output}, {}]", if matrix { "D" } else { "C" }, name(w.flat, e.column)),
                    e.id,
                ));
            }
        }
        Ok(print(w.flat, &terms, &found))
    }
}

fn matrix_of(flat: &Flat, column: u32, base: u32) -> bool {
    matches!(of_column(column), Some((v, false)) if column < base && flat.variables[v as usize].kind == Kind::Input)
}

fn refused(system: &System) -> ModelError {
    Place { file: system.file.as_str().into(), line: 0 }.error(
        Rule::Irreducible,
        "",
        "storages are joined rigidly through coefficients that vary: there are numbers (matrices), but no symbolic text",
    )
}

/// Linear coefficients of a residual that depend on parameters and sampled variables only; the rest is a named term.
fn linear_row(
    w: &mut Work,
    residual: Id,
    dependent: &[(u32, u32)],
    terms: &mut Vec<(String, Id)>,
    first_term: u32,
) -> SymbolicRow {
    let residual = substitute(&mut w.flat.pool, &[residual], &mut |pool, node| match node {
        Node::Rate(v) => dependent.iter().find(|d| d.0 == *v).map(|d| pool.variable(d.1 as usize)),
        _ => None,
    })[0];
    let sampled = |flat: &Flat, v: u32| flat.variables[v as usize].kind == Kind::Sampled;
    let mut leaves: Vec<u32> = w
        .flat
        .pool
        .below(&[residual])
        .iter()
        .filter_map(|id| leaf_column(w.flat.pool.node(*id)))
        .filter(|c| !of_column(*c).is_some_and(|(v, r)| !r && sampled(w.flat, v)))
        .collect();
    leaves.sort_unstable();
    let mut row = SymbolicRow::new();
    let mut linear: Vec<u32> = Vec::new();
    for c in &leaves {
        let d = derivative(&mut w.flat.pool, residual, &mut |pool, id| {
            (leaf_column(pool.node(id)) == Some(*c)).then(|| pool.number(1.0))
        });
        let on = depends(&w.flat.pool, d);
        let constant = on.rates.is_empty() && !on.time && on.variables.iter().all(|v| sampled(w.flat, *v));
        if constant && *c != TIME {
            linear.push(*c);
            if !w.flat.pool.is_zero(d) {
                let value = w.values(d);
                row.push(Entry { column: *c, id: d, value });
            }
        }
    }
    let rest = substitute(&mut w.flat.pool, &[residual], &mut |pool, node| {
        leaf_column(node).filter(|c| linear.contains(c)).map(|_| pool.number(0.0))
    })[0];
    if !w.flat.pool.is_zero(rest) {
        let on = depends(&w.flat.pool, rest);
        let plain = on.rates.is_empty() && !on.time && on.variables.iter().all(|v| sampled(w.flat, *v));
        if plain {
            let value = w.values(rest);
            row.push(Entry { column: ONE, id: rest, value });
        } else {
            let k = terms.iter().position(|t| t.1 == rest).unwrap_or_else(|| {
                terms.push((format!("n{}", terms.len() + 1), rest));
                terms.len() - 1
            });
            let one = w.flat.pool.number(1.0);
            row.push(Entry { column: first_term + k as u32, id: one, value: [1.0; 2] });
        }
    }
    row.sort_by_key(|e| e.column);
    row
}

/// Text with shared pieces named.
fn print(flat: &Flat, terms: &[(String, Id)], found: &[(String, Id)]) -> Symbolic {
    let roots: Vec<Id> = terms.iter().map(|t| t.1).chain(found.iter().map(|f| f.1)).collect();
    let order = flat.pool.below(&roots);
    let mut uses: BTreeMap<Id, usize> = BTreeMap::new();
    for id in &order {
        for c in flat.pool.children(*id) {
            *uses.entry(c).or_insert(0) += 1;
        }
    }
    for r in &roots {
        *uses.entry(*r).or_insert(0) += 1;
    }
    let mut text: BTreeMap<Id, (String, u8)> = BTreeMap::new();
    let mut definitions = Vec::new();
    for id in order {
        let (t, rank) = one(flat, id, &text);
        let heavy = t.len() > 24 && uses.get(&id).copied().unwrap_or(0) > 1;
        if heavy || t.len() > 400 {
            let name = format!("k{}", definitions.len() + 1);
            definitions.push((name.clone(), t));
            text.insert(id, (name, 9));
        } else {
            text.insert(id, (t, rank));
        }
    }
    definitions.extend(terms.iter().map(|(n, id)| (n.clone(), text[id].0.clone())));
    let entries = found.iter().map(|(n, id)| (n.clone(), text[id].0.clone())).collect();
    Symbolic { definitions, entries }
}

/// Text and rank (1 sum, 2 product, 3 power, 9 atom) of one node.
fn one(flat: &Flat, id: Id, text: &BTreeMap<Id, (String, u8)>) -> (String, u8) {
    let within = |id: &Id, rank: u8| {
        let (t, r) = &text[id];
        if *r < rank { format!("({t})") } else { t.clone() }
    };
    let number =
        |n: f64| if n.fract() == 0.0 && n.abs() < 1e15 { format!("{n:.0}") } else { format!("{n:?}") };
    match flat.pool.node(id) {
        Node::Number(n) => (number(*n), if *n < 0.0 { 1 } else { 9 }),
        Node::Parameter(p) => (flat.parameters[*p as usize].name.clone(), 9),
        Node::Variable(v) => (flat.variables[*v as usize].name.clone(), 9),
        Node::Rate(v) => (format!("{}'", flat.variables[*v as usize].name), 9),
        Node::Time => ("t".into(), 9),
        Node::Sum(terms, c) => {
            let mut s = String::new();
            for (t, k) in terms {
                let piece = within(t, 2);
                match (*k, s.is_empty()) {
                    (1.0, true) => s.push_str(&piece),
                    (1.0, false) => s.push_str(&format!(" + {piece}")),
                    (-1.0, true) => s.push_str(&format!("-{piece}")),
                    (-1.0, false) => s.push_str(&format!(" - {piece}")),
                    (k, true) => s.push_str(&format!("{}*{piece}", number(k))),
                    (k, false) if k < 0.0 => s.push_str(&format!(" - {}*{piece}", number(-k))),
                    (k, false) => s.push_str(&format!(" + {}*{piece}", number(k))),
                }
            }
            if *c != 0.0 {
                let sign = if *c < 0.0 { '-' } else { '+' };
                s.push_str(&format!(" {sign} {}", number(c.abs())));
            }
            let single = terms.len() == 1 && *c == 0.0 && terms[0].1 > 0.0;
            (s, if single { 2 } else { 1 })
        }
        Node::Product(factors) => {
            let (mut over, mut under) = (Vec::new(), Vec::new());
            for (t, e) in factors {
                let side = if *e > 0.0 { &mut over } else { &mut under };
                let e = e.abs();
                side.push(if e == 1.0 { within(t, 3) } else { format!("{}^{}", within(t, 4), number(e)) });
            }
            let mut s = if over.is_empty() { "1".to_string() } else { over.join("*") };
            for u in under {
                s.push_str(&format!("/{u}"));
            }
            (s, 2)
        }
        Node::Call(fun, args) => {
            let a: Vec<String> = args.iter().map(|a| text[a].0.clone()).collect();
            let s = match fun {
                Fun::Norm => format!("norm([{}])", a.join(", ")),
                Fun::Less => return (format!("({} < {})", a[0], a[1]), 9),
                Fun::LessEqual => return (format!("({} <= {})", a[0], a[1]), 9),
                Fun::And => return (format!("({} and {})", within(&args[0], 2), within(&args[1], 2)), 9),
                Fun::Or => return (format!("({} or {})", within(&args[0], 2), within(&args[1], 2)), 9),
                Fun::Power => return (format!("{}^{}", within(&args[0], 4), within(&args[1], 4)), 3),
                _ => format!("{}({})", fun.name(), a.join(", ")),
            };
            (s, 9)
        }
        Node::Table { table, args, .. } => {
            let a: Vec<String> = args.iter().map(|a| text[a].0.clone()).collect();
            (format!("{}({})", flat.tables[*table as usize].name, a.join(", ")), 9)
        }
    }
}

/// Names with numbers, all plain: the text is in SI.
struct Numbers<'a>(&'a BTreeMap<String, f64>);

impl Scope for Numbers<'_> {
    fn name(&self, pool: &mut Pool, name: &str) -> Option<Result<Value, Trouble>> {
        self.0.get(name).map(|v| Ok(Value::scalar(pool.number(*v), Unit::ONE)))
    }
    fn rate(&self, _: &mut Pool, _: &str) -> Option<Value> {
        None
    }
    fn table(&self, _: &str) -> Option<(u32, &Table)> {
        None
    }
    fn names(&self) -> Vec<String> {
        self.0.keys().cloned().collect()
    }
}

/// Reads `name = expression` lines back with numbers for parameters, sampled variables and states by name (SI), in
/// order; each line may use those before it. Lines that need a name nobody gave are left out.
///
/// # Errors
/// A line that is not of this form, or cannot be read.
pub fn evaluate_symbolic(
    text: &str,
    values: &BTreeMap<String, f64>,
) -> Result<BTreeMap<String, f64>, String> {
    let mut known = values.clone();
    let mut out = BTreeMap::new();
    for line in text.lines().filter(|l| !l.trim().is_empty()) {
        let (name, right) =
            line.split_once(" = ").ok_or_else(|| format!("'{line}' is not 'name = expression'"))?;
        let ast = syntax::parse(right)?;
        let mut pool = Pool::default();
        match expand(&ast, &mut pool, &Numbers(&known)) {
            Ok(v) => {
                let n = pool.as_number(v.parts[0]).ok_or_else(|| format!("'{line}' is not a number"))?;
                known.insert(name.to_string(), n);
                out.insert(name.to_string(), n);
            }
            Err(Trouble::Unknown(_)) => {}
            Err(Trouble::Unit(m) | Trouble::Shape(m) | Trouble::Form(m)) => {
                return Err(format!("'{line}': {m}"));
            }
        }
    }
    Ok(out)
}

//! From equations to a solvable system. Equations that are linear with constant coefficients are eliminated
//! numerically; the rest, the core, keeps as many unknowns as it has non-linear equations. What elimination leaves
//! over are constraints between states (rigidly joined storages, index 2 and more): they are differentiated and one
//! state each becomes dependent (dummy derivatives, Mattsson and Soederlind 1993, SIAM J. Sci. Comput. 14, 677);
//! non-linear ones are found by matching (Pantelides 1988, SIAM J. Sci. Stat. Comput. 9, 213). The derivative of a
//! constraint v2 = Phi v1 brings Phi dv1/dt + dPhi/dt v1, so the reduced storage is (M1 + Phi^T M2 Phi) with the
//! term Phi^T M2 dPhi/dt v (spec 5.3).

use std::collections::BTreeMap;

use crate::calculus::{depends, substitute, time_derivative};
use crate::eliminate::{Eliminated, Row, eliminate};
use crate::error::{ModelError, Place, Rule};
use crate::flat::{Flat, Kind};
use crate::pool::{Id, Node, Pool};

/// Column of the constant.
pub(crate) const ONE: u32 = 0;
/// Column of time.
pub(crate) const TIME: u32 = 1;

pub(crate) fn column_of(variable: u32) -> u32 {
    2 + 2 * variable
}

pub(crate) fn rate_column_of(variable: u32) -> u32 {
    3 + 2 * variable
}

/// Variable and whether the column is its rate.
pub(crate) fn of_column(column: u32) -> Option<(u32, bool)> {
    (column >= 2).then(|| ((column - 2) / 2, column % 2 == 1))
}

/// Most rounds of differentiation; a mechanical position constraint needs two.
const ROUNDS_MAX: usize = 8;

/// An equation of the reduced system.
#[derive(Debug, Clone)]
pub(crate) struct Reduced {
    pub residual: Id,
    /// Index into `Flat::equations`, and how often it was differentiated (for a combination, its first member).
    pub origin: usize,
    pub order: usize,
}

/// The solvable system.
pub(crate) struct Dae {
    /// Parameters are numbers here.
    pub equations: Vec<Reduced>,
    pub eliminated: Eliminated,
    /// Unknown columns of the core.
    pub core: Vec<u32>,
    /// Equations of the core (indices into `equations`), as many.
    pub nonlinear: Vec<usize>,
    /// States that remain, in order.
    pub states: Vec<u32>,
    /// (dependent state, variable that stands for its rate).
    pub dependent: Vec<(u32, u32)>,
}

/// Linear part of a residual by column, and the rest (None = nothing but linear).
pub(crate) fn split_linear(pool: &mut Pool, residual: Id) -> (Row, Option<Id>) {
    let leaf = |node: &Node| match node {
        Node::Variable(v) => Some(column_of(*v)),
        Node::Rate(v) => Some(rate_column_of(*v)),
        Node::Time => Some(TIME),
        _ => None,
    };
    let mut row = Row::new();
    let node = pool.node(residual).clone();
    if let Some(column) = leaf(&node) {
        return (vec![(column, 1.0)], None);
    }
    match node {
        Node::Number(n) => (if n == 0.0 { row } else { vec![(ONE, n)] }, None),
        Node::Sum(terms, constant) => {
            let mut rest = Vec::new();
            if constant != 0.0 {
                row.push((ONE, constant));
            }
            for (t, k) in terms {
                match leaf(pool.node(t)) {
                    Some(column) => row.push((column, k)),
                    None => rest.push((t, k)),
                }
            }
            row.sort_by_key(|e| e.0);
            let rest = (!rest.is_empty()).then(|| pool.sum(&rest, 0.0));
            (row, rest)
        }
        _ => (row, Some(residual)),
    }
}

/// Substitutes parameter values and reduces the index.
pub(crate) fn reduce(flat: &mut Flat) -> Result<Dae, Vec<ModelError>> {
    let values = flat.parameter_values();
    let residuals: Vec<Id> = flat.equations.iter().map(|e| e.residual).collect();
    let numeric = substitute(&mut flat.pool, &residuals, &mut |pool, node| match node {
        Node::Parameter(p) => Some(pool.number(values[*p as usize])),
        _ => None,
    });
    let mut equations: Vec<Reduced> = numeric
        .into_iter()
        .enumerate()
        .map(|(i, residual)| Reduced { residual, origin: i, order: 0 })
        .collect();
    let mut dependent: Vec<(u32, u32)> = Vec::new();
    promote_rates(flat, &mut equations, &mut dependent)?;
    for _ in 0..ROUNDS_MAX {
        let columns = 2 + 2 * flat.variables.len();
        let mut rows = Vec::new();
        let mut linear = Vec::new();
        let mut nonlinear = Vec::new();
        for (i, e) in equations.iter().enumerate() {
            let (row, rest) = split_linear(&mut flat.pool, e.residual);
            if rest.is_none() {
                rows.push(row);
                linear.push(i);
            } else {
                nonlinear.push(i);
            }
        }
        let variables = &flat.variables;
        let eliminated = eliminate(&rows, columns, &|c| match of_column(c) {
            Some((v, false)) => (variables[v as usize].kind == Kind::Algebraic).then_some(0),
            Some((v, true)) => (variables[v as usize].kind == Kind::State).then_some(1),
            None => None,
        });
        if !eliminated.left.is_empty() {
            constraints(flat, &mut equations, &mut dependent, &eliminated, &linear)?;
            continue;
        }
        let mut pivot = vec![false; columns];
        for (c, _) in &eliminated.solved {
            pivot[*c as usize] = true;
        }
        let core: Vec<u32> = (2..columns as u32)
            .filter(|c| !pivot[*c as usize])
            .filter(|c| match of_column(*c) {
                Some((v, false)) => flat.variables[v as usize].kind == Kind::Algebraic,
                Some((v, true)) => flat.variables[v as usize].kind == Kind::State,
                None => false,
            })
            .collect();
        let matching = Matching::of(flat, &equations, &nonlinear, &core, &eliminated);
        if let Some((set, unknown)) = matching.overdetermined() {
            differentiate(
                flat,
                &mut equations,
                &mut dependent,
                &eliminated,
                &nonlinear,
                &core,
                &set,
                &unknown,
            )?;
            continue;
        }
        if core.len() != nonlinear.len() {
            let names: Vec<String> =
                core.iter().filter(|c| !matching.used(**c)).map(|c| name_of(flat, *c)).collect();
            let place = Place { file: flat.equations[0].place.file.clone(), line: 0 };
            return Err(vec![place.error(
                Rule::SingularLoop,
                names.join(", "),
                format!("nothing determines {}", names.join(", ")),
            )]);
        }
        let states = (0..flat.variables.len() as u32)
            .filter(|v| flat.variables[*v as usize].kind == Kind::State)
            .collect();
        return Ok(Dae { equations, eliminated, core, nonlinear, states, dependent });
    }
    let place = Place { file: flat.equations[0].place.file.clone(), line: 0 };
    Err(vec![place.error(
        Rule::Irreducible,
        "",
        "the joined storages cannot be reduced in a bounded number of steps",
    )])
}

/// `x'` of something that is no state (an angle given by a mechanism that runs always, used by a turning frame):
/// it becomes a state that its own equation then makes dependent.
fn promote_rates(
    flat: &mut Flat,
    equations: &mut [Reduced],
    _dependent: &mut [(u32, u32)],
) -> Result<(), Vec<ModelError>> {
    let mut errors = Vec::new();
    for e in equations.iter() {
        for v in depends(&flat.pool, e.residual).rates {
            let variable = &mut flat.variables[v as usize];
            match variable.kind {
                Kind::State => {}
                Kind::Algebraic => {
                    variable.kind = Kind::State;
                    variable.promoted = true;
                }
                Kind::Input | Kind::Sampled => {
                    let origin = &flat.equations[e.origin];
                    let name = variable.name.clone();
                    errors.push(origin.place.error(
                        Rule::Irreducible,
                        &origin.label,
                        format!("needs the rate of '{name}', which is given from outside; give the rate as an input and integrate it"),
                    ));
                }
            }
        }
    }
    if errors.is_empty() { Ok(()) } else { Err(errors) }
}

pub(crate) fn name_of(flat: &Flat, column: u32) -> String {
    match of_column(column) {
        Some((v, rate)) => format!("{}{}", flat.variables[v as usize].name, if rate { "'" } else { "" }),
        None if column == TIME => "t".into(),
        None => "1".into(),
    }
}

/// Names of equations and their parts for a message.
fn blame(flat: &Flat, equations: &[Reduced], members: &[usize]) -> (Place, String) {
    let mut labels: Vec<String> = Vec::new();
    let mut place = flat.equations[equations[members[0]].origin].place.clone();
    for m in members {
        let e = &flat.equations[equations[*m].origin];
        if e.block.is_none() {
            place = e.place.clone();
        }
        if !labels.contains(&e.label) {
            labels.push(e.label.clone());
        }
    }
    labels.truncate(8);
    (place, labels.join("; "))
}

/// Constant constraints left by the elimination: check, differentiate, choose dependent states.
fn constraints(
    flat: &mut Flat,
    equations: &mut Vec<Reduced>,
    dependent: &mut Vec<(u32, u32)>,
    eliminated: &Eliminated,
    linear: &[usize],
) -> Result<(), Vec<ModelError>> {
    let mut errors = Vec::new();
    let mut rows: Vec<(usize, Row)> = Vec::new();
    for (origin, row, made_of) in &eliminated.left {
        let members: Vec<usize> = made_of.iter().map(|m| linear[*m]).collect();
        let (place, labels) = blame(flat, equations, &members);
        if row.iter().all(|e| e.0 == ONE || e.1 == 0.0) {
            let contradictory = row.iter().any(|e| e.1.abs() > 0.0);
            let what = if contradictory {
                "contradict each other"
            } else {
                "say the same thing twice, so something else stays undetermined"
            };
            errors.push(place.error(Rule::SingularLoop, labels, format!("these equations {what}")));
            continue;
        }
        let stored = row
            .iter()
            .any(|e| of_column(e.0).is_some_and(|(v, _)| flat.variables[v as usize].kind == Kind::State));
        if !stored {
            errors.push(place.error(
                Rule::SingularLoop,
                labels,
                "this loop of equations has no unique solution: its unknowns cancel and only what is given from outside remains",
            ));
            continue;
        }
        for (c, _) in row {
            if let Some((v, _)) = of_column(*c) {
                let variable = &flat.variables[v as usize];
                if matches!(variable.kind, Kind::Input | Kind::Sampled) {
                    let name = variable.name.clone();
                    errors.push(place.error(
                        Rule::Irreducible,
                        labels.clone(),
                        format!("'{name}' is given from outside and forces a storage rigidly, so its rate would be needed; put a compliance or a loss between, or let the outside give the other quantity"),
                    ));
                }
            }
        }
        rows.push((linear[*origin], row.clone()));
    }
    if !errors.is_empty() {
        return Err(errors);
    }
    let mut taken: Vec<Row> = Vec::new();
    for (origin, row) in rows {
        // Reduce by the states already made dependent in this round, so that each constraint costs one state.
        let mut row = row;
        for t in &taken {
            let pivot = t[0];
            if let Some(k) = row.iter().position(|e| e.0 == pivot.0) {
                let factor = row[k].1 / pivot.1;
                let mut sum: BTreeMap<u32, f64> = row.iter().copied().collect();
                for (c, v) in t {
                    *sum.entry(*c).or_insert(0.0) -= factor * v;
                }
                let mut next: Row =
                    sum.into_iter().filter(|e| e.0 != pivot.0 && e.1.abs() > 1e-13 * factor.abs()).collect();
                next.sort_by_key(|e| e.0);
                row = next;
            }
        }
        let candidates: Vec<(u32, f64)> =
            row.iter().filter_map(|(c, k)| of_column(*c).map(|(v, _)| (v, *k))).collect();
        let Some(chosen) = choose_dependent(flat, &candidates) else {
            let (place, labels) = blame(flat, equations, &[origin]);
            return Err(vec![place.error(
                Rule::SingularLoop,
                labels,
                "these equations say the same thing twice",
            )]);
        };
        contradiction(flat, equations, origin, &row)?;
        let terms: Vec<(Id, f64)> = row
            .iter()
            .filter_map(|(c, k)| of_column(*c).map(|(v, _)| (v, *k)))
            .map(|(v, k)| (flat.pool.rate(v as usize), k))
            .collect();
        let time = row.iter().find(|e| e.0 == TIME).map_or(0.0, |e| e.1);
        let derivative = flat.pool.sum(&terms, time);
        let order = equations[origin].order + 1;
        let base = equations[origin].origin;
        equations.push(Reduced { residual: derivative, origin: base, order });
        row.sort_by_key(|e| e.0 != column_of(chosen));
        taken.push(row);
        make_dependent(flat, equations, dependent, chosen);
    }
    Ok(())
}

/// Both storages of a rigid join were given start values that cannot both hold.
fn contradiction(
    flat: &Flat,
    equations: &[Reduced],
    origin: usize,
    row: &Row,
) -> Result<(), Vec<ModelError>> {
    let mut sum = 0.0;
    let mut size = 0.0f64;
    let mut places = Vec::new();
    for (c, k) in row {
        match of_column(*c) {
            Some((v, _)) => {
                let variable = &flat.variables[v as usize];
                let Some(start) = variable.start else { return Ok(()) };
                places.push((variable.name.clone(), variable.start_place.clone()));
                sum += k * start;
                size = size.max((k * start).abs());
            }
            None if *c == ONE => {
                sum += k;
                size = size.max(k.abs());
            }
            None => return Ok(()),
        }
    }
    if sum.abs() > 1e-9 * size && places.len() > 1 {
        let names: Vec<String> = places.iter().map(|p| p.0.clone()).collect();
        let (_, labels) = blame(flat, equations, &[origin]);
        return Err(vec![places[0].1.error(
            Rule::Start,
            names.join(", "),
            format!("the start values contradict the rigid join ({labels}); give one of them only"),
        )]);
    }
    Ok(())
}

/// The state to make dependent: large coefficient, without a start value of its own, late in the file.
fn choose_dependent(flat: &Flat, candidates: &[(u32, f64)]) -> Option<u32> {
    candidates
        .iter()
        .filter(|(v, k)| flat.variables[*v as usize].kind == Kind::State && k.abs() > 0.0 && k.is_finite())
        .max_by(|a, b| {
            let weight = |(v, k): &(u32, f64)| {
                let variable = &flat.variables[*v as usize];
                let favour = if variable.promoted {
                    1e6
                } else if variable.start.is_some() {
                    1e-3
                } else {
                    1.0
                };
                k.abs() * favour * (1.0 + 1e-6 * f64::from(*v))
            };
            weight(a).total_cmp(&weight(b))
        })
        .map(|c| c.0)
}

fn make_dependent(flat: &mut Flat, equations: &mut [Reduced], dependent: &mut Vec<(u32, u32)>, state: u32) {
    let old = flat.variables[state as usize].clone();
    let rate = flat.variable(
        format!("{}'", old.name),
        Kind::Algebraic,
        old.unit.over(crate::units::Unit::SECOND),
        old.block,
    );
    flat.variables[state as usize].kind = Kind::Algebraic;
    dependent.push((state, rate));
    replace_rates(flat, equations, dependent);
}

/// Rates of dependent states are variables of their own.
fn replace_rates(flat: &mut Flat, equations: &mut [Reduced], dependent: &[(u32, u32)]) {
    let residuals: Vec<Id> = equations.iter().map(|e| e.residual).collect();
    let new = substitute(&mut flat.pool, &residuals, &mut |pool, node| match node {
        Node::Rate(v) => dependent.iter().find(|d| d.0 == *v).map(|d| pool.variable(d.1 as usize)),
        _ => None,
    });
    for (e, residual) in equations.iter_mut().zip(new) {
        e.residual = residual;
    }
}

/// An equation with every eliminated variable written out.
pub(crate) fn written_out(pool: &mut Pool, residual: Id, solved: &BTreeMap<u32, Row>) -> Id {
    let leaf = |pool: &mut Pool, column: u32| match of_column(column) {
        Some((v, false)) => pool.variable(v as usize),
        Some((v, true)) => pool.rate(v as usize),
        None if column == TIME => pool.time(),
        None => pool.number(1.0),
    };
    substitute(pool, &[residual], &mut |pool, node| {
        let column = match node {
            Node::Variable(v) => column_of(*v),
            Node::Rate(v) => rate_column_of(*v),
            _ => return None,
        };
        let row = solved.get(&column)?.clone();
        let terms: Vec<(Id, f64)> = row.iter().map(|(c, k)| (leaf(pool, *c), *k)).collect();
        Some(pool.sum(&terms, 0.0))
    })[0]
}

/// Structural matching of core equations and unknowns.
struct Matching {
    /// Unknowns of each equation.
    edges: Vec<Vec<usize>>,
    core: Vec<u32>,
    /// Equation of each unknown.
    owner: Vec<Option<usize>>,
    unmatched: Vec<usize>,
}

impl Matching {
    fn of(
        flat: &mut Flat,
        equations: &[Reduced],
        nonlinear: &[usize],
        core: &[u32],
        eliminated: &Eliminated,
    ) -> Matching {
        let solved: BTreeMap<u32, Row> = eliminated.solved.iter().cloned().collect();
        let mut edges = Vec::new();
        for i in nonlinear {
            let out = written_out(&mut flat.pool, equations[*i].residual, &solved);
            let d = depends(&flat.pool, out);
            let e: Vec<usize> = core
                .iter()
                .enumerate()
                .filter(|(_, c)| match of_column(**c) {
                    Some((v, false)) => d.variables.binary_search(&v).is_ok(),
                    Some((v, true)) => d.rates.binary_search(&v).is_ok(),
                    None => false,
                })
                .map(|(k, _)| k)
                .collect();
            edges.push(e);
        }
        let mut owner = vec![None; core.len()];
        let mut unmatched = Vec::new();
        for e in 0..edges.len() {
            let mut seen = vec![false; core.len()];
            if !augment(e, &edges, &mut owner, &mut seen) {
                unmatched.push(e);
            }
        }
        Matching { edges, core: core.to_vec(), owner, unmatched }
    }

    fn used(&self, column: u32) -> bool {
        self.core.iter().position(|c| *c == column).is_some_and(|k| self.owner[k].is_some())
    }

    /// A set of equations with fewer unknowns than equations.
    fn overdetermined(&self) -> Option<(Vec<usize>, Vec<u32>)> {
        let first = *self.unmatched.first()?;
        let mut set = vec![first];
        let mut unknown = Vec::new();
        let mut at = 0;
        while at < set.len() {
            for u in &self.edges[set[at]] {
                if !unknown.contains(u) {
                    unknown.push(*u);
                    if let Some(e) = self.owner[*u]
                        && !set.contains(&e)
                    {
                        set.push(e);
                    }
                }
            }
            at += 1;
        }
        Some((set, unknown.iter().map(|u| self.core[*u]).collect()))
    }
}

/// Augmenting path.
pub(crate) fn augment(
    e: usize,
    edges: &[Vec<usize>],
    owner: &mut [Option<usize>],
    seen: &mut [bool],
) -> bool {
    for &u in &edges[e] {
        if std::mem::replace(&mut seen[u], true) {
            continue;
        }
        let free = match owner[u] {
            None => true,
            Some(other) => augment(other, edges, owner, seen),
        };
        if free {
            owner[u] = Some(e);
            return true;
        }
    }
    false
}

/// Differentiates an overdetermined set of non-linear equations and makes one state dependent.
#[allow(clippy::too_many_arguments)]
fn differentiate(
    flat: &mut Flat,
    equations: &mut Vec<Reduced>,
    dependent: &mut Vec<(u32, u32)>,
    eliminated: &Eliminated,
    nonlinear: &[usize],
    core: &[u32],
    set: &[usize],
    unknown: &[u32],
) -> Result<(), Vec<ModelError>> {
    let _ = core;
    let members: Vec<usize> = set.iter().map(|s| nonlinear[*s]).collect();
    let (place, labels) = blame(flat, equations, &members);
    let solved: BTreeMap<u32, Row> = eliminated.solved.iter().cloned().collect();
    let out: Vec<Id> =
        members.iter().map(|m| written_out(&mut flat.pool, equations[*m].residual, &solved)).collect();
    let mut states: Vec<u32> = Vec::new();
    for id in &out {
        let d = depends(&flat.pool, *id);
        if !d.rates.is_empty() {
            let names: Vec<String> =
                d.rates.iter().map(|v| flat.variables[*v as usize].name.clone()).collect();
            return Err(vec![place.error(
                Rule::Irreducible,
                labels,
                format!("cannot reduce: the equations already fix the rates of {}", names.join(", ")),
            )]);
        }
        for v in d.variables {
            let variable = &flat.variables[v as usize];
            match variable.kind {
                Kind::State if !states.contains(&v) => states.push(v),
                Kind::Input => {
                    let name = variable.name.clone();
                    return Err(vec![place.error(
                        Rule::Irreducible,
                        labels,
                        format!("'{name}' is given from outside and forces a storage rigidly, so its rate would be needed; put a compliance or a loss between"),
                    )]);
                }
                Kind::Sampled => {
                    let name = variable.name.clone();
                    return Err(vec![place.error(
                        Rule::Irreducible,
                        labels,
                        format!("storages are rigidly joined through '{name}', which jumps at samples; let its mechanism run always, or use an angle that is a state"),
                    )]);
                }
                _ => {}
            }
        }
    }
    if states.is_empty() {
        let names: Vec<String> = unknown.iter().map(|c| name_of(flat, *c)).collect();
        let what = if names.is_empty() { "no unknown".to_string() } else { names.join(", ") };
        return Err(vec![place.error(
            Rule::SingularLoop,
            labels,
            format!("too many equations for {what}: the loop has no unique solution"),
        )]);
    }
    let weights = null_weights(flat, &out, unknown, &states);
    let candidates: Vec<(u32, f64)> = states.iter().copied().zip(weights).collect();
    let Some(chosen) = choose_dependent(flat, &candidates) else {
        return Err(vec![place.error(Rule::Irreducible, labels, "no state can be made dependent here")]);
    };
    // Rates of core unknowns become variables.
    let mut fresh: Vec<(u32, u32)> = Vec::new();
    for c in unknown {
        if let Some((v, false)) = of_column(*c) {
            let old = flat.variables[v as usize].clone();
            let rate = flat.variable(
                format!("{}'", old.name),
                Kind::Algebraic,
                old.unit.over(crate::units::Unit::SECOND),
                old.block,
            );
            fresh.push((v, rate));
        }
    }
    for (m, id) in members.iter().zip(&out) {
        let derivative = time_derivative(&mut flat.pool, *id, &|_| false);
        let derivative = substitute(&mut flat.pool, &[derivative], &mut |pool, node| match node {
            Node::Rate(v) => fresh.iter().find(|f| f.0 == *v).map(|f| pool.variable(f.1 as usize)),
            _ => None,
        })[0];
        let (origin, order) = (equations[*m].origin, equations[*m].order + 1);
        equations.push(Reduced { residual: derivative, origin, order });
    }
    make_dependent(flat, equations, dependent, chosen);
    Ok(())
}

/// Sensitivity of the constraint hidden in a set of equations to each state, near the start values.
fn null_weights(flat: &mut Flat, out: &[Id], unknown: &[u32], states: &[u32]) -> Vec<f64> {
    let values: Vec<f64> = flat
        .variables
        .iter()
        .enumerate()
        .map(|(i, v)| v.start.unwrap_or(0.0) + 0.3 + 0.017 * ((i * 37 % 101) as f64))
        .collect();
    let mut leaves: Vec<Id> = Vec::new();
    for c in unknown {
        if let Some((v, _)) = of_column(*c) {
            leaves.push(flat.pool.variable(v as usize));
        }
    }
    let split = leaves.len();
    for v in states {
        leaves.push(flat.pool.variable(*v as usize));
    }
    let mut rows: Vec<Vec<f64>> = Vec::new();
    for id in out {
        let p = crate::calculus::partials(&mut flat.pool, *id, &leaves);
        let at = crate::calculus::Leaves {
            parameters: &[],
            variables: &values,
            rates: &[],
            time: 0.1,
            tables: &flat.tables,
        };
        rows.push(crate::calculus::evaluate(&flat.pool, &p, &at));
    }
    // Eliminate the unknowns; what is left of some row is the constraint.
    let mut used = vec![false; rows.len()];
    for k in 0..split {
        let Some(p) = (0..rows.len())
            .filter(|r| !used[*r])
            .max_by(|a, b| rows[*a][k].abs().total_cmp(&rows[*b][k].abs()))
        else {
            break;
        };
        if rows[p][k] == 0.0 {
            continue;
        }
        used[p] = true;
        let pivot = rows[p].clone();
        for (r, row) in rows.iter_mut().enumerate() {
            if r != p && !used[r] {
                let f = row[k] / pivot[k];
                for (x, y) in row.iter_mut().zip(&pivot) {
                    *x -= f * y;
                }
            }
        }
    }
    let free = used.iter().position(|u| !u).unwrap_or(0);
    rows[free][split..].to_vec()
}

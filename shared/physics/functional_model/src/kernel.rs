//! The numeric heart of a composed model. All variables are affine in what is known and in the core unknowns c:
//!     known = [x, u, m, t, 1]   (states, inputs, sampled variables, time, one)
//! and c solves  R_known known + R_core c + n(args) = 0  with the non-linear parts n of the core equations as
//! functions of a few affine arguments. Newton's method on c, damped by the natural
//! monotonicity test (Deuflhard 2004, Newton Methods for Nonlinear Problems, 3.3); one solve when n is affine in c.

use std::collections::BTreeMap;

use crate::calculus::{depends, derivative, substitute};
use crate::dense::Lu;
use crate::flat::{Flat, Kind};
use crate::pool::{Id, Node, Pool};
use crate::program::Program;
use crate::reduce::{Dae, ONE, TIME, column_of, of_column, rate_column_of, split_linear};
use crate::tables::Table;

/// How often Newton may iterate.
const ITERATIONS_MAX: usize = 25;
/// How often one step of Newton may be halved.
const HALVINGS_MAX: usize = 10;

/// A partial derivative of a core equation along an argument.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Partial {
    Constant(f64),
    Output(usize),
}

/// Rows over known and core.
#[derive(Debug, Clone, Default)]
pub(crate) struct Rows {
    pub count: usize,
    pub known_width: usize,
    pub core_width: usize,
    pub known: Vec<f64>,
    pub core: Vec<f64>,
    /// The non-zero entries, as the step uses them; see [`Rows::pack`].
    sparse_known: Sparse,
    sparse_core: Sparse,
}

/// Non-zero entries row by row.
#[derive(Debug, Clone, Default)]
struct Sparse {
    ends: Vec<u32>,
    entries: Vec<(u32, f64)>,
}

impl Sparse {
    fn with_room(rows: usize, width: usize) -> Sparse {
        Sparse { ends: Vec::with_capacity(rows), entries: Vec::with_capacity(rows * width) }
    }

    /// Takes the entries of a dense matrix over, within the room there is.
    fn fill(&mut self, dense: &[f64], rows: usize, width: usize) {
        self.ends.clear();
        self.entries.clear();
        for i in 0..rows {
            for (k, v) in dense[i * width..(i + 1) * width].iter().enumerate() {
                if *v != 0.0 {
                    self.entries.push((k as u32, *v));
                }
            }
            self.ends.push(self.entries.len() as u32);
        }
    }

    #[inline]
    fn dot(&self, i: usize, with: &[f64]) -> f64 {
        let start = if i == 0 { 0 } else { self.ends[i - 1] as usize };
        let mut s = 0.0;
        for (k, v) in &self.entries[start..self.ends[i] as usize] {
            s += v * with[*k as usize];
        }
        s
    }
}

impl Rows {
    pub fn new(count: usize, known_width: usize, core_width: usize) -> Rows {
        Rows {
            count,
            known_width,
            core_width,
            known: vec![0.0; count * known_width],
            core: vec![0.0; count * core_width],
            sparse_known: Sparse::with_room(count, known_width),
            sparse_core: Sparse::with_room(count, core_width),
        }
    }

    /// To be called when the entries have changed, before any value is asked for. Allocates nothing.
    pub fn pack(&mut self) {
        self.sparse_known.fill(&self.known, self.count, self.known_width);
        self.sparse_core.fill(&self.core, self.count, self.core_width);
    }

    /// The part of row i over what is known.
    #[inline]
    pub fn known_part(&self, i: usize, known: &[f64]) -> f64 {
        self.sparse_known.dot(i, known)
    }

    /// The part of row i over the core.
    #[inline]
    pub fn core_part(&self, i: usize, core: &[f64]) -> f64 {
        self.sparse_core.dot(i, core)
    }

    pub fn known_row(&self, i: usize) -> &[f64] {
        &self.known[i * self.known_width..(i + 1) * self.known_width]
    }

    pub fn core_row(&self, i: usize) -> &[f64] {
        &self.core[i * self.core_width..(i + 1) * self.core_width]
    }

    /// Value of row i.
    #[inline]
    pub fn value(&self, i: usize, known: &[f64], core: &[f64]) -> f64 {
        self.known_part(i, known) + self.core_part(i, core)
    }

    pub fn needs_core(&self) -> bool {
        self.core.iter().any(|v| *v != 0.0)
    }
}

#[inline]
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut s = 0.0;
    for (x, y) in a.iter().zip(b) {
        s += x * y;
    }
    s
}

/// Equations of the core that can be solved one after another once the arguments are there.
#[derive(Debug, Clone)]
pub(crate) struct Level {
    /// Arguments to be set before this level's phase of the program.
    pub args: Vec<usize>,
    /// (equation, unknown), in order.
    pub solve: Vec<(usize, usize)>,
}

/// Everything that does not change while stepping.
#[derive(Debug, Clone)]
pub(crate) struct Kernel {
    pub states: Vec<u32>,
    pub inputs: Vec<u32>,
    pub sampled: Vec<u32>,
    pub core: Vec<u32>,
    /// Rates of the states.
    pub rates: Rows,
    pub args: Rows,
    pub equations: Rows,
    pub program: Program,
    /// (equation, argument, partial)
    pub partials: Vec<(usize, usize, Partial)>,
    /// Arguments that are sampled variables.
    pub arg_sampled: Vec<bool>,
    /// Non-linear parts are affine in everything but sampled variables, without time.
    pub linear_between_samples: bool,
    /// The Jacobian does not depend on the core.
    pub affine_in_core: bool,
    /// One equation that is not linear between samples, for messages.
    pub first_nonlinear: Option<usize>,
    pub tables: Vec<Table>,
    /// How to have the core without a solver, where that can be.
    pub explicit: Option<Vec<Level>>,
    affine: BTreeMap<u32, (Vec<f64>, Vec<f64>)>,
}

impl Kernel {
    pub fn known_width(&self) -> usize {
        self.states.len() + self.inputs.len() + self.sampled.len() + 2
    }

    /// Builds the kernel of a reduced system.
    pub fn build(flat: &mut Flat, dae: &Dae) -> Kernel {
        let states = dae.states.clone();
        let inputs = flat.inputs.clone();
        let sampled: Vec<u32> = (0..flat.variables.len() as u32)
            .filter(|v| flat.variables[*v as usize].kind == Kind::Sampled)
            .collect();
        let width = states.len() + inputs.len() + sampled.len() + 2;
        let nc = dae.core.len();
        let mut place: BTreeMap<u32, usize> = BTreeMap::new();
        for (k, v) in states.iter().chain(&inputs).chain(&sampled).enumerate() {
            place.insert(column_of(*v), k);
        }
        place.insert(TIME, width - 2);
        place.insert(ONE, width - 1);
        let core_place: BTreeMap<u32, usize> = dae.core.iter().enumerate().map(|(k, c)| (*c, k)).collect();
        let mut affine: BTreeMap<u32, (Vec<f64>, Vec<f64>)> = BTreeMap::new();
        for (c, k) in &place {
            let mut row = (vec![0.0; width], vec![0.0; nc]);
            row.0[*k] = 1.0;
            affine.insert(*c, row);
        }
        for (c, k) in &core_place {
            let mut row = (vec![0.0; width], vec![0.0; nc]);
            row.1[*k] = 1.0;
            affine.insert(*c, row);
        }
        for (c, solved) in &dae.eliminated.solved {
            let mut row = (vec![0.0; width], vec![0.0; nc]);
            for (d, v) in solved {
                if let Some(k) = place.get(d) {
                    row.0[*k] += v;
                } else if let Some(k) = core_place.get(d) {
                    row.1[*k] += v;
                }
            }
            affine.insert(*c, row);
        }
        let mut kernel = Kernel {
            states,
            inputs,
            sampled,
            core: dae.core.clone(),
            rates: Rows::default(),
            args: Rows::default(),
            equations: Rows::default(),
            program: Program::default(),
            partials: Vec::new(),
            arg_sampled: Vec::new(),
            linear_between_samples: true,
            affine_in_core: true,
            first_nonlinear: None,
            tables: flat.tables.clone(),
            explicit: None,
            affine,
        };
        let rate_columns: Vec<u32> = kernel.states.iter().map(|v| rate_column_of(*v)).collect();
        kernel.rates = kernel.rows(&rate_columns);
        kernel.nonlinear_parts(flat, dae);
        kernel
    }

    /// Affine rows of columns.
    pub fn rows(&self, columns: &[u32]) -> Rows {
        let mut rows = Rows::new(columns.len(), self.known_width(), self.core.len());
        for (i, c) in columns.iter().enumerate() {
            if let Some((known, core)) = self.affine.get(c) {
                rows.known[i * rows.known_width..(i + 1) * rows.known_width].copy_from_slice(known);
                rows.core[i * rows.core_width..(i + 1) * rows.core_width].copy_from_slice(core);
            }
        }
        rows.pack();
        rows
    }

    fn nonlinear_parts(&mut self, flat: &mut Flat, dae: &Dae) {
        let (width, nc) = (self.known_width(), self.core.len());
        self.equations = Rows::new(nc, width, nc);
        let mut rests = Vec::with_capacity(nc);
        for (i, e) in dae.nonlinear.iter().enumerate() {
            let (row, rest) = split_linear(&mut flat.pool, dae.equations[*e].residual);
            for (c, v) in row {
                if let Some((known, core)) = self.affine.get(&c) {
                    for (k, w) in known.iter().enumerate() {
                        self.equations.known[i * width + k] += v * w;
                    }
                    for (k, w) in core.iter().enumerate() {
                        self.equations.core[i * nc + k] += v * w;
                    }
                }
            }
            rests.push(rest.unwrap_or_else(|| flat.pool.number(0.0)));
        }
        let mut columns: Vec<u32> = Vec::new();
        for rest in &rests {
            for id in flat.pool.below(&[*rest]) {
                if let Some(c) = leaf_column(flat.pool.node(id)) {
                    columns.push(c);
                }
            }
        }
        columns.sort_unstable();
        columns.dedup();
        self.args = self.rows(&columns);
        let variables = &flat.variables;
        self.arg_sampled = columns
            .iter()
            .map(|c| {
                of_column(*c).is_some_and(|(v, rate)| !rate && variables[v as usize].kind == Kind::Sampled)
            })
            .collect();
        self.equations.pack();
        let groups = self.order_explicitly(&flat.pool, &rests, &columns);
        let mut roots = rests.clone();
        for (i, rest) in rests.iter().enumerate() {
            for (a, column) in columns.iter().enumerate() {
                let partial = derivative(&mut flat.pool, *rest, &mut |pool, id| {
                    (leaf_column(pool.node(id)) == Some(*column)).then(|| pool.number(1.0))
                });
                if flat.pool.is_zero(partial) {
                    continue;
                }
                let d = depends(&flat.pool, partial);
                let moving = d.time
                    || !d.rates.is_empty()
                    || d.variables.iter().any(|v| flat.variables[*v as usize].kind != Kind::Sampled);
                if !self.arg_sampled[a] && (moving || *column == TIME) {
                    self.linear_between_samples = false;
                    self.first_nonlinear =
                        self.first_nonlinear.or(Some(dae.equations[dae.nonlinear[i]].origin));
                }
                let touched = d
                    .variables
                    .iter()
                    .map(|v| column_of(*v))
                    .chain(d.rates.iter().map(|v| rate_column_of(*v)))
                    .any(|c| self.affine.get(&c).is_some_and(|r| r.1.iter().any(|v| *v != 0.0)));
                if touched {
                    self.affine_in_core = false;
                }
                let p = match flat.pool.as_number(partial) {
                    Some(n) => Partial::Constant(n),
                    None => {
                        roots.push(partial);
                        Partial::Output(roots.len() - 1)
                    }
                };
                self.partials.push((i, a, p));
            }
        }
        self.program = Program::compile(&flat.pool, &roots, &groups, columns.len(), &|node| {
            leaf_column(node).and_then(|c| columns.iter().position(|k| *k == c))
        });
    }

    /// Finds out whether the core can be had from what is known without a solver: its equations in an order in which
    /// each brings one new unknown, linearly. Gives the groups of non-linear parts by when they can be evaluated; one
    /// group of all where a solver is needed.
    fn order_explicitly(&mut self, pool: &Pool, rests: &[Id], columns: &[u32]) -> Vec<Vec<Id>> {
        let nc = rests.len();
        let args_of: Vec<Vec<usize>> = rests
            .iter()
            .map(|rest| {
                let below = pool.below(&[*rest]);
                let leaves = below.iter().filter_map(|id| leaf_column(pool.node(*id)));
                leaves.filter_map(|c| columns.iter().position(|k| *k == c)).collect()
            })
            .collect();
        let through = |i: usize, j: usize| args_of[i].iter().any(|a| self.args.core_row(*a)[j] != 0.0);
        let mut solved = vec![false; nc];
        let mut done = vec![false; nc];
        let mut levels: Vec<Level> = Vec::new();
        let mut groups: Vec<Vec<Id>> = Vec::new();
        while done.iter().any(|d| !d) {
            // Arguments that can be had now; their non-linear parts make a group.
            let ready: Vec<usize> =
                (0..nc).filter(|i| !done[*i] && (0..nc).all(|j| solved[j] || !through(*i, j))).collect();
            let mut args: Vec<usize> = ready.iter().flat_map(|i| args_of[*i].iter().copied()).collect();
            args.sort_unstable();
            args.dedup();
            let mut level = Level { args, solve: Vec::new() };
            let mut progress = true;
            while progress {
                progress = false;
                for &i in ready.iter() {
                    let open: Vec<usize> =
                        (0..nc).filter(|j| !solved[*j] && self.equations.core_row(i)[*j] != 0.0).collect();
                    if !done[i]
                        && let [j] = open[..]
                    {
                        (done[i], solved[j], progress) = (true, true, true);
                        level.solve.push((i, j));
                    }
                }
            }
            if level.solve.is_empty() {
                self.explicit = None;
                return vec![rests.to_vec()];
            }
            groups.push(ready.iter().map(|i| rests[*i]).collect());
            levels.push(level);
        }
        self.explicit = Some(levels);
        groups
    }

    /// Number of phases of the program that give the core's equations; what follows are their derivatives.
    #[inline]
    pub fn value_phases(&self) -> usize {
        self.program.phases() - 1
    }

    /// Program and affine arguments of any expressions of this model (parameters are replaced by numbers).
    pub fn reader(&self, flat: &mut Flat, dependent: &[(u32, u32)], roots: &[Id]) -> Reader {
        let values = flat.parameter_values();
        let roots = substitute(&mut flat.pool, roots, &mut |pool, node| match node {
            Node::Parameter(p) => Some(pool.number(values[*p as usize])),
            Node::Rate(v) => dependent.iter().find(|d| d.0 == *v).map(|d| pool.variable(d.1 as usize)),
            _ => None,
        });
        let mut columns: Vec<u32> =
            flat.pool.below(&roots).iter().filter_map(|id| leaf_column(flat.pool.node(*id))).collect();
        columns.sort_unstable();
        columns.dedup();
        let program = Program::compile(&flat.pool, &roots, &[], columns.len(), &|node| {
            leaf_column(node).and_then(|c| columns.iter().position(|k| *k == c))
        });
        let args = self.rows(&columns);
        let registers = program.new_registers(columns.len());
        Reader { needs_core: args.needs_core(), args, program, registers }
    }
}

pub(crate) fn leaf_column(node: &Node) -> Option<u32> {
    match node {
        Node::Variable(v) => Some(column_of(*v)),
        Node::Rate(v) => Some(rate_column_of(*v)),
        Node::Time => Some(TIME),
        _ => None,
    }
}

/// Expressions evaluated from known and core.
#[derive(Debug, Clone)]
pub(crate) struct Reader {
    pub args: Rows,
    pub program: Program,
    pub registers: Vec<f64>,
    pub needs_core: bool,
}

impl Reader {
    pub fn read(&mut self, known: &[f64], core: &[f64], tables: &[Table]) {
        for i in 0..self.args.count {
            self.registers[i] = self.args.value(i, known, core);
        }
        self.program.run(&mut self.registers, tables);
    }

    #[inline]
    pub fn value(&self, k: usize) -> f64 {
        self.program.output(&self.registers, k)
    }
}

/// What a solve of the core came to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Solve {
    pub converged: bool,
    pub iterations: usize,
    /// Largest last correction relative to its unknown.
    pub correction: f64,
}

/// Scratch of the core solver.
#[derive(Debug, Clone)]
pub(crate) struct Newton {
    pub registers: Vec<f64>,
    base: Vec<f64>,
    base_equation: Vec<f64>,
    pub lu: Lu,
    pub residual: Vec<f64>,
    before: Vec<f64>,
    delta: Vec<f64>,
    trial: Vec<f64>,
}

impl Newton {
    pub fn new(kernel: &Kernel) -> Newton {
        let nc = kernel.core.len();
        Newton {
            registers: kernel.program.new_registers(kernel.args.count),
            base: vec![0.0; kernel.args.count],
            base_equation: vec![0.0; nc],
            lu: Lu::new(nc),
            residual: vec![0.0; nc],
            before: vec![0.0; nc],
            delta: vec![0.0; nc],
            trial: vec![0.0; nc],
        }
    }

    /// Registers and residual at the trial point.
    fn evaluate(&mut self, kernel: &Kernel, args: &Rows, equations: &Rows) {
        for a in 0..args.count {
            self.registers[a] = self.base[a] + args.core_part(a, &self.trial);
        }
        kernel.program.run_phases(0, kernel.value_phases(), &mut self.registers, &kernel.tables);
        self.residual_from_registers(kernel, equations);
    }

    fn residual_from_registers(&mut self, kernel: &Kernel, equations: &Rows) {
        for i in 0..self.residual.len() {
            self.residual[i] = self.base_equation[i]
                + equations.core_part(i, &self.trial)
                + kernel.program.output(&self.registers, i);
        }
    }

    /// Fills `lu.a` with the Jacobian where the registers hold the values of.
    pub fn jacobian(&mut self, kernel: &Kernel, args: &Rows, equations: &Rows) {
        let nc = kernel.core.len();
        let phases = kernel.value_phases();
        kernel.program.run_phases(phases, phases + 1, &mut self.registers, &kernel.tables);
        self.lu.a.copy_from_slice(&equations.core);
        for (i, a, p) in &kernel.partials {
            let v = match p {
                Partial::Constant(v) => *v,
                Partial::Output(k) => kernel.program.output(&self.registers, *k),
            };
            if v != 0.0 {
                let row = args.core_row(*a);
                for (to, w) in self.lu.a[i * nc..(i + 1) * nc].iter_mut().zip(row) {
                    *to += v * w;
                }
            }
        }
    }

    /// The core at `known`: one equation after the other where they can be ordered so, else by [`Newton::solve`]. False
    /// when there is none; `core` then keeps its values.
    pub fn settle(&mut self, kernel: &Kernel, known: &[f64], core: &mut [f64]) -> bool {
        let Some(levels) = &kernel.explicit else {
            let affine = kernel.affine_in_core;
            return self.solve(kernel, &kernel.args, &kernel.equations, known, core, affine).converged;
        };
        self.before.copy_from_slice(core);
        core.fill(0.0);
        for (phase, level) in levels.iter().enumerate() {
            for a in &level.args {
                self.registers[*a] = kernel.args.value(*a, known, core);
            }
            kernel.program.run_phases(phase, phase + 1, &mut self.registers, &kernel.tables);
            for &(i, j) in &level.solve {
                // The unknown itself is still zero.
                let rest = kernel.equations.value(i, known, core) + kernel.program.output(&self.registers, i);
                core[j] = -rest / kernel.equations.core_row(i)[j];
            }
        }
        let finite = core.iter().all(|c| c.is_finite());
        if !finite {
            core.copy_from_slice(&self.before);
        }
        finite
    }

    /// Solves for the core; `affine`: the Jacobian does not depend on it through these rows. Damped; where that gets
    /// stuck between the sides of a corner, once more with full steps, which cross it. On failure `core` keeps its
    /// values from before.
    pub fn solve(
        &mut self,
        kernel: &Kernel,
        args: &Rows,
        equations: &Rows,
        known: &[f64],
        core: &mut [f64],
        affine: bool,
    ) -> Solve {
        let nc = core.len();
        if nc == 0 {
            return Solve { converged: true, iterations: 0, correction: 0.0 };
        }
        self.before.copy_from_slice(core);
        let solve = self.iterate(kernel, args, equations, known, core, affine, HALVINGS_MAX);
        if solve.converged {
            return solve;
        }
        let again = self.iterate(kernel, args, equations, known, core, affine, 0);
        Solve { iterations: solve.iterations + again.iterations, ..again }
    }

    /// Whether the last correction moves no argument of the non-linear parts by more than rounding: nothing is left to
    /// iterate. (An unknown that is the small difference of large flows never gets better than their rounding.)
    fn unmoved(&self, args: &Rows) -> bool {
        (0..args.count)
            .all(|a| args.core_part(a, &self.delta).abs() <= 1e-13 * self.registers[a].abs() + 1e-16)
    }

    fn iterate(
        &mut self,
        kernel: &Kernel,
        args: &Rows,
        equations: &Rows,
        known: &[f64],
        core: &mut [f64],
        affine: bool,
        halvings: usize,
    ) -> Solve {
        let nc = core.len();
        for a in 0..args.count {
            self.base[a] = args.known_part(a, known);
        }
        for i in 0..nc {
            self.base_equation[i] = equations.known_part(i, known);
        }
        let size = |d: &[f64], c: &[f64]| {
            d.iter().zip(c).fold(0.0f64, |m, (d, c)| {
                if d.is_finite() { m.max(d.abs() / (c.abs() + 1e-4)) } else { f64::NAN }
            })
        };
        let mut correction = f64::NAN;
        self.trial.copy_from_slice(core);
        self.evaluate(kernel, args, equations);
        for iteration in 1..=ITERATIONS_MAX {
            self.jacobian(kernel, args, equations);
            if !self.lu.factor() {
                break;
            }
            self.delta.copy_from_slice(&self.residual);
            self.lu.solve(&mut self.delta);
            correction = size(&self.delta, core);
            if correction.is_nan() {
                break;
            }
            // Quadratic convergence: a correction of 1e-8 leaves an error near 1e-16.
            if affine || correction < 1e-8 || (iteration > 3 && self.unmoved(args)) {
                for (c, d) in core.iter_mut().zip(&self.delta) {
                    *c -= d;
                }
                return Solve { converged: true, iterations: iteration, correction };
            }
            if halvings == 0 {
                for k in 0..nc {
                    core[k] -= self.delta[k];
                }
                self.trial.copy_from_slice(core);
                self.evaluate(kernel, args, equations);
                continue;
            }
            // Natural monotonicity: the next correction with the same Jacobian must shrink; otherwise a shorter step.
            let mut lambda = 1.0;
            let mut next = f64::NAN;
            for _ in 0..halvings {
                for k in 0..nc {
                    self.trial[k] = core[k] - lambda * self.delta[k];
                }
                self.evaluate(kernel, args, equations);
                self.lu.solve(&mut self.residual);
                next = size(&self.residual, core);
                if next <= (1.0 - 0.25 * lambda) * correction {
                    break;
                }
                lambda *= 0.5;
            }
            core.copy_from_slice(&self.trial);
            let rounding = correction < 1e-6 && next > 0.3 * correction;
            if rounding && lambda < 1.0 {
                return Solve { converged: true, iterations: iteration, correction };
            }
            if lambda == 1.0 && (next < 1e-11 || rounding) {
                for (c, d) in core.iter_mut().zip(&self.residual) {
                    *c -= d;
                }
                return Solve { converged: true, iterations: iteration, correction: next };
            }
            // The registers hold the trial point; its residual was overwritten by the simplified correction.
            self.residual_from_registers(kernel, equations);
        }
        core.copy_from_slice(&self.before);
        Solve { converged: false, iterations: ITERATIONS_MAX, correction }
    }
}

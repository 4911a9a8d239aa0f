//! The numeric heart of a composed model. All variables are affine in what is known and in the core unknowns c:
//!     known = [x, u, m, t, 1]   (states, inputs, sampled variables, time, one)
//! and c solves  R_known known + R_core c + n(args) = 0  with the non-linear parts n of the core equations as
//! functions of a few affine arguments. Newton's method on c, damped by the natural
//! monotonicity test (Deuflhard 2004, Newton Methods for Nonlinear Problems, 3.3); one solve when n is affine in c.

use std::collections::BTreeMap;

use crate::calculus::{depends, derivative, substitute};
use crate::dense::Lu;
use crate::flat::{Flat, Kind};
use crate::pool::{Id, Node};
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
}

impl Rows {
    pub fn new(count: usize, known_width: usize, core_width: usize) -> Rows {
        Rows {
            count,
            known_width,
            core_width,
            known: vec![0.0; count * known_width],
            core: vec![0.0; count * core_width],
        }
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
        dot(self.known_row(i), known) + dot(self.core_row(i), core)
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
        self.program = Program::compile(&flat.pool, &roots, columns.len(), &|node| {
            leaf_column(node).and_then(|c| columns.iter().position(|k| *k == c))
        });
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
        let program = Program::compile(&flat.pool, &roots, columns.len(), &|node| {
            leaf_column(node).and_then(|c| columns.iter().position(|k| *k == c))
        });
        let args = self.rows(&columns);
        let registers = vec![0.0; program.registers().max(columns.len())];
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
            registers: vec![0.0; kernel.program.registers().max(kernel.args.count)],
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
            self.registers[a] = self.base[a] + dot(args.core_row(a), &self.trial);
        }
        kernel.program.run(&mut self.registers, &kernel.tables);
        self.residual_from_registers(kernel, equations);
    }

    fn residual_from_registers(&mut self, kernel: &Kernel, equations: &Rows) {
        for i in 0..self.residual.len() {
            self.residual[i] = self.base_equation[i]
                + dot(equations.core_row(i), &self.trial)
                + kernel.program.output(&self.registers, i);
        }
    }

    /// Fills `lu.a` with the Jacobian at the current registers.
    pub fn jacobian(&mut self, kernel: &Kernel, args: &Rows, equations: &Rows) {
        let nc = kernel.core.len();
        self.lu.a.copy_from_slice(&equations.core);
        for (i, a, p) in &kernel.partials {
            let v = match p {
                Partial::Constant(v) => *v,
                Partial::Output(k) => kernel.program.output(&self.registers, *k),
            };
            if v != 0.0 {
                let row = args.core_row(*a);
                for (j, w) in row.iter().enumerate() {
                    self.lu.a[i * nc + j] += v * w;
                }
            }
        }
    }

    /// Solves for the core; `affine`: the Jacobian does not depend on it through these rows. On failure `core` keeps its values from before.
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
        for a in 0..args.count {
            self.base[a] = dot(args.known_row(a), known);
        }
        for i in 0..nc {
            self.base_equation[i] = dot(equations.known_row(i), known);
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
            if affine || correction < 1e-8 {
                for (c, d) in core.iter_mut().zip(&self.delta) {
                    *c -= d;
                }
                return Solve { converged: true, iterations: iteration, correction };
            }
            // Natural monotonicity: the next correction with the same Jacobian must shrink; otherwise a shorter step.
            let mut lambda = 1.0;
            let mut next = f64::NAN;
            for _ in 0..HALVINGS_MAX {
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

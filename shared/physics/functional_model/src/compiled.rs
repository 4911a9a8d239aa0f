//! The compiled step. Between two samples a model that is linear is advanced exactly (matrix exponential of the
//! augmented system, inputs held); any other by the implicit midpoint rule (A-stable, second order; keeps quadratic
//! energies exactly, so the energy account closes to rounding) or, where asked for, by the classical fourth-order
//! Runge-Kutta rule. Nothing allocates after [`System::compile`].
//!
//! Order of a step: (1) once a sample: mechanisms read, decide whether to hold, give new values; vector states in
//! frames that jumped are re-expressed; (2) the state advances by dt; (3) outputs at the new time.

use crate::account::{Account, Accountant};
use crate::dense::{Exponential, Lu};
use crate::error::{ModelError, Place, Rule};
use crate::exact::ExactStep;
use crate::flat::Kind;
use crate::kernel::{Kernel, Newton, Reader, Rows, dot};
use crate::model::System;

/// Most f64 a model's state may take in a checkpoint.
pub const STATE_LEN_MAX: usize = 256;

/// How to advance.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// Matrix exponential; for models that are linear between samples.
    Exact,
    /// Implicit midpoint rule.
    Implicit,
    /// Runge-Kutta, fourth order.
    Explicit,
}

/// What to compile.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CompileOptions {
    /// Overrides the file's method. None: the file's, otherwise exact where possible and implicit elsewhere.
    pub method: Option<Method>,
    /// Keeps the power residuals and the energy account.
    pub account: bool,
}

/// What happened in a step.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct StepStatus {
    /// An input was not finite; the last good value was used.
    pub input_held: bool,
    /// The solver of the step did not converge: the state was held.
    pub not_converged: bool,
    /// The new state was not finite: the old one was held.
    pub state_held: bool,
    /// Newton iterations of the step.
    pub iterations: u32,
}

struct MechanismRun {
    /// Reader positions: hold first where there is one, then rules.
    hold: bool,
    /// Position of each result among the sampled variables.
    gives: Vec<usize>,
    reader: Reader,
    next: Vec<f64>,
}

struct FrameRun {
    /// Positions of the components among the states.
    states: Vec<usize>,
    reader: Reader,
    old: Vec<f64>,
    vector: [f64; 3],
}

/// A model ready to step.
pub struct Compiled {
    kernel: Kernel,
    method: Method,
    n: usize,
    nu: usize,
    nm: usize,
    /// [x, u, m, t, 1]
    known: Vec<f64>,
    middle: Vec<f64>,
    core: Vec<f64>,
    start_known: Vec<f64>,
    start_core: Vec<f64>,
    newton: Newton,
    dt: f64,
    /// Implicit: x_mid, arguments and equations over the known quantities at the start of the step.
    middle_rows: Rows,
    step_args: Rows,
    step_equations: Rows,
    inverse: Vec<f64>,
    lu: Lu,
    column: Vec<f64>,
    rates: Vec<[f64; 4]>,
    exact: Option<ExactStep>,
    outputs: Reader,
    output_values: Vec<f64>,
    output_names: Vec<String>,
    state_names: Vec<String>,
    input_names: Vec<String>,
    mechanisms: Vec<MechanismRun>,
    frames: Vec<FrameRun>,
    sample_s: Option<f64>,
    sample_count: u32,
    time_offset: f64,
    steps: f64,
    accountant: Option<Accountant>,
}

impl System {
    /// Compiles for stepping.
    ///
    /// # Errors
    /// `exact` asked for a model that is not linear between samples (the block is named); a state of more than
    /// [`STATE_LEN_MAX`] numbers.
    pub fn compile(&self, options: CompileOptions) -> Result<Compiled, Vec<ModelError>> {
        let outputs = self.outputs();
        let (mut known, core) = (self.start_known(), self.start_core());
        let state_names = self.state_names();
        let input_names = self.input_names();
        let mut guard = self.flat.borrow_mut();
        let flat = &mut *guard;
        let kernel = self.kernel.clone();
        let (n, nu, nm, nc) =
            (kernel.states.len(), kernel.inputs.len(), kernel.sampled.len(), kernel.core.len());
        let file = Place { file: self.file.as_str().into(), line: 0 };
        let asked = options.method.or(match flat.method.as_ref().map(|m| m.0.as_str()) {
            Some("exact") => Some(Method::Exact),
            Some("implicit") => Some(Method::Implicit),
            Some("explicit") => Some(Method::Explicit),
            _ => None,
        });
        let method =
            asked.unwrap_or(if kernel.linear_between_samples { Method::Exact } else { Method::Implicit });
        if method == Method::Exact
            && let Some(e) = kernel.first_nonlinear
        {
            let e = &flat.equations[e];
            return Err(vec![e.place.error(
                Rule::Method,
                &e.label,
                "method = \"exact\" needs equations that are linear between samples; this one is not: use \"implicit\"",
            )]);
        }
        let ids: Vec<_> = outputs.iter().map(|o| o.1).collect();
        let output_reader = kernel.reader(flat, &self.dae.dependent, &ids);
        let sampled = kernel.sampled.clone();
        let mut mechanisms = Vec::new();
        for m in flat.mechanisms.clone() {
            let mut roots: Vec<_> = m.hold.into_iter().collect();
            roots.extend(m.gives.iter().map(|g| g.1));
            let gives: Vec<usize> =
                m.gives.iter().filter_map(|g| sampled.iter().position(|s| *s == g.0)).collect();
            let next = vec![0.0; gives.len()];
            mechanisms.push(MechanismRun {
                hold: m.hold.is_some(),
                gives,
                reader: kernel.reader(flat, &self.dae.dependent, &roots),
                next,
            });
        }
        let mut frames = Vec::new();
        for f in flat.sampled_frames.clone() {
            let states: Vec<usize> =
                f.states.iter().filter_map(|v| kernel.states.iter().position(|s| s == v)).collect();
            // A dependent state follows the independent ones by itself.
            if states.len() == f.states.len() {
                let reader = kernel.reader(flat, &self.dae.dependent, &f.rotation);
                frames.push(FrameRun { states, old: vec![0.0; f.rotation.len()], reader, vector: [0.0; 3] });
            }
        }
        let accountant =
            if options.account { Some(Accountant::build(flat, &kernel, &self.dae)) } else { None };
        known[n + nu + nm] = 0.0;
        let width = kernel.known_width();
        let size = n + nu + 1;
        let exact = (method == Method::Exact).then(|| ExactStep {
            a: vec![0.0; size * size],
            phi: vec![0.0; size * size],
            exponential: Exponential::new(size),
            size,
            held: vec![f64::NAN; nm],
            valid: false,
            z: vec![0.0; size],
            core_map: vec![0.0; nc * size],
        });
        let count = output_reader.program.outputs();
        let mut compiled = Compiled {
            newton: Newton::new(&kernel),
            middle: known.clone(),
            start_known: known.clone(),
            start_core: core.clone(),
            known,
            core,
            dt: f64::NAN,
            middle_rows: Rows::new(n, width, nc),
            step_args: Rows::new(kernel.args.count, width, nc),
            step_equations: Rows::new(nc, width, nc),
            inverse: vec![0.0; n * n],
            lu: Lu::new(n),
            column: vec![0.0; n],
            rates: vec![[0.0; 4]; n],
            exact,
            outputs: output_reader,
            output_values: vec![0.0; count],
            output_names: outputs.into_iter().map(|o| o.0).collect(),
            state_names,
            input_names,
            mechanisms,
            frames,
            sample_s: flat.sample,
            sample_count: 0,
            time_offset: 0.0,
            steps: 0.0,
            accountant,
            kernel,
            method,
            n,
            nu,
            nm,
        };
        if compiled.state_len() > STATE_LEN_MAX {
            let message = format!(
                "the state takes {} numbers, at most {STATE_LEN_MAX} fit a checkpoint",
                compiled.state_len()
            );
            return Err(vec![file.error(Rule::Value, "", message)]);
        }
        debug_assert!(flat.variables.iter().filter(|v| v.kind == Kind::Sampled).count() == nm);
        compiled.reset();
        Ok(compiled)
    }
}

impl Compiled {
    /// Back to the start values, time zero, inputs zero.
    pub fn reset(&mut self) {
        self.known.copy_from_slice(&self.start_known);
        self.core.copy_from_slice(&self.start_core);
        self.sample_count = 0;
        self.steps = 0.0;
        self.time_offset = 0.0;
        self.solve_now();
        self.read_outputs();
        if let Some(a) = &mut self.accountant {
            a.reset(&self.known, &self.core, &self.kernel);
        }
    }

    /// Advances by `dt_s` with `inputs` (order of [`Compiled::input_names`], SI) held over the step. Bounded work.
    pub fn step(&mut self, inputs: &[f64], dt_s: f64) -> StepStatus {
        assert_eq!(inputs.len(), self.nu, "one value for each input");
        assert!(dt_s > 0.0 && dt_s.is_finite(), "dt must be positive");
        let mut status = StepStatus::default();
        for (k, u) in inputs.iter().enumerate() {
            if u.is_finite() {
                self.known[self.n + k] = *u;
            } else {
                status.input_held = true;
            }
        }
        self.sample(dt_s);
        if self.dt != dt_s {
            self.prepare(dt_s);
        }
        match self.method {
            Method::Exact => self.advance_exact(dt_s),
            Method::Implicit => self.advance_implicit(dt_s, &mut status),
            Method::Explicit => self.advance_explicit(dt_s, &mut status),
        }
        self.steps += 1.0;
        let at = self.n + self.nu + self.nm;
        self.known[at] += dt_s;
        if self.outputs.needs_core || self.accountant.is_some() {
            let solve = self.solve_now();
            status.not_converged |= !solve;
        }
        self.read_outputs();
        if let Some(a) = &mut self.accountant {
            a.close(&self.known, &self.core, &self.kernel);
        }
        status
    }

    /// Mechanisms, once a sample.
    fn sample(&mut self, dt: f64) {
        if self.mechanisms.is_empty() {
            return;
        }
        let every = self.sample_s.map_or(1.0, |s| (s / dt).round().max(1.0)) as u32;
        if self.sample_count == 0 {
            if self.mechanisms.iter().any(|m| m.reader.needs_core) {
                self.solve_now();
            }
            for f in &mut self.frames {
                f.reader.read(&self.known, &self.core, &self.kernel.tables);
                for (k, old) in f.old.iter_mut().enumerate() {
                    *old = f.reader.value(k);
                }
            }
            // All mechanisms read the same instant, then all give.
            for m in &mut self.mechanisms {
                m.reader.read(&self.known, &self.core, &self.kernel.tables);
                let hold = m.hold && m.reader.value(0) != 0.0;
                let base = self.n + self.nu;
                for (k, at) in m.gives.iter().enumerate() {
                    let v = m.reader.value(k + usize::from(m.hold));
                    m.next[k] = if hold || !v.is_finite() { self.known[base + at] } else { v };
                }
            }
            for m in &self.mechanisms {
                for (at, v) in m.gives.iter().zip(&m.next) {
                    self.known[self.n + self.nu + at] = *v;
                }
            }
            for f in &mut self.frames {
                f.reader.read(&self.known, &self.core, &self.kernel.tables);
                let d = f.states.len();
                // x_new = R_new^T R_old x_old
                for i in 0..d {
                    f.vector[i] = (0..d).map(|j| f.old[i * d + j] * self.known[f.states[j]]).sum();
                }
                for j in 0..d {
                    self.known[f.states[j]] = (0..d).map(|i| f.reader.value(i * d + j) * f.vector[i]).sum();
                }
            }
            if let Some(a) = &mut self.accountant {
                if a.needs_core() {
                    self.newton.settle(&self.kernel, &self.known, &mut self.core);
                }
                a.after_sample(&self.known, &self.core, &self.kernel);
            }
        }
        self.sample_count = (self.sample_count + 1) % every;
    }

    fn solve_now(&mut self) -> bool {
        self.newton.settle(&self.kernel, &self.known, &mut self.core)
    }

    fn read_outputs(&mut self) {
        self.outputs.read(&self.known, &self.core, &self.kernel.tables);
        for (k, v) in self.output_values.iter_mut().enumerate() {
            let new = self.outputs.value(k);
            if new.is_finite() {
                *v = new;
            }
        }
    }

    /// Matrices of the step for a new dt.
    fn prepare(&mut self, dt: f64) {
        self.dt = dt;
        if let Some(e) = &mut self.exact {
            e.valid = false;
        }
        if self.method != Method::Implicit {
            return;
        }
        let (n, width) = (self.n, self.kernel.known_width());
        let h = 0.5 * dt;
        // x_mid = (I - h R_x)^-1 (x0 + h (R_rest rest + R_core c))
        for i in 0..n {
            for j in 0..n {
                self.lu.a[i * n + j] =
                    f64::from(u8::from(i == j)) - h * self.kernel.rates.known[i * width + j];
            }
        }
        // A step so long that this is singular cannot be taken; the identity then keeps numbers finite and the
        // solver reports that it did not converge.
        let good = n == 0 || self.lu.factor();
        for j in 0..n {
            self.column.fill(0.0);
            self.column[j] = 1.0;
            if good {
                self.lu.solve(&mut self.column);
            }
            for i in 0..n {
                self.inverse[i * n + j] = self.column[i];
            }
        }
        let nc = self.core.len();
        let rates = &self.kernel.rates;
        for i in 0..n {
            let row = &self.inverse[i * n..(i + 1) * n];
            for k in 0..width {
                self.middle_rows.known[i * width + k] = if k < n {
                    row[k]
                } else {
                    (0..n).map(|j| row[j] * h * rates.known[j * width + k]).sum()
                };
            }
            for k in 0..nc {
                self.middle_rows.core[i * nc + k] = (0..n).map(|j| row[j] * h * rates.core[j * nc + k]).sum();
            }
        }
        through_middle(&self.kernel.args, &self.middle_rows, n, &mut self.step_args);
        through_middle(&self.kernel.equations, &self.middle_rows, n, &mut self.step_equations);
        self.middle_rows.pack();
        self.step_args.pack();
        self.step_equations.pack();
    }

    fn advance_implicit(&mut self, dt: f64, status: &mut StepStatus) {
        let (n, at) = (self.n, self.n + self.nu + self.nm);
        let t0 = self.known[at];
        self.known[at] = t0 + 0.5 * dt;
        let solve = self.newton.solve(
            &self.kernel,
            &self.step_args,
            &self.step_equations,
            &self.known,
            &mut self.core,
            self.kernel.linear_between_samples,
        );
        status.iterations = solve.iterations as u32;
        status.not_converged = !solve.converged;
        if solve.converged {
            let mut finite = true;
            for i in 0..n {
                self.middle[i] = self.middle_rows.value(i, &self.known, &self.core);
                finite &= self.middle[i].is_finite();
            }
            if finite {
                self.middle[n..].copy_from_slice(&self.known[n..]);
                if let Some(a) = &mut self.accountant {
                    a.add(&self.middle, &self.core, &self.kernel, dt);
                }
                for i in 0..n {
                    self.known[i] = 2.0 * self.middle[i] - self.known[i];
                }
            } else {
                status.state_held = true;
            }
        }
        self.known[at] = t0;
    }

    fn advance_explicit(&mut self, dt: f64, status: &mut StepStatus) {
        let (n, at) = (self.n, self.n + self.nu + self.nm);
        let t0 = self.known[at];
        self.middle.copy_from_slice(&self.known);
        let mut finite = true;
        for stage in 0..4 {
            let c = [0.0, 0.5, 0.5, 1.0][stage];
            if stage > 0 {
                for i in 0..n {
                    self.middle[i] = self.known[i] + c * dt * self.rates[i][stage - 1];
                }
            }
            self.middle[at] = t0 + c * dt;
            status.iterations += 1;
            status.not_converged |= !self.newton.settle(&self.kernel, &self.middle, &mut self.core);
            for i in 0..n {
                self.rates[i][stage] = self.kernel.rates.value(i, &self.middle, &self.core);
                finite &= self.rates[i][stage].is_finite();
            }
            if let Some(a) = &mut self.accountant {
                a.add(&self.middle, &self.core, &self.kernel, dt * [1.0, 2.0, 2.0, 1.0][stage] / 6.0);
            }
        }
        if !finite || status.not_converged {
            status.state_held = true;
            return;
        }
        for i in 0..n {
            let k = &self.rates[i];
            self.known[i] += dt / 6.0 * (k[0] + 2.0 * k[1] + 2.0 * k[2] + k[3]);
        }
    }

    fn advance_exact(&mut self, dt: f64) {
        let Some(e) = &mut self.exact else { return };
        let (n, nu, nm) = (self.n, self.nu, self.nm);
        let sampled = &self.known[n + nu..n + nu + nm];
        if !e.valid || e.held != sampled {
            e.held.copy_from_slice(sampled);
            e.valid = true;
            e.refresh(&self.kernel, &mut self.newton, &self.known, n, nu);
            let a = std::mem::take(&mut e.a);
            e.exponential.of(&a, dt, &mut e.phi);
            if let Some(account) = &mut self.accountant {
                account.prepare_exact(&a, e.size, dt, &mut e.exponential);
            }
            e.a = a;
        }
        e.z[..n + nu].copy_from_slice(&self.known[..n + nu]);
        e.z[n + nu] = 1.0;
        if let Some(account) = &mut self.accountant {
            account.add_exact(&e.z, &e.core_map, &self.known, n, nu, &self.kernel, dt);
        }
        for i in 0..n {
            self.middle[i] = dot(&e.phi[i * e.size..(i + 1) * e.size], &e.z);
        }
        if self.middle[..n].iter().all(|v| v.is_finite()) {
            self.known[..n].copy_from_slice(&self.middle[..n]);
        }
    }

    /// Outputs at the end of the last step: what open ports give, then observations.
    pub fn outputs(&self) -> &[f64] {
        &self.output_values
    }

    /// One output by name.
    pub fn output(&self, name: &str) -> Option<f64> {
        self.output_index(name).map(|k| self.output_values[k])
    }

    /// Position of an output.
    pub fn output_index(&self, name: &str) -> Option<usize> {
        self.output_names.iter().position(|n| n == name)
    }

    /// Position of an input.
    pub fn input_index(&self, name: &str) -> Option<usize> {
        self.input_names.iter().position(|n| n == name)
    }

    /// Names of the outputs.
    pub fn output_names(&self) -> &[String] {
        &self.output_names
    }

    /// Names of the inputs.
    pub fn input_names(&self) -> &[String] {
        &self.input_names
    }

    /// Names of the states.
    pub fn state_names(&self) -> &[String] {
        &self.state_names
    }

    /// The states, SI.
    pub fn states(&self) -> &[f64] {
        &self.known[..self.n]
    }

    /// Sets the states (external initial values) and re-evaluates the outputs.
    pub fn set_states(&mut self, states: &[f64]) {
        assert_eq!(states.len(), self.n, "one value for each state");
        self.known[..self.n].copy_from_slice(states);
        self.solve_now();
        self.read_outputs();
        if let Some(a) = &mut self.accountant {
            a.reset(&self.known, &self.core, &self.kernel);
        }
    }

    /// Sampled variables of mechanisms.
    pub fn sampled(&self) -> &[f64] {
        &self.known[self.n + self.nu..self.n + self.nu + self.nm]
    }

    /// Model time since the start, s.
    pub fn time_s(&self) -> f64 {
        self.known[self.n + self.nu + self.nm]
    }

    /// The method in use.
    pub fn method(&self) -> Method {
        self.method
    }

    /// Powers and energies; `None` unless compiled with `account`.
    pub fn account(&self) -> Option<&Account> {
        self.accountant.as_ref().map(|a| &a.account)
    }

    /// Numbers in a saved state.
    pub fn state_len(&self) -> usize {
        self.known.len() - 1 + self.core.len() + 2 + self.accountant.as_ref().map_or(0, Accountant::state_len)
    }

    /// Saves everything a bit-exact continuation needs.
    pub fn save_state(&self, out: &mut [f64]) {
        assert_eq!(out.len(), self.state_len(), "length of a saved state");
        let k = self.known.len() - 1;
        out[..k].copy_from_slice(&self.known[..k]);
        out[k..k + self.core.len()].copy_from_slice(&self.core);
        let mut at = k + self.core.len();
        out[at] = f64::from(self.sample_count);
        out[at + 1] = self.steps;
        at += 2;
        if let Some(a) = &self.accountant {
            a.save(&mut out[at..]);
        }
    }

    /// Continues from a saved state of the same model.
    pub fn load_state(&mut self, from: &[f64]) {
        assert_eq!(from.len(), self.state_len(), "length of a saved state");
        let k = self.known.len() - 1;
        self.known[..k].copy_from_slice(&from[..k]);
        let nc = self.core.len();
        self.core.copy_from_slice(&from[k..k + nc]);
        let at = k + nc;
        self.sample_count = from[at] as u32;
        self.steps = from[at + 1];
        if let Some(a) = &mut self.accountant {
            a.load(&from[at + 2..]);
        }
        self.read_outputs();
    }
}

/// Rows over the mid-point states as rows over the states at the start of the step.
fn through_middle(from: &Rows, middle: &Rows, n: usize, to: &mut Rows) {
    let (width, nc) = (from.known_width, from.core_width);
    for i in 0..from.count {
        for k in 0..width {
            let rest = if k < n { 0.0 } else { from.known[i * width + k] };
            to.known[i * width + k] =
                rest + (0..n).map(|j| from.known[i * width + j] * middle.known[j * width + k]).sum::<f64>();
        }
        for k in 0..nc {
            to.core[i * nc + k] = from.core[i * nc + k]
                + (0..n).map(|j| from.known[i * width + j] * middle.core[j * nc + k]).sum::<f64>();
        }
    }
}

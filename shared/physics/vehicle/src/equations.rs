//! The user's variables, imports and outputs ([`config::equations`]), compiled once and evaluated around each step.
//!
//! Before the step: variables in their order, then what each import does. After it: outputs. The exports that the
//! expressions read are taken at the end of each step and are state, so that a restored car goes on with the same bits.
//! No heap in a step; a result that is not finite keeps its last value and is counted.

use crate::io::VehicleOutput;
use crate::variables::{ExportId, Exports, ImportId, ImportMode, Imports};
use config::Broken;
use config::equations;
use functional_model::{Formula, Formulas};

/// Further names that expressions may use: time at the step's start (before) or end (outputs), length of the step.
const TIME: [(&str, &str); 2] = [("time_s", "s"), ("step_s", "s")];
/// Words of the expression language that no variable can be called.
const WORDS: &[&str] = &[
    "pi", "and", "or", "not", "if", "min", "max", "clamp", "abs", "sign", "sqrt", "exp", "ln", "sin", "cos",
    "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh", "norm", "dot", "cross",
];

/// A user output: name, unit, description.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UserOutput {
    /// Name.
    pub name: String,
    /// Unit of its value.
    pub unit: String,
    /// What it is, empty if the user did not say.
    pub description: String,
}

/// Compiled equations with their state.
#[derive(Debug, Clone)]
pub struct Equations {
    reads: Vec<ExportId>,
    imports: Vec<(ImportId, ImportMode)>,
    outputs: Vec<UserOutput>,
    before: Formulas,
    after: Formulas,
    /// Inputs of both: time, step, exports read, variables (SI).
    input: Vec<f64>,
    /// SI per unit of each variable.
    scale: Vec<f64>,
    start: Vec<f64>,
    /// Variables, then imports, each in its own unit.
    changed: Vec<f64>,
    output: Vec<f64>,
    scratch: Vec<f64>,
    faults: u64,
    step_s: f64,
}

impl Equations {
    /// Compiles.
    ///
    /// # Errors
    /// Names and expressions that are wrong, by their key within the section.
    pub(crate) fn new(section: &equations::Equations, step_s: f64) -> Result<Self, Vec<Broken>> {
        let mut broken = Vec::new();
        let mut fault = |key: String, rule: String| broken.push(Broken { key, rule });
        let exports = Exports::variables();
        let variables: Vec<_> = section.variables.iter().flatten().collect();
        let outputs: Vec<_> = section.outputs.iter().flatten().collect();
        let taken = |name: &str| {
            WORDS.contains(&name)
                || TIME.iter().any(|(time, _)| *time == name)
                || Exports::find(name).is_some()
                || Imports::find(name).is_some()
        };
        let rule = "must not be a name that the car or the language has";
        for (i, v) in variables.iter().enumerate().filter(|(_, v)| taken(&v.name)) {
            fault(format!("variables[{i}].name"), format!("{rule}: {}", v.name));
        }
        for (i, o) in outputs.iter().enumerate().filter(|(_, o)| taken(&o.name)) {
            fault(format!("outputs[{i}].name"), format!("{rule}: {}", o.name));
        }
        let mut imports = Vec::new();
        for (i, import) in section.imports.iter().flatten().enumerate() {
            let mode = match import.mode {
                equations::ImportMode::Add => ImportMode::Add,
                equations::ImportMode::Multiply => ImportMode::Multiply,
                equations::ImportMode::Replace => ImportMode::Replace,
            };
            match Imports::variables().into_iter().find(|v| v.name == import.variable) {
                Some(v) => {
                    let unit = if mode == ImportMode::Multiply { "1" } else { v.unit };
                    imports.push((Imports::find(&v.name), mode, unit, import.expression.as_str()));
                }
                None => {
                    let near =
                        closest(&import.variable, Imports::variables().iter().map(|v| v.name.as_str()));
                    let rule = if Exports::find(&import.variable).is_some() {
                        "can be read but not imported".to_owned()
                    } else {
                        format!("the car has no such variable{near}")
                    };
                    fault(format!("imports[{i}].variable"), rule);
                    imports.push((None, mode, "1", "1"));
                }
            }
        }

        // What can be read: time, exports, the user's variables.
        let mut names: Vec<(&str, &str)> = TIME.to_vec();
        names.extend(exports.iter().filter(|v| v.name != TIME[0].0).map(|v| (v.name.as_str(), v.unit)));
        let own = names.len();
        names.extend(variables.iter().map(|v| (v.name.as_str(), v.unit.as_str())));
        let first: Vec<Formula<'_>> = variables
            .iter()
            .map(|v| Formula { name: &v.name, unit: &v.unit, text: &v.expression })
            .chain(imports.iter().map(|(_, _, unit, text)| Formula { name: "", unit, text }))
            .collect();
        let before = Formulas::compile(&names, &first);
        for error in before.as_ref().err().into_iter().flatten() {
            let word = if error.in_unit { "unit" } else { "expression" };
            let key = match error.index.checked_sub(variables.len()) {
                None => format!("variables[{}].{word}", error.index),
                Some(i) => format!("imports[{i}].{word}"),
            };
            fault(key, error.rule.clone());
        }
        let last: Vec<Formula<'_>> =
            outputs.iter().map(|o| Formula { name: &o.name, unit: &o.unit, text: &o.expression }).collect();
        let after = Formulas::compile(&names, &last);
        for error in after.as_ref().err().into_iter().flatten() {
            let word = if error.in_unit { "unit" } else { "expression" };
            fault(format!("outputs[{}].{word}", error.index), error.rule.clone());
        }
        if let Ok(before) = &before {
            for (i, v) in variables.iter().enumerate() {
                // Used before it is evaluated: by itself or by one ahead of it.
                if before.uses(own + i) && v.start.is_none() {
                    let rule = "must be given: its value of the last step is used";
                    fault(format!("variables[{i}].start"), rule.to_owned());
                }
            }
        }
        let (Ok(before), Ok(after)) = (before, after) else { return Err(broken) };
        if !broken.is_empty() {
            return Err(broken);
        }

        // Only what is used is read each step.
        let used: Vec<usize> =
            (0..names.len()).filter(|i| *i < 2 || *i >= own || before.uses(*i) || after.uses(*i)).collect();
        let names: Vec<_> = used.iter().map(|i| names[*i]).collect();
        let reads: Vec<ExportId> = names[2..names.len() - variables.len()]
            .iter()
            .filter_map(|(name, _)| Exports::find(name))
            .collect();
        let again = |error: Vec<functional_model::FormulaError>| {
            error.into_iter().map(|e| Broken { key: String::new(), rule: e.rule }).collect::<Vec<_>>()
        };
        let before = Formulas::compile(&names, &first).map_err(again)?;
        let after = Formulas::compile(&names, &last).map_err(again)?;
        let scale = variables.iter().map(|v| functional_model::si_per_unit(&v.unit).unwrap_or(1.0)).collect();
        let mut equations = Self {
            input: vec![0.0; names.len()],
            scale,
            start: variables.iter().map(|v| v.start.unwrap_or(0.0)).collect(),
            changed: vec![0.0; first.len()],
            output: vec![0.0; last.len()],
            scratch: vec![0.0; first.len().max(last.len())],
            faults: 0,
            step_s,
            reads,
            imports: imports.into_iter().filter_map(|(id, mode, ..)| id.map(|id| (id, mode))).collect(),
            outputs: outputs
                .iter()
                .map(|o| UserOutput {
                    name: o.name.clone(),
                    unit: o.unit.clone(),
                    description: o.description.clone().unwrap_or_default(),
                })
                .collect(),
            before,
            after,
        };
        equations.input[1] = step_s;
        Ok(equations)
    }

    /// Where the car stands before its first step.
    pub(crate) fn reset(&mut self, output: &VehicleOutput) {
        self.faults = 0;
        self.input[1] = self.step_s;
        self.changed.fill(0.0);
        self.changed[..self.start.len()].copy_from_slice(&self.start);
        for (k, (_, mode)) in self.imports.iter().enumerate() {
            self.changed[self.start.len() + k] = f64::from(u8::from(*mode == ImportMode::Multiply));
        }
        self.output.fill(0.0);
        self.after(output);
    }

    /// Before a step that begins at `time_s`.
    pub(crate) fn before(&mut self, time_s: f64, imports: &mut Imports) {
        self.input[0] = time_s;
        let count = self.changed.len();
        self.before.run(&self.input, &mut self.scratch[..count]);
        for (kept, new) in self.changed.iter_mut().zip(&self.scratch) {
            if new.is_finite() {
                *kept = *new;
            } else {
                self.faults += 1;
            }
        }
        for ((id, mode), value) in self.imports.iter().zip(&self.changed[self.start.len()..]) {
            imports.set(*id, *mode, *value);
        }
    }

    /// Ends the imports.
    pub(crate) fn release(&self, imports: &mut Imports) {
        for (id, _) in &self.imports {
            imports.clear(*id);
        }
    }

    /// After a step.
    pub(crate) fn after(&mut self, output: &VehicleOutput) {
        self.input[0] = output.time_s;
        for (place, id) in self.input[2..].iter_mut().zip(&self.reads) {
            *place = Exports::get(*id, output);
        }
        let own = 2 + self.reads.len();
        for (k, place) in self.input[own..].iter_mut().enumerate() {
            *place = self.changed[k] * self.scale[k];
        }
        let count = self.output.len();
        self.after.run(&self.input, &mut self.scratch[..count]);
        for (kept, new) in self.output.iter_mut().zip(&self.scratch) {
            if new.is_finite() {
                *kept = *new;
            } else {
                self.faults += 1;
            }
        }
    }

    /// Outputs: name, unit, description.
    #[must_use]
    pub fn outputs(&self) -> &[UserOutput] {
        &self.outputs
    }

    /// Their values at the end of the last step, each in its unit.
    #[must_use]
    pub fn values(&self) -> &[f64] {
        &self.output
    }

    /// Results that were not finite, since reset.
    #[must_use]
    pub fn faults(&self) -> u64 {
        self.faults
    }

    pub(crate) fn state_len(&self) -> usize {
        self.input.len() + self.changed.len() + self.output.len() + 1
    }

    fn state(&mut self) -> impl Iterator<Item = &mut f64> {
        self.input.iter_mut().chain(&mut self.changed).chain(&mut self.output)
    }

    pub(crate) fn save_state(&self, to: &mut [f64]) {
        let all = self.input.iter().chain(&self.changed).chain(&self.output);
        for (slot, value) in to.iter_mut().zip(all.copied().chain([self.faults as f64])) {
            *slot = value;
        }
    }

    pub(crate) fn load_state(&mut self, from: &[f64]) {
        self.faults = from.get(self.state_len() - 1).map_or(0, |faults| *faults as u64);
        for (value, saved) in self.state().zip(from) {
            *value = *saved;
        }
    }
}

/// `; did you mean 'x'?`, if anything is near.
fn closest<'a>(name: &str, names: impl Iterator<Item = &'a str>) -> String {
    functional_model::closest(name, names).map(|near| format!("; did you mean `{near}`?")).unwrap_or_default()
}

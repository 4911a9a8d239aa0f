//! The two things a user holds: a model file that has been read and checked, and the system composed from it.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::rc::Rc;

use crate::Resolver;
use crate::couplings::Fault;
use crate::document::{self, Raw};
use crate::error::{ModelError, Place, Rule};
use crate::flat::Flat;
use crate::flatten::flatten;
use crate::kernel::{Kernel, Newton};
use crate::node;
use crate::reduce::{Dae, reduce};

/// A checked model.
pub struct Model {
    raw: Rc<Raw>,
    name: String,
    /// Every file the resolver gave, so that composing needs it no more.
    files: BTreeMap<String, Result<String, String>>,
}

/// Values that replace parameters of the file, by full name (`MC`, `car.N`), as expressions with units
/// (`"2.5 kg"`, `"[900 N*s/m, 1500 N*s/m]"`). Units are checked against the file's.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Parameters {
    values: Vec<(String, String)>,
}

impl Parameters {
    /// Nothing replaced.
    pub fn new() -> Parameters {
        Parameters::default()
    }

    /// Replaces one parameter; a later value for the same name wins.
    #[must_use]
    pub fn with(mut self, name: &str, value: &str) -> Parameters {
        self.set(name, value);
        self
    }

    /// Replaces one parameter in place.
    pub fn set(&mut self, name: &str, value: &str) {
        self.values.retain(|v| v.0 != name);
        self.values.push((name.into(), value.into()));
    }
}

/// A parameter as composed.
#[derive(Debug, Clone, PartialEq)]
pub struct ParameterInfo {
    /// Full name, with `.x`, `.y`, `.z` for components.
    pub name: String,
    /// SI unit.
    pub unit: String,
    /// Value in SI.
    pub value: f64,
}

impl Model {
    /// Reads and checks a model: syntax, names, units, sizes, ports, frames. `name` is how errors call the text;
    /// `resolver` gives the text of files it uses (other models, tables); library blocks need no resolver.
    ///
    /// # Errors
    /// Every mistake found, in the order of the file.
    pub fn from_toml(text: &str, name: &str, resolver: &Resolver) -> Result<Model, Vec<ModelError>> {
        let file: Rc<str> = name.into();
        let raw = Rc::new(document::read(&node::read(text, &file)?)?);
        let files = RefCell::new(BTreeMap::new());
        let caching = |wanted: &str| -> Result<String, String> {
            files.borrow_mut().entry(wanted.to_string()).or_insert_with(|| resolver(wanted)).clone()
        };
        let _ = flatten(&raw, &caching, &[], Fault::None)?;
        Ok(Model { raw, name: name.into(), files: files.into_inner() })
    }

    /// Name given in the file, otherwise the name of the text.
    pub fn name(&self) -> &str {
        self.raw.name.as_deref().unwrap_or(&self.name)
    }

    /// What the file says it is about.
    pub fn about(&self) -> Option<&str> {
        self.raw.about.as_deref()
    }

    /// Composes the system at these parameters.
    ///
    /// # Errors
    /// Unknown parameters, wrong units, start values that contradict a rigid join, loops without a solution,
    /// storages that cannot be reduced.
    pub fn compose(&self, parameters: &Parameters) -> Result<System, Vec<ModelError>> {
        self.compose_with(parameters, Fault::None)
    }

    /// Composes with Phi in place of its transpose wherever a square frame change gives through quantities. Only to
    /// show that the power residual and the energy account catch such a mistake.
    ///
    /// # Errors
    /// As [`Model::compose`].
    #[doc(hidden)]
    pub fn compose_with_planted_mistake(&self, parameters: &Parameters) -> Result<System, Vec<ModelError>> {
        self.compose_with(parameters, Fault::Transposed)
    }

    fn compose_with(&self, parameters: &Parameters, fault: Fault) -> Result<System, Vec<ModelError>> {
        let cached = |wanted: &str| -> Result<String, String> {
            self.files
                .get(wanted)
                .cloned()
                .unwrap_or_else(|| Err(format!("'{wanted}' was not read with the model")))
        };
        let flat = flatten(&self.raw, &cached, &parameters.values, fault)?;
        System::new(flat, self.name.clone())
    }
}

/// A composed system: reduced, with causality derived.
pub struct System {
    pub(crate) flat: RefCell<Flat>,
    pub(crate) dae: Dae,
    pub(crate) kernel: Kernel,
    pub(crate) file: String,
}

impl System {
    fn new(mut flat: Flat, file: String) -> Result<System, Vec<ModelError>> {
        let dae = reduce(&mut flat)?;
        let kernel = Kernel::build(&mut flat, &dae);
        let system = System { flat: RefCell::new(flat), dae, kernel, file };
        system.solvable()?;
        Ok(system)
    }

    /// Known quantities at the start: start values, inputs zero.
    pub(crate) fn start_known(&self) -> Vec<f64> {
        let flat = self.flat.borrow();
        let value = |v: &u32| flat.variables[*v as usize].start.unwrap_or(0.0);
        let mut known: Vec<f64> = self.kernel.states.iter().map(value).collect();
        known.extend(self.kernel.inputs.iter().map(|_| 0.0));
        known.extend(self.kernel.sampled.iter().map(value));
        known.extend([0.0, 1.0]);
        known
    }

    /// First guess of the core unknowns.
    pub(crate) fn start_core(&self) -> Vec<f64> {
        let flat = self.flat.borrow();
        self.kernel
            .core
            .iter()
            .map(|c| match crate::reduce::of_column(*c) {
                Some((v, false)) => flat.variables[v as usize].start.unwrap_or(0.0),
                _ => 0.0,
            })
            .collect()
    }

    /// The core must have a solution at the start.
    fn solvable(&self) -> Result<(), Vec<ModelError>> {
        let mut newton = Newton::new(&self.kernel);
        let mut core = self.start_core();
        let solve = newton.solve(
            &self.kernel,
            &self.kernel.args,
            &self.kernel.equations,
            &self.start_known(),
            &mut core,
            self.kernel.affine_in_core,
        );
        if solve.converged {
            return Ok(());
        }
        let flat = self.flat.borrow();
        let mut labels: Vec<String> = Vec::new();
        for e in &self.dae.nonlinear {
            let label = flat.equations[self.dae.equations[*e].origin].label.clone();
            if !labels.contains(&label) {
                labels.push(label);
            }
        }
        labels.truncate(8);
        let place =
            self.dae.nonlinear.first().map_or(Place { file: self.file.as_str().into(), line: 0 }, |e| {
                flat.equations[self.dae.equations[*e].origin].place.clone()
            });
        Err(vec![place.error(
            Rule::SingularLoop,
            labels.join("; "),
            "this loop of equations has no unique solution at the start values",
        )])
    }

    /// Names of the states that remain, in the order of the matrices.
    pub fn state_names(&self) -> Vec<String> {
        let flat = self.flat.borrow();
        self.kernel.states.iter().map(|v| flat.variables[*v as usize].name.clone()).collect()
    }

    /// Start values of the states, SI, in the order of [`System::state_names`].
    pub fn start_values(&self) -> Vec<f64> {
        self.start_known()[..self.kernel.states.len()].to_vec()
    }

    /// Start values of the sampled variables, SI, in the order of [`System::sampled_names`].
    pub fn sampled_start_values(&self) -> Vec<f64> {
        let at = self.kernel.states.len() + self.kernel.inputs.len();
        self.start_known()[at..at + self.kernel.sampled.len()].to_vec()
    }

    /// SI units of the states.
    pub fn state_units(&self) -> Vec<String> {
        let flat = self.flat.borrow();
        self.kernel.states.iter().map(|v| flat.variables[*v as usize].unit.to_string()).collect()
    }

    /// Names of the inputs: signals, then what open ports take (`outside.fF.x`).
    pub fn input_names(&self) -> Vec<String> {
        let flat = self.flat.borrow();
        self.kernel.inputs.iter().map(|v| flat.variables[*v as usize].name.clone()).collect()
    }

    /// SI units of the inputs.
    pub fn input_units(&self) -> Vec<String> {
        let flat = self.flat.borrow();
        self.kernel.inputs.iter().map(|v| flat.variables[*v as usize].unit.to_string()).collect()
    }

    /// Names of the outputs: what open ports give, then observations.
    pub fn output_names(&self) -> Vec<String> {
        self.outputs().into_iter().map(|o| o.0).collect()
    }

    /// SI units of the outputs.
    pub fn output_units(&self) -> Vec<String> {
        self.outputs().into_iter().map(|o| o.2).collect()
    }

    /// name, expression, unit
    pub(crate) fn outputs(&self) -> Vec<(String, u32, String)> {
        let mut flat = self.flat.borrow_mut();
        let flat = &mut *flat;
        let mut outputs = Vec::new();
        for v in flat.outputs.clone() {
            let id = flat.pool.variable(v as usize);
            let variable = &flat.variables[v as usize];
            outputs.push((variable.name.clone(), id, variable.unit.to_string()));
        }
        for o in &flat.observations {
            outputs.push((o.name.clone(), o.part, o.unit.to_string()));
        }
        outputs
    }

    /// All parameters with their values.
    pub fn parameters(&self) -> Vec<ParameterInfo> {
        self.flat
            .borrow()
            .parameters
            .iter()
            .map(|p| ParameterInfo { name: p.name.clone(), unit: p.unit.to_string(), value: p.value })
            .collect()
    }

    /// States that a rigid join made dependent on others.
    pub fn dependent_states(&self) -> Vec<String> {
        let flat = self.flat.borrow();
        self.dae.dependent.iter().map(|d| flat.variables[d.0 as usize].name.clone()).collect()
    }

    /// Sampling time of mechanisms, s.
    pub fn sample_s(&self) -> Option<f64> {
        self.flat.borrow().sample
    }

    /// Whether the equations are linear, with constant coefficients between two samples.
    pub fn is_linear_between_samples(&self) -> bool {
        self.kernel.linear_between_samples
    }
}

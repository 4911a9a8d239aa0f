//! Tyres, suspensions and functional models, evaluated on their own.

use crate::{fault, numbers_in, numbers_out};
use config::axle::Axle;
use config::{Kind, ModelFiles};
use functional_model::{CompileOptions, Compiled, Model, ModelError, Parameters};
use multibody::methods::{Alignment, Over, curve};
use multibody::{Suspension, SuspensionInput, SuspensionOutput};
use pyo3::prelude::*;
use pyo3::pybacked::PyBackedBytes;
use pyo3::types::{PyByteArray, PyDict};
use spatial::Vector3;
use std::path::Path;
use tyre::{Tyre, UseMode};

pub(crate) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(evaluate_tyre, module)?)?;
    module.add_class::<NativeSuspension>()?;
    module.add_class::<NativeModel>()
}

fn lines(errors: &[ModelError]) -> String {
    errors.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n")
}

/// A table of contacts as CSV text, evaluated as `kingpin tyre evaluate` does; the results as CSV text.
#[pyfunction]
fn evaluate_tyre(py: Python<'_>, reference: &str, table: &str, use_mode: u32) -> PyResult<String> {
    let mode = UseMode::from_number(use_mode);
    let mode = mode
        .ok_or_else(|| fault::of_text(py, &format!("use_mode = {use_mode}: must be 211, 221, 212 or 222")))?;
    let file = config::load::reference_text(reference, Kind::Tyre)
        .map_err(|problems| fault::of_problems(py, &problems))?;
    let tyre = Tyre::from_text(&file.text, &file.name).map_err(|faults| {
        let all: Vec<String> = faults.iter().map(ToString::to_string).collect();
        fault::of_text(py, &all.join("\n"))
    })?;
    let done = py.detach(|| tyre::evaluate_csv(&tyre, table, "contacts", mode));
    Ok(done.map_err(|problems| fault::of_problems(py, &problems))?.text)
}

/// An axle's solver.
#[pyclass(module = "kingpin._native")]
struct NativeSuspension {
    axle: Axle,
    solver: Suspension,
}

type Reader = fn(&SuspensionOutput) -> f64;

/// Columns that are told of a pose.
const COLUMNS: [(&str, Reader); 20] = [
    ("tie_rod_force_n.left", |o| o.side[0].tie_rod_force_n),
    ("tie_rod_force_n.right", |o| o.side[1].tie_rod_force_n),
    ("rack_force_n", |o| o.rack_force_n),
    ("steer_rad.left", |o| o.side[0].steer_rad),
    ("steer_rad.right", |o| o.side[1].steer_rad),
    ("toe_rad.left", |o| o.side[0].toe_rad),
    ("toe_rad.right", |o| o.side[1].toe_rad),
    ("camber_rad.left", |o| o.side[0].camber_rad),
    ("camber_rad.right", |o| o.side[1].camber_rad),
    ("caster_rad.left", |o| o.side[0].caster_rad),
    ("caster_rad.right", |o| o.side[1].caster_rad),
    ("kingpin_inclination_rad.left", |o| o.side[0].kingpin_inclination_rad),
    ("kingpin_inclination_rad.right", |o| o.side[1].kingpin_inclination_rad),
    ("kingpin_moment_n_m.left", |o| o.side[0].kingpin_moment_n_m),
    ("kingpin_moment_n_m.right", |o| o.side[1].kingpin_moment_n_m),
    ("tie_rod_ball_z_m.left", |o| o.side[0].tie_rod_ball_m.z),
    ("tie_rod_ball_z_m.right", |o| o.side[1].tie_rod_ball_m.z),
    ("spring_force_n.left", |o| o.side[0].spring_force_n),
    ("spring_force_n.right", |o| o.side[1].spring_force_n),
    ("status", |o| f64::from(o.status.code())),
];

#[pymethods]
impl NativeSuspension {
    #[new]
    fn new(py: Python<'_>, reference: &str, overrides: Vec<String>) -> PyResult<Self> {
        let json = Path::new(reference).extension().is_some_and(|e| e.eq_ignore_ascii_case("json"));
        if json && !overrides.is_empty() {
            return Err(fault::of_text(py, "overrides: cannot be laid over a hardpoint .json file"));
        }
        let axle = config::load_with::<Axle>(reference, &overrides)
            .map_err(|problems| fault::of_problems(py, &problems))?
            .value;
        let solver =
            Suspension::new(&axle).map_err(|error| fault::of_text(py, &format!("{reference}: {error}")))?;
        Ok(NativeSuspension { axle, solver })
    }

    /// Its name.
    #[getter]
    fn name(&self) -> String {
        self.axle.name.clone()
    }

    /// Poses and forces, one row behind the other: rack, two heights, two forces and two moments of three.
    fn solve<'py>(&mut self, py: Python<'py>, inputs: Vec<PyBackedBytes>) -> PyResult<Bound<'py, PyDict>> {
        let inputs: Vec<Vec<f64>> = inputs.iter().map(|bytes| numbers_in(bytes)).collect();
        let rows = inputs.first().map_or(0, Vec::len);
        if inputs.len() != 15 || inputs.iter().any(|column| column.len() != rows) {
            return Err(fault::value("15 columns of one length are needed"));
        }
        let mut outputs = vec![Vec::with_capacity(rows); COLUMNS.len()];
        py.detach(|| {
            for row in 0..rows {
                let at = |column: usize| inputs[column][row];
                let vector = |column: usize| Vector3::new(at(column), at(column + 1), at(column + 2));
                let input = SuspensionInput {
                    rack_m: at(0),
                    wheel_height_m: [at(1), at(2)],
                    wheel_force_n: [vector(3), vector(6)],
                    wheel_moment_n_m: [vector(9), vector(12)],
                    ..SuspensionInput::DESIGN
                };
                let mut output = SuspensionOutput::default();
                self.solver.step(&input, &mut output);
                for (values, (_, read)) in outputs.iter_mut().zip(COLUMNS) {
                    values.push(read(&output));
                }
            }
        });
        let dict = PyDict::new(py);
        for ((name, _), values) in COLUMNS.iter().zip(&outputs) {
            dict.set_item(*name, numbers_out(py, values))?;
        }
        Ok(dict)
    }

    /// Alignment of both sides over rack displacement or wheel travel, as far as the mechanism reaches.
    fn curve<'py>(&self, py: Python<'py>, over: &str, places_m: &[u8]) -> PyResult<Bound<'py, PyDict>> {
        let over = match over {
            "rack" => Over::Rack,
            "travel" => Over::Travel,
            other => return Err(fault::of_text(py, &format!("over = {other}: must be rack or travel"))),
        };
        let places_m = numbers_in(places_m);
        let found = py.detach(|| curve(&self.axle, over, &places_m)).map_err(fault::broken)?;
        let dict = PyDict::new(py);
        let at: Vec<f64> = found.points.iter().map(|point| point.at_m).collect();
        dict.set_item("at_m", numbers_out(py, &at))?;
        for (k, side) in ["left", "right"].iter().enumerate() {
            for (c, name) in Alignment::NAMES.iter().enumerate() {
                let values: Vec<f64> = found.points.iter().map(|point| point.side[k].to_array()[c]).collect();
                dict.set_item(format!("{name}.{side}"), numbers_out(py, &values))?;
            }
        }
        Ok(dict)
    }
}

/// A functional model.
#[pyclass(module = "kingpin._native")]
struct NativeModel {
    compiled: Compiled,
    /// Its name.
    #[pyo3(get)]
    name: String,
    /// Inputs and their units.
    #[pyo3(get)]
    inputs: Vec<(String, String)>,
    /// Outputs and their units.
    #[pyo3(get)]
    outputs: Vec<(String, String)>,
    /// States and their units.
    #[pyo3(get)]
    states: Vec<(String, String)>,
    /// Parameters: name, value in SI, unit.
    #[pyo3(get)]
    parameters: Vec<(String, f64, String)>,
}

#[pymethods]
impl NativeModel {
    #[new]
    fn new(py: Python<'_>, reference: &str, parameters: Vec<(String, String)>) -> PyResult<Self> {
        let files = ModelFiles::load(reference).map_err(|problems| fault::of_problems(py, &problems))?;
        let mut given = Parameters::new();
        for (name, value) in &parameters {
            given.set(name, value);
        }
        let wrong = |errors: Vec<ModelError>| fault::of_text(py, &lines(&errors));
        let model =
            Model::from_toml(&files.main.text, &files.main.name, &|name| files.part(name)).map_err(wrong)?;
        let system = model.compose(&given).map_err(wrong)?;
        let compiled = system.compile(CompileOptions::default()).map_err(wrong)?;
        let with = |names: Vec<String>, units: Vec<String>| names.into_iter().zip(units).collect();
        Ok(NativeModel {
            compiled,
            name: model.name().to_owned(),
            inputs: with(system.input_names(), system.input_units()),
            outputs: with(system.output_names(), system.output_units()),
            states: with(system.state_names(), system.state_units()),
            parameters: system.parameters().into_iter().map(|p| (p.name, p.value, p.unit)).collect(),
        })
    }

    /// Starts again from the model's start, or from given states, and steps through the inputs: one array an input, held
    /// over each step. Outputs after each step by name, then `faults`: steps that did not converge or held a state.
    fn simulate<'py>(
        &mut self,
        py: Python<'py>,
        inputs: Vec<PyBackedBytes>,
        steps: usize,
        step_s: f64,
        start: Vec<(String, f64)>,
    ) -> PyResult<(Vec<Bound<'py, PyByteArray>>, u64)> {
        if !(step_s > 0.0 && step_s.is_finite()) {
            return Err(fault::value(format!("step_s = {step_s}: must be above 0")));
        }
        let inputs: Vec<Vec<f64>> = inputs.iter().map(|bytes| numbers_in(bytes)).collect();
        let names: Vec<&str> = self.states.iter().map(|(name, _)| name.as_str()).collect();
        self.compiled.reset();
        let mut states = self.compiled.states().to_vec();
        for (name, value) in &start {
            match names.iter().position(|known| known == name) {
                Some(place) => states[place] = *value,
                None => {
                    return Err(fault::value(format!(
                        "start: no state {name}; there are {}",
                        names.join(", ")
                    )));
                }
            }
        }
        if !start.is_empty() {
            self.compiled.set_states(&states);
        }
        if inputs.len() != self.inputs.len() || inputs.iter().any(|column| column.len() != steps) {
            return Err(fault::value("as many inputs as the model has are needed, all of one length"));
        }
        let mut outputs = vec![Vec::with_capacity(steps); self.outputs.len()];
        let mut faults = 0;
        let mut raised = None;
        py.detach(|| {
            let mut row = vec![0.0; inputs.len()];
            for step in 0..steps {
                if step.is_multiple_of(65_536) && crate::log::signalled(&mut raised).is_err() {
                    return;
                }
                for (value, column) in row.iter_mut().zip(&inputs) {
                    *value = column[step];
                }
                let status = self.compiled.step(&row, step_s);
                faults += u64::from(status.not_converged || status.state_held);
                for (values, value) in outputs.iter_mut().zip(self.compiled.outputs()) {
                    values.push(*value);
                }
            }
        });
        match raised {
            Some(error) => Err(error),
            None => Ok((outputs.iter().map(|values| numbers_out(py, values)).collect(), faults)),
        }
    }
}

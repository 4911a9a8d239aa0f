//! Names to handles: which variables of an FMU are set and read in a step, and in which units.

use crate::archive::Fmu;
use crate::description::{Causality, Description, Kind, Variable, Version};
use crate::units::{Conversion, Unit};
use crate::{FmuError, description};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A value of a start value or parameter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Value {
    /// A number, in the FMU's own unit; for a Boolean 0 or 1.
    Number(f64),
    /// A text.
    Text(String),
}

/// One variable that is set or read in each step.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Port {
    /// Handle.
    pub reference: u32,
    /// Type.
    pub kind: Kind,
    /// Input: from the bench's unit to the FMU's. Output: the other way.
    pub conversion: Conversion,
}

/// A variable to be joined with a value of the bench.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wanted<'a> {
    /// Name in the FMU.
    pub name: &'a str,
    /// Unit of the value at the bench's end; `SI` where that is left to the FMU.
    pub unit: &'a str,
}

/// Everything that is needed to run an instance, away from the file and the description.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Setup {
    /// Name of the instance.
    pub name: String,
    /// Version of the interface.
    pub version: Version,
    /// `guid` or `instantiationToken`.
    pub token: String,
    /// Folder that the FMU was unpacked to.
    pub folder: PathBuf,
    /// The binary, below it.
    pub binary: String,
    /// Start values and parameters.
    pub start: Vec<(u32, Kind, Value)>,
    /// Set before each step.
    pub inputs: Vec<Port>,
    /// Read behind each step.
    pub outputs: Vec<Port>,
    /// Time at which it begins. [s]
    pub start_s: f64,
    /// An interpreter to load first, for FMUs that run Python.
    pub interpreter: Option<PathBuf>,
}

/// What is joined with what.
#[derive(Debug, Clone, Copy, Default)]
pub struct Joints<'a> {
    /// Inputs of the FMU.
    pub inputs: &'a [Wanted<'a>],
    /// Outputs of the FMU.
    pub outputs: &'a [Wanted<'a>],
    /// Parameters: causality parameter, not constant.
    pub parameters: &'a [(&'a str, Value)],
    /// Start values of other variables.
    pub start: &'a [(&'a str, Value)],
    /// Units of variables for which the FMU states none.
    pub units: Option<&'a BTreeMap<String, String>>,
}

impl Setup {
    /// Resolves names, types and units.
    ///
    /// # Errors
    /// Everything that is wrong, at once.
    pub fn new(fmu: &Fmu, name: &str, folder: &Path, joints: &Joints<'_>) -> Result<Self, Vec<FmuError>> {
        let description = &fmu.description;
        let mut faults = Vec::new();
        let mut keep = |found: Result<Port, FmuError>| found.map_err(|fault| faults.push(fault)).ok();
        let inputs = joints.inputs.iter().filter_map(|w| keep(port(description, joints, w, true))).collect();
        let outputs =
            joints.outputs.iter().filter_map(|w| keep(port(description, joints, w, false))).collect();
        let mut start = Vec::new();
        for (name, value) in joints.parameters {
            match started(description, name, value, true) {
                Ok(found) => start.push(found),
                Err(fault) => faults.push(fault),
            }
        }
        for (name, value) in joints.start {
            match started(description, name, value, false) {
                Ok(found) => start.push(found),
                Err(fault) => faults.push(fault),
            }
        }
        for name in joints.units.into_iter().flat_map(|units| units.keys()) {
            let stated = description.variable(name).map(|variable| variable.unit.clone());
            match stated {
                Err(fault) => faults.push(fault),
                Ok(Some(unit)) if description.unit(&unit).is_some() => faults.push(FmuError::Value {
                    name: name.clone(),
                    rule: format!("the FMU itself states its unit ({unit}): take it out of units"),
                }),
                Ok(_) => {}
            }
        }
        let binary = fmu.binary().map_err(|fault| faults.push(fault)).ok();
        match binary {
            Some(binary) if faults.is_empty() => Ok(Setup {
                name: name.to_owned(),
                version: description.version,
                token: description.token.clone(),
                folder: folder.to_owned(),
                binary,
                start,
                inputs,
                outputs,
                start_s: 0.0,
                interpreter: None,
            }),
            _ => Err(faults),
        }
    }
}

fn kind_name(variable: &Variable) -> String {
    if variable.array { "an array".to_owned() } else { format!("{:?}", variable.kind) }
}

fn port(d: &Description, joints: &Joints<'_>, wanted: &Wanted<'_>, input: bool) -> Result<Port, FmuError> {
    let variable = d.variable(wanted.name)?;
    let name = || wanted.name.to_owned();
    let (fits, rule) = if input {
        (variable.causality == Causality::Input, "input")
    } else {
        // Whatever changes can be read; the usual case is an output.
        (matches!(variable.causality, Causality::Output | Causality::Local), "output or local")
    };
    if !fits {
        return Err(FmuError::Causality {
            name: name(),
            is: variable.causality.name().to_owned(),
            wanted: rule,
        });
    }
    if !variable.kind.numeric() || variable.array {
        return Err(FmuError::Kind {
            name: name(),
            is: kind_name(variable),
            wanted: "a single number".into(),
        });
    }
    Ok(Port {
        reference: variable.reference,
        kind: variable.kind,
        conversion: conversion(d, joints, wanted, variable, input)?,
    })
}

fn conversion(
    d: &Description,
    joints: &Joints<'_>,
    wanted: &Wanted<'_>,
    variable: &Variable,
    input: bool,
) -> Result<Conversion, FmuError> {
    let name = || wanted.name.to_owned();
    let said = joints.units.and_then(|units| units.get(wanted.name));
    let of_name = |unit: &str| {
        d.unit(unit).ok_or_else(|| FmuError::UnitUnknown { name: name(), unit: unit.to_owned() })
    };
    let (text, own) = match (said, &variable.unit) {
        (Some(text), _) => {
            let unit = Unit::parse(text);
            let unknown = || FmuError::UnitUnknown { name: name(), unit: text.clone() };
            (text.clone(), unit.ok_or_else(unknown)?)
        }
        (None, Some(text)) => (text.clone(), of_name(text)?),
        (None, None) if matches!(wanted.unit, "1" | "SI") => return Ok(Conversion::NONE),
        (None, None) => {
            return Err(FmuError::UnitMissing { name: name(), other: wanted.unit.to_owned() });
        }
    };
    let bench = match wanted.unit {
        "SI" => Unit { factor: 1.0, offset: 0.0, ..own },
        unit => {
            Unit::parse(unit).ok_or_else(|| FmuError::UnitUnknown { name: name(), unit: unit.to_owned() })?
        }
    };
    let (source, target) = if input { (bench, own) } else { (own, bench) };
    Conversion::between(&source, &target).ok_or_else(|| FmuError::UnitMismatch {
        name: name(),
        unit: text,
        other: wanted.unit.to_owned(),
    })
}

fn started(
    d: &Description,
    name: &str,
    value: &Value,
    parameter: bool,
) -> Result<(u32, Kind, Value), FmuError> {
    let variable = d.variable(name)?;
    let is = || format!("{} ({})", variable.causality.name(), variable.variability);
    let rule = |rule: String| FmuError::Value { name: name.to_owned(), rule };
    let settable = match variable.causality {
        Causality::Parameter => parameter,
        Causality::Input => !parameter,
        Causality::Output | Causality::Local => {
            !parameter && matches!(variable.initial.as_deref(), Some("exact" | "approx"))
        }
        _ => false,
    } && variable.variability != "constant";
    if !settable {
        let wanted =
            if parameter { "a parameter" } else { "an input, or of a variable with initial exact or approx" };
        return Err(FmuError::Causality { name: name.to_owned(), is: is(), wanted });
    }
    match (variable.kind, value) {
        _ if variable.array => Err(FmuError::Kind {
            name: name.to_owned(),
            is: "an array".into(),
            wanted: "a single value".into(),
        }),
        (Kind::String, Value::Text(_)) => Ok((variable.reference, Kind::String, value.clone())),
        (Kind::String | Kind::Binary | Kind::Clock, _) | (_, Value::Text(_)) => {
            let wanted = if matches!(value, Value::Text(_)) { "a text" } else { "a number" };
            let is = kind_name(variable);
            Err(FmuError::Kind { name: name.to_owned(), is, wanted: format!("{wanted}, as the value given") })
        }
        (kind, Value::Number(number)) => {
            let whole = !matches!(kind, Kind::Float64 | Kind::Float32);
            if !number.is_finite() || (whole && number.fract() != 0.0) {
                return Err(rule(format!("{number} is no {kind:?}")));
            }
            let low = variable.min.unwrap_or(f64::NEG_INFINITY);
            let high = variable.max.unwrap_or(f64::INFINITY);
            if !(low..=high).contains(number) {
                return Err(rule(format!("{number} must be in [{low}, {high}], says the FMU")));
            }
            Ok((variable.reference, kind, value.clone()))
        }
    }
}

/// Whether steps of a length suit the FMU.
///
/// # Errors
/// [`FmuError::Step`].
pub fn check_step(d: &description::Description, step_s: f64) -> Result<(), FmuError> {
    if let Some(fixed) = d.fixed_step_s.filter(|fixed| *fixed > 0.0) {
        let times = step_s / fixed;
        if times < 0.5 || (times - times.round()).abs() > 1e-6 * times {
            let rule = format!("{step_s} s is no multiple of the FMU's fixedInternalStepSize, {fixed} s");
            return Err(FmuError::Step { rule });
        }
    }
    Ok(())
}

//! `modelDescription.xml` of our FMUs (FMI 2.0 §2.2).

use crate::model::{Role, Type, Variable};
use std::fmt::Write as _;

/// Name of the C library in the archive, without its ending.
pub const IDENTIFIER: &str = "kingpin_fmu";

/// Units with their exponents.
const UNITS: [(&str, &str); 8] = [
    ("m", "m=\"1\""),
    ("m/s", "m=\"1\" s=\"-1\""),
    ("m/s2", "m=\"1\" s=\"-2\""),
    ("rad", "rad=\"1\""),
    ("rad/s", "rad=\"1\" s=\"-1\""),
    ("N", "kg=\"1\" m=\"1\" s=\"-2\""),
    ("N.m", "kg=\"1\" m=\"2\" s=\"-2\""),
    ("Pa", "kg=\"1\" m=\"-1\" s=\"-2\""),
];

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;")
}

/// The description. `guid` must be that of the resource file: the library compares them.
#[must_use]
pub fn description(name: &str, text: &str, guid: &str, step_s: f64, variables: &[Variable]) -> String {
    let mut list = String::new();
    let mut outputs = String::new();
    for (k, v) in variables.iter().enumerate() {
        let (causality, variability, initial) = match (v.role, v.kind) {
            (Role::Parameter, _) => ("parameter", "fixed", "exact"),
            (Role::Input, Type::Real) => ("input", "continuous", ""),
            (Role::Input, _) => ("input", "discrete", ""),
            (Role::Output, Type::Real) => ("output", "continuous", "calculated"),
            (Role::Output, _) => ("output", "discrete", "calculated"),
        };
        let initial = if initial.is_empty() { String::new() } else { format!(" initial=\"{initial}\"") };
        let start = match (v.role, v.kind) {
            (Role::Output, _) => String::new(),
            (_, Type::Boolean) => format!(" start=\"{}\"", v.start != 0.0),
            _ => format!(" start=\"{}\"", v.start),
        };
        let unit = match (v.unit, v.kind) {
            ("1", _) | (_, Type::Integer | Type::Boolean) => String::new(),
            (unit, _) => format!(" unit=\"{unit}\""),
        };
        let _ = write!(
            list,
            "\n    <ScalarVariable name=\"{}\" valueReference=\"{k}\" causality=\"{causality}\" \
             variability=\"{variability}\"{initial} description=\"{}\"><{:?}{unit}{start}/></ScalarVariable>",
            escaped(&v.name),
            escaped(&v.description),
            v.kind,
        );
        if v.role == Role::Output {
            let _ = write!(outputs, "<Unknown index=\"{}\"/>", k + 1);
        }
    }
    let used = UNITS.iter().filter(|(unit, _)| variables.iter().any(|v| v.unit == *unit));
    let units: String =
        used.map(|(unit, base)| format!("\n    <Unit name=\"{unit}\"><BaseUnit {base}/></Unit>")).collect();
    format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<fmiModelDescription fmiVersion=\"2.0\" modelName=\"{}\" \
         guid=\"{guid}\" description=\"{}\" generationTool=\"Kingpin {}\" variableNamingConvention=\"flat\">\n  \
         <CoSimulation modelIdentifier=\"{IDENTIFIER}\" canHandleVariableCommunicationStepSize=\"true\" \
         canBeInstantiatedOnlyOncePerProcess=\"false\"/>\n  <UnitDefinitions>{units}\n  </UnitDefinitions>\n  \
         <DefaultExperiment startTime=\"0\" stopTime=\"10\" stepSize=\"{step_s}\"/>\n  <ModelVariables>{list}\n  \
         </ModelVariables>\n  <ModelStructure><Outputs>{outputs}</Outputs><InitialUnknowns>{outputs}\
         </InitialUnknowns></ModelStructure>\n</fmiModelDescription>\n",
        escaped(name),
        escaped(text),
        env!("CARGO_PKG_VERSION"),
    )
}

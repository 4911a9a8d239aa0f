//! FMUs in the loop: users' own models as functional mock-up units (FMI 2.0 or 3.0, co-simulation).
//!
//! At tick n an FMU takes what the regions say of tick n (for the car: at t_n+1), steps from t_n to t_n+1, and what it
//! puts out acts on the car in its step n+1. Names, types and units are checked against the FMU by crate `assembly`.

use crate::check::Checker;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Most FMUs of a scenario.
pub const FMUS_MAX: usize = 4;
/// Most inputs of one.
pub const INPUTS_MAX: usize = 32;
/// Most outputs of one that act on the car.
pub const OUTPUTS_MAX: usize = 16;
/// Most exports of the car that all FMUs of a scenario read.
pub const EXPORTS_MAX: usize = 16;

/// One FMU in the loop.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FmuRun {
    /// Name in messages and reports. Letters, digits, `_` and `-`, 1 to 40 of them.
    #[schemars(length(min = 1, max = 40))]
    pub name: String,
    /// The FMU: a path beside this file.
    pub file: String,
    /// What its inputs are set to: `region.field` as in `kingpin list regions` (`vehicle_state.yaw_rad`), or
    /// `vehicle.NAME` for an export of the car (`kingpin vehicle variables`).
    pub inputs: BTreeMap<String, String>,
    /// What its outputs act on.
    pub outputs: BTreeMap<String, FmuOutput>,
    /// Its parameters, in its own units; those not named keep what the FMU says.
    pub parameters: Option<BTreeMap<String, FmuValue>>,
    /// Start values of its other variables, in its own units.
    pub start: Option<BTreeMap<String, FmuValue>>,
    /// Units of variables for which the FMU states none.
    pub units: Option<BTreeMap<String, String>>,
    /// The FMU steps once in so many ticks. [ticks], [1, 1000]
    #[schemars(range(min = 1, max = 1000))]
    pub every_ticks: u32,
    /// Longest time a step may take in real time; what a later one puts out is not used. [s], (0, 1]
    #[schemars(extend("exclusiveMinimum" = 0.0), range(max = 1.0))]
    pub budget_s: f64,
    /// A step that takes longer than this ends the FMU's process, which is then started again. [s], [0.01, 60]
    #[schemars(range(min = 0.01, max = 60.0))]
    pub hang_s: f64,
    /// What becomes of the bench when the FMU is lost for longer than the rig's `stale_ticks`.
    pub on_loss: FmuLoss,
    /// Core of its process; absent: wherever the kernel puts it. [0, 1023]
    #[schemars(range(max = 1023))]
    pub core: Option<u16>,
}

/// What an output of an FMU does to a variable of the car.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FmuOutput {
    /// Variable of the car that can be imported (`kingpin vehicle variables`).
    pub to: String,
    /// What is done to it.
    pub mode: crate::equations::ImportMode,
    /// Smaller values are raised to this, and flagged; absent: none are. In the variable's unit.
    pub min: Option<f64>,
    /// Greater values are lowered to this, and flagged; absent: none are. In the variable's unit.
    pub max: Option<f64>,
}

/// A value of a parameter or start value.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum FmuValue {
    /// Of a Boolean.
    Truth(bool),
    /// Of any other number.
    Number(f64),
    /// Of a text.
    Text(String),
}

/// What becomes of the bench when an FMU is lost.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum FmuLoss {
    /// The car counts as lost too: the rig holds, forces ramp down, until the FMU is back.
    Hold,
    /// The car goes on without the FMU, flagged.
    Release,
}

/// An FMU with its file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ResolvedFmu {
    /// Where the file lies.
    pub path: String,
    /// SHA-256 of the file, in hexadecimal.
    pub sha256: String,
}

/// The exports of the car that FMUs read (`vehicle.NAME`), in the order in which the vehicle publishes them.
#[must_use]
pub fn exports_read(fmus: &[FmuRun]) -> Vec<String> {
    let sources = fmus.iter().flat_map(|fmu| fmu.inputs.values());
    let names: std::collections::BTreeSet<_> =
        sources.filter_map(|from| from.strip_prefix("vehicle.")).collect();
    names.into_iter().map(str::to_owned).collect()
}

pub(crate) fn check(fmus: &[FmuRun], c: &mut Checker) {
    c.require(fmus.len() <= FMUS_MAX, "", format!("must be at most {FMUS_MAX} of them"));
    let exports = exports_read(fmus).len();
    c.require(
        exports <= EXPORTS_MAX,
        "",
        format!("must read at most {EXPORTS_MAX} exports of the car in all, not {exports}"),
    );
    for (i, fmu) in fmus.iter().enumerate() {
        c.within(&format!("[{i}]"), |c| {
            let plain = |letter: char| letter.is_ascii_alphanumeric() || letter == '_' || letter == '-';
            c.require(fmu.name.chars().all(plain), "name", "must consist of letters, digits, `_` and `-`");
            let other = fmus[..i].iter().any(|other| other.name == fmu.name);
            c.require(!other, "name", "must not be that of another FMU");
            c.require(
                fmu.inputs.len() <= INPUTS_MAX,
                "inputs",
                format!("must be at most {INPUTS_MAX} of them"),
            );
            c.require(
                fmu.outputs.len() <= OUTPUTS_MAX,
                "outputs",
                format!("must be at most {OUTPUTS_MAX} of them"),
            );
            for (name, output) in &fmu.outputs {
                let (low, high) =
                    (output.min.unwrap_or(f64::NEG_INFINITY), output.max.unwrap_or(f64::INFINITY));
                c.require(low <= high, &format!("outputs.{name}.max"), "must not be less than min");
            }
        });
    }
}

//! Changes of live parameters that are part of a scenario: at a time a value is set, or the last change undone.
//!
//! The paths, units and ranges are the parameter list's (`kingpin param list SCENARIO`); it is checked there
//! when a run is made. A switch is 0 or 1. Changes of one time act in the order of the file, at one tick.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A change of the live parameters during the run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum ParameterChange {
    /// Sets a parameter.
    Set {
        /// Manoeuvre time; negative: during the warm-up. [s], [-600, 86400]
        #[schemars(range(min = -600.0, max = 86400.0))]
        at_s: f64,
        /// Path of the parameter, for instance `tyre.front.friction_scale`.
        path: String,
        /// New value in the parameter's unit; a switch is 0 or 1.
        value: f64,
    },
    /// Undoes the last change that is not undone yet.
    Undo {
        /// Manoeuvre time; negative: during the warm-up. [s], [-600, 86400]
        #[schemars(range(min = -600.0, max = 86400.0))]
        at_s: f64,
    },
}

impl ParameterChange {
    /// Manoeuvre time of the change. [s]
    pub fn at_s(&self) -> f64 {
        match self {
            ParameterChange::Set { at_s, .. } | ParameterChange::Undo { at_s } => *at_s,
        }
    }
}

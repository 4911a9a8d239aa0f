//! Variables, imports and outputs that a user defines as expressions (spec 1.6, Table 2.6: DEFINE_VARIABLE, IMPORT
//! with ADD, MULTIPLY, REPLACE, DEFINE_OUTPUT and EQ_OUT of the tool replaced).
//!
//! Each step: first the `variables` in their order, then the `imports`, then the car's step, then the `outputs`.
//! An expression may use every export of the car (`kingpin vehicle variables`), `time_s`, `step_s`, the user's
//! variables, and constants with units (`400 N`, `5 deg`, `0.2 s`); before the step exports have the values of the end
//! of the last one. Arithmetic with `^`, comparisons, `and`, `or`, `not`, `if(condition, then, otherwise)`, `min`, `max`,
//! `clamp(value, low, high)`, `abs`, `sign`, `sqrt`, `exp`, `ln`, trigonometric and hyperbolic functions, `pi`. Units are
//! checked when the car is put together. A variable that uses itself, or one behind it, uses the value of the last
//! step (so filters and integrators can be written); it needs `start`. A result that is not finite keeps its last value
//! and raises a flag.

use crate::check::{Check, Checker};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Most outputs that a user may define: slots of the region that carries them.
pub const OUTPUTS_MAX: usize = 16;

/// Variables, imports and outputs of the user.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Equations {
    /// User variables, evaluated in this order before each step; at most 64.
    #[schemars(length(min = 1, max = 64))]
    pub variables: Option<Vec<UserVariable>>,
    /// What the car's own variables are changed to; at most 64, each variable once.
    #[schemars(length(min = 1, max = 64))]
    pub imports: Option<Vec<Import>>,
    /// User outputs, evaluated after each step, recorded; at most 16.
    #[schemars(length(min = 1, max = 16))]
    pub outputs: Option<Vec<UserOutput>>,
}

/// A variable of the user's own.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct UserVariable {
    /// Name: letters, digits, `_`, not one of the car's.
    #[schemars(length(min = 1, max = 60))]
    pub name: String,
    /// Unit, such as `N*m`, `m/s^2`, `deg`; `1` for none.
    #[schemars(length(min = 1, max = 40))]
    pub unit: String,
    /// What it is.
    pub description: Option<String>,
    /// Its value each step.
    #[schemars(length(min = 1, max = 2000))]
    pub expression: String,
    /// Value before the first step, in `unit`; needed where its last value is used.
    pub start: Option<f64>,
}

/// How an import changes the car's variable.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ImportMode {
    /// The expression is added to the model's value.
    Add,
    /// The model's value is multiplied by the expression.
    Multiply,
    /// The expression takes the place of the model's value.
    Replace,
}

/// A change of one of the car's variables.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Import {
    /// The car's variable (`kingpin vehicle variables`, those marked as imports).
    #[schemars(length(min = 1, max = 60))]
    pub variable: String,
    /// How.
    pub mode: ImportMode,
    /// By what, each step: in the variable's unit to add or replace, a plain number to multiply.
    #[schemars(length(min = 1, max = 2000))]
    pub expression: String,
}

/// An output of the user's own.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct UserOutput {
    /// Name: letters, digits, `_`, not one of the car's.
    #[schemars(length(min = 1, max = 60))]
    pub name: String,
    /// Unit that it is recorded in, such as `N*m`, `m/s^2`, `deg`; `1` for none.
    #[schemars(length(min = 1, max = 40))]
    pub unit: String,
    /// What it is.
    pub description: Option<String>,
    /// Its value at the end of each step; may use the outputs before it.
    #[schemars(length(min = 1, max = 2000))]
    pub expression: String,
}

impl Equations {
    /// Whether there is nothing in it.
    pub fn is_empty(&self) -> bool {
        self.variables.is_none() && self.imports.is_none() && self.outputs.is_none()
    }
}

impl Check for Equations {
    fn check(&self, c: &mut Checker) {
        let variables = self.variables.iter().flatten().map(|v| v.name.as_str());
        let outputs = self.outputs.iter().flatten().map(|o| o.name.as_str());
        let mut seen: Vec<&str> = Vec::new();
        let keys = (0..).map(|i| format!("variables[{i}].name"));
        let named: Vec<(String, &str)> =
            keys.zip(variables).chain((0..).map(|i| format!("outputs[{i}].name")).zip(outputs)).collect();
        for (key, name) in named {
            let plain = name.chars().all(|l| l.is_ascii_alphanumeric() || l == '_');
            let begins = name.starts_with(|l: char| l.is_ascii_alphabetic() || l == '_');
            c.require(plain && begins, &key, "must be letters, digits and `_`, and not begin with a digit");
            c.require(!seen.contains(&name), &key, "must not be named twice");
            seen.push(name);
        }
        let mut imported: Vec<&str> = Vec::new();
        for (i, import) in self.imports.iter().flatten().enumerate() {
            let key = format!("imports[{i}].variable");
            let rule = "must not be imported twice: put both into one expression";
            c.require(!imported.contains(&import.variable.as_str()), &key, rule);
            imported.push(&import.variable);
        }
    }
}

//! Functional models.
#![allow(dead_code)]

mod blocks;
mod calculus;
mod couplings;
mod document;
mod error;
mod expand;
mod flat;
mod flatten;
mod frames;
mod instances;
pub mod library;
mod node;
mod pool;
mod syntax;
mod tables;
mod units;

pub use error::{ModelError, Rule};

/// Gives the text of a file a model names (`use`, table files), or why it cannot.
pub type Resolver<'r> = dyn Fn(&str) -> Result<String, String> + 'r;
mod dense;
mod eliminate;
mod kernel;
mod matrices;
mod model;
mod program;
mod reduce;
pub use matrices::{Matrices, OperatingPoint};
pub use model::{Model, ParameterInfo, Parameters, System};
mod account;
mod compiled;
pub use account::Account;
pub use compiled::{CompileOptions, Compiled, Method, STATE_LEN_MAX, StepStatus};
mod causality;
mod symbolic;
pub use causality::{CausalityReport, PortCausality};
pub use symbolic::{Symbolic, evaluate_symbolic};
mod diagram;

//! Functional models: parts are files, and coupling them, across frames, gives the system (patent JP 2008-152623 A).
//!
//! # Use
//! ```
//! use functional_model::{CompileOptions, Model, Parameters};
//! let text = r#"
//! format = "kingpin-model/1"
//! ports.push = { of = "cart.body", positive = "in" }
//! [parts.cart]
//! use = "library/mass.toml"
//! set = { m = "2 kg", d = "0.5 N*s/m" }
//! "#;
//! let model = Model::from_toml(text, "cart.toml", &|name| Err(format!("no file {name}"))).unwrap();
//! let system = model.compose(&Parameters::new().with("cart.m", "3 kg")).unwrap();
//! assert_eq!(system.matrices().unwrap().e[0][0], 3.0);
//! println!("{}{}", system.causality_report(), system.symbolic().unwrap());
//! let mut compiled = system.compile(CompileOptions::default()).unwrap();
//! compiled.step(&[6.0], 1e-3);
//! assert!((compiled.output("push.vb").unwrap() - 2e-3).abs() < 1e-6);
//! ```
//! [`Model::from_toml`] reads and checks; [`Model::compose`] couples at given parameters; [`System`] has the matrices,
//! the causality report, the symbolic text and the diagram; [`System::compile`] makes the step, which allocates
//! nothing, bounds its work, and exports its state ([`Compiled::save_state`]).
//!
//! # The file, `format = "kingpin-model/1"`
//! A **part** is a block with equations, or a model of parts. Everything a part may say, a file may say at its top.
//! - `dim` 0..3: dimensions of the frame (absent: its host's). `name`, `about`.
//! - `parameters`: `NAME = "expression with unit"`; a list is a vector (a diagonal), a list of lists a matrix.
//! - `states`: `x = "m/s"`, or `{ unit, kind = "scalar", transport = false }`. In a frame of two or three dimensions a
//!   state is a vector unless scalar. Vector states get the transport term of turning frames, E x' + Omega x (E x).
//! - `ports.NAME = { across = "v [m/s]", through = "f [N]", gives = "across", kind = "scalar" }`. Across times through
//!   is power; it is positive from the port that gives across to the port that gives through. In a model of parts,
//!   `ports.NAME = "part.port"` or `{ of = "part.port", positive = "in" }` (power positive into the model; outermost only).
//! - `columns`, `rows.LABEL = [...]`: the patent's matrix; the column `"1"` is the constant. `equations.LABEL = "..."`
//!   for anything else. A label is what is given (`fD`), a rate (`MC*x'`), or `0` for a constraint.
//! - `ratio.vo = { of = "vi", is = ... }` (or a list of them) and `gyrator`: lossless; the transposed half follows.
//! - `where`: names for expressions; `signals`: scalars for others to read; `inputs` with `feed` in the host: scalars read
//!   without power; `tables.NAME = { x, y, value, interpolation }` or `{ file }`.
//! - `energy`, `loss`, `supply`: what the part stores, J, and loses or feeds in, W, for the energy account.
//! - `[parts.NAME]`: written in place, or `use = "model.NAME"`, `"library/NAME.toml"`, `"file.toml"` with `set`, `feed`; how it
//!   lies in its host: `along` (a direction, for dim 0 and 1), `turn` (an angle, or `[["z", "a"], ["y", "b"]]`), `matrix`,
//!   and `spin` (its angular velocity, where no angle is kept).
//! - `[[couplings]] join = ["a.p", "b.q", ...]`, across shared (`shared = "through"` for the dual); `free = [...]` (no
//!   through), `fixed = [...]` (no across).
//! - `[mechanism.NAME]` `reads`, `gives`, `rule`, `hold`, `start`: once a sample; `runs = "always"`: continuously.
//! - `[observe]`, `[start]`, `[run] sample, method` (`exact`, `implicit`, `explicit`).
//!
//! A unit stands directly behind its number and reaches as far as it reads on (`12 N*m`): put a quantity in brackets
//! before multiplying by a name that is also a unit. A part written in place sees its host's parameters.
//!
//! # How it works
//! text -> parts and names -> scalar equations with couplings written out -> index reduction and elimination -> a small
//! non-linear core -> the step. Each module says its own sources.

mod account;
mod blocks;
mod calculus;
mod causality;
pub mod comparison;
mod compiled;
mod couplings;
mod dense;
mod diagram;
mod document;
mod eliminate;
mod error;
mod exact;
mod expand;
mod flat;
mod flatten;
mod frames;
mod instances;
mod kernel;
pub mod library;
mod matrices;
mod model;
mod node;
mod pool;
mod program;
mod ratios;
mod reduce;
pub mod schema;
mod symbolic;
mod syntax;
mod tables;
mod units;

pub use account::Account;
pub use causality::{CausalityReport, PortCausality};
pub use compiled::{CompileOptions, Compiled, Method, STATE_LEN_MAX, StepStatus};
pub use error::{ModelError, Rule};
pub use matrices::{Matrices, OperatingPoint};
pub use model::{Model, ParameterInfo, Parameters, System};
pub use symbolic::{Symbolic, evaluate_symbolic};
pub use units::scale_of;

/// Gives the text of a file a model names (`use`, table files), or why it cannot.
pub type Resolver<'r> = dyn Fn(&str) -> Result<String, String> + 'r;

//! The car and the suspension as FMUs: FMI 2.0 for co-simulation.
//!
//! One C library serves every such FMU; what makes it a certain car is `resources/model.json`, the resolved files. The
//! step has a fixed length, written into it; a master's step must be a multiple. [`variables`] is the one list from
//! which come the description, the handles and the exchange of values.

mod abi;
mod model;
mod xml;

pub use model::{Model, Resource, Role, Type, Variable, variables};
pub use xml::{IDENTIFIER, description};

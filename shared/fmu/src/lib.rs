//! Functional mock-up units: FMI 2.0 and 3.0 for co-simulation, from the file to the step.
//!
//! [`Fmu::open`] looks into the archive, [`Setup::new`] joins names and units, [`Runner`] loads and steps in this
//! process, [`Hosted`] in a child. Own and thin: the C interface is declared by hand in `binary.rs`, the only place
//! with `unsafe`. Not read: model exchange, scheduled execution, clocks, arrays, binary variables, events.

mod archive;
mod binary;
mod bind;
mod description;
mod error;
mod host;
mod runner;
pub mod units;

pub use archive::{BYTES_MAX, Fmu, platform};
pub use bind::{Joints, Port, Setup, Value, Wanted, check_step};
pub use description::{Causality, Description, Kind, Variable, Version};
pub use error::FmuError;
pub use host::{Hosted, serve};
pub use runner::{Cost, Runner, Stepper, interpreter};

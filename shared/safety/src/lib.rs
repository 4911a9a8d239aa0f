//! Limits and the bench state machine, as pure functions of what the rig process itself knows.
//!
//! [`Safety::step`] runs once a tick between the command's arrival and the controller: it judges the
//! measurement and the command, moves the bench's state, and hands on a command that is within every limit.
//! [`Safety::clamp_actuation`] is the last gate before the actuators. No clock, no other process.

pub mod clamp;
pub mod ecu;
pub mod input;
pub mod machine;
pub mod state;
pub mod trip;
pub mod watch;

pub use ecu::EcuWord;
pub use input::{OperatorRequest, SafetyInput, SafetyOutput};
pub use machine::Safety;
pub use state::BenchState;
pub use trip::{Trip, TripCode};

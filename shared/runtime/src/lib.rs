//! Nodes and ticks: lockstep, paced with output phase, deadlines, real-time threads. No physics.
//!
//! A service is a [`Model`] with one or two nodes. [`Bound::tick`] steps a node and is the only path; the
//! two drivers differ in when they call it: [`lockstep`] as soon as the inputs of a tick are there, as fast
//! as it goes; [`paced`] by the wall clock, with a latest start, an output phase and catching up.
//!
//! Invariant: models read no clock; what the wall clock says goes into the timing regions only.
//! Invariant: every wait has an end.

pub mod clock;
mod hooks;
pub mod lockstep;
mod node;
pub mod paced;
pub mod realtime;
mod specs;

pub use hooks::Hooks;
pub use node::{Bound, Input, InputSpec, Inputs, Model, NodeSpec, Step, When};
pub use specs::region_specs;

use regions::RegionId;

/// Why a service cannot go on.
#[derive(Debug)]
pub enum TickError {
    /// The table refused: another layout, another writer, no memory.
    Table(table::TableError),
    /// Lockstep: a node was stepped before its input was there. A mistake of the driver.
    NotReady {
        /// Node stepped.
        node: &'static str,
        /// Input that is missing.
        region: RegionId,
        /// Tick.
        tick: u64,
    },
    /// Lockstep: an input did not come in time.
    TimedOut {
        /// Node that waited.
        node: &'static str,
        /// Input that did not come.
        region: RegionId,
        /// Tick.
        tick: u64,
        /// How long it waited. [s]
        waited_s: f64,
    },
    /// The supervisor never started the run.
    NeverStarted {
        /// How long it waited. [s]
        waited_s: f64,
    },
}

impl std::fmt::Display for TickError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            TickError::Table(error) => write!(f, "{error}"),
            TickError::NotReady { node, region, tick } => {
                write!(f, "{node} was stepped at tick {tick} before {} was there", region.region().name)
            }
            TickError::TimedOut { node, region, tick, waited_s } => {
                let region = region.region();
                write!(
                    f,
                    "{node} waited {waited_s:.1} s at tick {tick} for region {}: service {} is dead or stuck",
                    region.name, region.writer
                )
            }
            TickError::NeverStarted { waited_s } => {
                write!(f, "the supervisor did not start the run within {waited_s:.1} s")
            }
        }
    }
}

impl std::error::Error for TickError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            TickError::Table(error) => Some(error),
            _ => None,
        }
    }
}

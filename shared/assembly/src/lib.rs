//! From configuration to nodes: the only place that knows physics, regions and runtime.
//!
//! A node here reads its inputs' words, decides what to make of missing or refused ones, steps a physics
//! crate and writes its region. The rules for inputs that do not come are the same for vehicle and
//! multibody ([`Guard`]); the rig's are safety's.

mod can_node;
mod car;
pub mod closed_loop;
mod compliance;
mod driveline;
mod fmu_node;
mod guard;
pub mod identification;
mod kinematics;
mod live;
pub mod manifest;
mod multibody_node;
pub mod plan;
mod rig_node;
pub mod service;
pub mod trips;
mod vehicle_node;
pub mod wheel;

pub use can_node::{
    CanMessage, CanNode, CanParts, build_can, can_order, can_sources, can_targets, virtual_ecu,
};
pub use car::build_car;
pub use compliance::axle_compliance;
pub use fmu_node::{FmuFault, FmuNode, FmuPart, Unpacked, build_fmus, check_fmus, fmu_model, fmu_part};
pub use guard::Guard;
pub use kinematics::{axle_kinematics, axle_kinematics_in};

use config::ResolvedBench;
use runtime::Model;

/// The tick services.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ServiceKind {
    /// Samples and applies.
    Rig,
    /// The car.
    Vehicle,
    /// The front suspension.
    Multibody,
}

impl ServiceKind {
    /// All of them.
    pub const ALL: [ServiceKind; 3] = [ServiceKind::Rig, ServiceKind::Vehicle, ServiceKind::Multibody];

    /// Priority relative to the scenario's: the rig before the vehicle before the multibody service.
    pub fn priority_offset(self) -> i32 {
        match self {
            ServiceKind::Rig => 0,
            ServiceKind::Vehicle => -1,
            ServiceKind::Multibody => -2,
        }
    }
}

/// Why a configuration cannot be built, though each of its files is valid by itself.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AssemblyError {
    /// Which part.
    pub part: &'static str,
    /// What is wrong with it, a line each.
    pub faults: Vec<String>,
}

impl AssemblyError {
    fn new<T: std::fmt::Display>(part: &'static str, faults: impl IntoIterator<Item = T>) -> Self {
        AssemblyError { part, faults: faults.into_iter().map(|fault| fault.to_string()).collect() }
    }
}

impl std::fmt::Display for AssemblyError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for (i, fault) in self.faults.iter().enumerate() {
            if i > 0 {
                writeln!(f)?;
            }
            write!(f, "{}: {fault}", self.part)?;
        }
        Ok(())
    }
}

impl std::error::Error for AssemblyError {}

/// Builds the model of a service.
///
/// # Errors
/// [`AssemblyError`] naming the part and everything that is wrong with it.
pub fn build(kind: ServiceKind, resolved: &ResolvedBench) -> Result<Box<dyn Model>, AssemblyError> {
    build_in(kind, resolved, None)
}

/// The same, with what takes long to prepare kept in a directory from one start of a service to the next.
///
/// # Errors
/// As [`build`].
pub fn build_in(
    kind: ServiceKind,
    resolved: &ResolvedBench,
    kept: Option<&std::path::Path>,
) -> Result<Box<dyn Model>, AssemblyError> {
    Ok(match kind {
        ServiceKind::Rig => Box::new(rig_node::RigNode::new(resolved)?),
        ServiceKind::Vehicle => Box::new(vehicle_node::VehicleNode::new(resolved, kept)?),
        ServiceKind::Multibody => Box::new(multibody_node::MultibodyNode::new(resolved)?),
    })
}

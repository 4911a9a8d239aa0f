//! Rigid multibody systems: constraints, kinematics, reactions, dynamics, suspensions.
//!
//! The library below knows bodies and constraints only; [`suspension`] composes it into steered axles.
//! Coordinates: r and unit Euler parameters p per body; virtual displacements [δr; δπ'] with δπ' in the
//! body frame. A constraint's force on the bodies is −Φ_qᵀλ. Quantities are SI; frames ISO 8855.

// Limits are written `!(x <= limit)` where NaN must count as beyond the limit.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

pub mod body;
pub mod constraint;
pub mod dynamics;
mod equilibrium;
pub mod euler_form;
pub mod failure;
mod geometric;
pub mod kinematics;
#[cfg(test)]
mod library_samples;
pub mod linear;
pub mod mechanism;
pub mod methods;
pub mod structured;
pub mod suspension;
pub mod system;

pub use failure::{AssemblyError, Failure, Reason, Solved};
pub use suspension::{
    SideOutput, SolverPath, Status, Suspension, SuspensionDescription, SuspensionInput, SuspensionOutput,
};

//! Rigid multibody systems: constraints, kinematics, reactions, dynamics, suspensions.
//!
//! The library knows bodies and constraints only; [`suspension`] composes it into steered axles.
//! Coordinates: r and unit Euler parameters p per body; virtual displacements [δr; δπ'] with δπ' in the
//! body frame. A constraint's force on the bodies is −Φ_qᵀλ. Quantities are SI; frames ISO 8855.
//!
//! In reading order: [`body`], [`constraint`] (the library: Φ, Jacobian, ν, γ), [`mechanism`] (bodies and
//! constraints as data, reactions, balance), [`kinematics`] (the general path), [`structured`] (the same,
//! part by part), `equilibrium` (with bushings), [`dynamics`], [`euler_form`] (seven coordinates, for
//! checking), [`suspension`].
//!
//! # In the loop
//! [`Suspension::new`] assembles a `config::axle::Axle`; [`Suspension::step`] takes rack stroke, wheel
//! heights (both with their rates) and the six wheel-centre forces in the knuckle frame, and gives per side
//! the tie-rod force, the outer ball with its velocity, alignment, joint forces. A step never fails: what
//! cannot be solved is held at the last good tick and flagged in [`SuspensionOutput::status`], whose
//! constraint index [`Suspension::constraint_name`] names. Moves of more than 5 mm a tick are made in
//! pieces, so arbitrary rows of a table can be stepped through one after the other. No allocation, no
//! clock; the state is a flat list of numbers. [`Suspension::describe`] lists bodies and constraints of
//! both stages, [`Suspension::force_stage`] gives every reaction, [`Suspension::lock_springs`] serves
//! compliance rigs, [`SolverPath`] picks the solver.
//!
//! ```
//! # use multibody::{Suspension, SuspensionInput, SuspensionOutput};
//! # fn tick(axle: &config::axle::Axle) -> Result<f64, multibody::AssemblyError> {
//! let mut suspension = Suspension::new(axle)?;
//! let mut output = SuspensionOutput::default();
//! let mut input = SuspensionInput { rack_m: 0.01, ..SuspensionInput::DESIGN };
//! input.wheel_force_n[0].z = 4000.0;
//! suspension.step(&input, &mut output);
//! # Ok(output.side[0].tie_rod_force_n)
//! # }
//! ```
//!
//! Invariant: nothing outside [`suspension`] knows a suspension's name. Invariant: one tick's result is a
//! function of the saved state and the input.

// Units stand in brackets in every description; they are no links.
#![allow(rustdoc::broken_intra_doc_links)]
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

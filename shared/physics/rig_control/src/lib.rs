//! The rig's controller: inner loops, feed-forward, delay compensation, force conversion.
//!
//! It sees a [`rig_plant::Measurement`] and the linkage's geometry, never the plant. One [`RigController::step`]
//! a tick turns a [`RigCommand`] into an [`rig_plant::Actuation`]. [`study`] runs it against the virtual rig.

pub mod command;
pub mod controller;
pub mod delay;
pub mod energy;
pub mod force;
pub mod height;
pub mod history;
pub mod hub;
pub mod identification;
pub mod rack;
pub mod rack_estimate;
pub mod steer;
pub mod study;
pub mod tracker;
pub mod valve;

pub use command::{ControlDiagnostics, Fade, RigCommand, SteerCommand};
pub use controller::RigController;
pub use rack_estimate::RackEstimate;

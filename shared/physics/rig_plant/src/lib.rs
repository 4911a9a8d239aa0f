//! The virtual rig: two sides of servo-hydraulic cylinders and linkage, a steer actuator, a steering unit
//! and the sensors, integrated at sub-steps of at most 0.1 ms.
//!
//! [`interface`] is what any rig, virtual or real, exchanges with its controller once a tick; [`linkage`] is
//! the geometry both know. All other modules are the virtual machine and invisible to the controller.
//!
//! Frames: rig axes as ISO 8855 (x forward, y left, z up), origin at the centre of the rack. Sides are
//! mirror images, so each is computed in (forward, outboard, up). Tie-rod force is positive in tension.

pub mod composed_unit;
pub mod friction;
pub mod hydraulic;
pub mod interface;
pub mod linkage;
pub mod plant;
pub mod random;
pub mod sensors;
pub mod state;
pub mod unit;

pub use composed_unit::ComposedUnit;
pub use interface::{Actuation, Channel, Measurement, RigEnvironment};
pub use linkage::Linkage;
pub use plant::{Truth, VirtualRig};
pub use unit::{ColumnEps, SteeringUnitModel, UnitAccount, UnitInput, UnitOutput, UnitTuning};

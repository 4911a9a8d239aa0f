//! The two older ways to a tie-rod force, kept to be compared with the multibody solver, and the alignment
//! curves that both they and a chassis engineer read.
//!
//! Reading order: [`alignment`] (angles, scrub, trail of one pose), [`sweep`] (poses over wheel travel and
//! rack), [`map`] (one-dimensional maps, added), [`tie_rod`] (kingpin moment to rod force).
//! Everything here is rigid kinematics of the axle as drawn: bushings, stabiliser and friction are left out.

pub mod alignment;
pub mod map;
pub mod sweep;
pub mod tie_rod;

pub use alignment::Alignment;
pub use map::{AlignmentMaps, MapError, MappedSide};
pub use sweep::{Curve, CurvePoint, Over, SweptPose, curve, kinematic_axle, kinematics_map, reach};
pub use tie_rod::{OlderForces, OlderMethods, SideForces};

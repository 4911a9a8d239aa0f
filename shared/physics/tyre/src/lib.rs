//! Tyres: `.tir` property files, Magic Formula 5.2/6.1/6.2, table tyres, transients down to standstill.
//!
//! Reading order: [`Tyre`] (what a car uses), then `formula` (steady state) and `table` (the other source of
//! forces), `structure` (spring, radii, patch), `transient` (relaxation, standstill), `tir` (the file).
//! Axes ISO-W (TYDEX): x forward, y left, z up, at the contact centre; α < 0 gives Fy > 0, κ > 0 drives, camber
//! γ > 0 leans the wheel's top to the right of its heading (positive rotation about x). Units SI, radians.

// Units stand in brackets in docs: [N], [m/s].
#![allow(rustdoc::broken_intra_doc_links)]

mod evaluate;
mod formula;
mod keys;
mod law;
mod math;
mod model;
mod structure;
mod table;
mod tir;
mod transient;
mod turn_slip;

pub use evaluate::{Evaluated, INPUT_COLUMNS, OUTPUT_COLUMNS, evaluate_csv};
pub use model::{Contact, Forces, Shape, Tyre, TyreInfo, UseMode};
pub use tir::{Side, Substituted, TirError, Version};
pub use transient::{Motion, TransientState};

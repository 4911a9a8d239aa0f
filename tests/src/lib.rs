//! Tests across the whole bench: layering, lockstep, processes, faults, command line.
//!
//! What several of them need stands in [`support`].

pub mod browser;
pub mod csv;
pub mod fmu;
pub mod socket;
pub mod support;

//! FMUs: the importer against an FMU written in C from the standards, checked by fmpy; in the loop; spoilt ones; and
//! our own car and suspension as FMUs, run by fmpy.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

#[path = "fmu/exported.rs"]
mod exported;
#[path = "fmu/import.rs"]
mod import;
#[path = "fmu/looped.rs"]
mod looped;

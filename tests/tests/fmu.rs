//! FMUs: the importer against an FMU written in C from the standards, checked by fmpy; spoilt ones.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

#[path = "fmu/import.rs"]
mod import;

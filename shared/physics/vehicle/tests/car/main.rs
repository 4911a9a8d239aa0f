//! The whole car: closed forms, independent models, limits, checkpoints.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout, missing_docs)]

mod analytic;
mod chrono;
mod frequency;
mod limits;
mod manoeuvres;
mod measured;
mod numerics;
mod peers;
mod powertrain;
mod robustness;
mod support;
mod tables;

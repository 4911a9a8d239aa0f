//! Handling, steering-feel, tracking and timing figures of a run.
//!
//! Pure functions of signals: no clock, file, region or configuration. SI units; what a figure is worth
//! depends on conditions, so a figure that cannot be had is withheld with its reason, never guessed.

pub mod budget;
pub mod compare;
pub mod correlation;
pub mod filter;
pub mod fit;
pub mod handling;
pub mod resample;
pub mod statistics;
pub mod tracking;

//! The rig service: the time base of the bench. Samples at the start of a tick, applies at the output phase.
//!
//! It depends on nobody to reach the safe state: safety and the ramp out of a lost input are in this process.

use assembly::ServiceKind;
use assembly::service::{ServiceError, serve};
use table::Bench;

/// Runs the service of a bench to the end of the run. Notes of what the host refused go to `note`.
///
/// # Errors
/// [`ServiceError`].
pub fn run(bench: &Bench, note: impl FnMut(&str)) -> Result<(), ServiceError> {
    serve(ServiceKind::Rig, bench, note)
}

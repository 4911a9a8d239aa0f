//! The multibody service: poses the front suspension and turns wheel forces into tie-rod forces.

use assembly::ServiceKind;
use assembly::service::{ServiceError, serve};
use table::Bench;

/// Runs the service of a bench to the end of the run. Notes of what the host refused go to `note`.
///
/// # Errors
/// [`ServiceError`].
pub fn run(bench: &Bench, note: impl FnMut(&str)) -> Result<(), ServiceError> {
    serve(ServiceKind::Multibody, bench, note)
}

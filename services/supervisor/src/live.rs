//! The supervisor's side of the live parameters: the words of the region, and (paced) the book behind it.

use params::{Schedule, Values};
use regions::{Parameters, Payload};

/// The region's words for values that hold from tick `n` on.
pub(crate) fn words(n: u64, version: u64, values: &Values) -> Parameters {
    let mut parameters = Parameters::absent();
    parameters.tick = n;
    parameters.version = version;
    parameters.value = *values;
    parameters
}

/// What a scenario's schedule says at tick `n`.
pub fn at(schedule: &Schedule, n: u64) -> Parameters {
    let (version, values) = schedule.at(n);
    words(n, version, values)
}

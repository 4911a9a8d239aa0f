//! Live parameters: what can be tuned while the bench runs, within which range, in which state.
//!
//! [`LIST`] is the one list: path, unit, range, default and the service that applies it. The supervisor keeps
//! a [`Book`] of the values in force, accepts or refuses changes, and puts the values into the `parameters`
//! region with a version; the services take them over at the beginning of a tick and echo the version. A
//! scenario's own changes are a [`Schedule`], a pure function of the tick.
//!
//! Not here: how a change reaches the supervisor (crate `operator_link`), what a value does (crate `assembly`).

mod book;
mod fixed;
mod list;
mod schedule;
mod snapshot;

pub use book::{Book, Change, Refusal, Setting};
pub use fixed::Fixed;
pub use list::{Id, Kind, LIST, Parameter, States, Tuner, by_path, closest};
pub use schedule::Schedule;
pub use snapshot::{SnapshotError, difference, read_snapshot, write_snapshot};

/// Values of the whole list, in its order; what lies behind the list's end is 0.
pub type Values = [f64; 62];

/// Value of a parameter.
pub fn value(values: &Values, id: Id) -> f64 {
    values[id as usize]
}

/// The values a bench starts with.
pub fn defaults(resolved: &config::ResolvedBench) -> Values {
    let mut values = [0.0; 62];
    for (value, parameter) in values.iter_mut().zip(LIST) {
        *value = (parameter.default)(resolved);
    }
    values
}

//! Parameter studies: one scenario again and again with other parameters, a few figures kept of each run.
//!
//! [`run`] makes a run in lockstep in memory, bit for bit that of `kingpin run --lockstep`, without a file, a process
//! or shared memory, so that as many as there are cores can be made side by side. [`Prepared`] draws the runs of a
//! study and makes one ([`Prepared::evaluate`]): a pure function of study and number of the run, so that it does not
//! matter who makes it, when, or how often. [`Journal`] keeps finished runs, one file each; [`write_results`] makes the
//! table and the page of them. Who hands out the numbers (threads, processes, a cluster) is not known here.

mod draw;
mod figures;
mod journal;
pub mod judge;
mod memory;
mod results;

pub use draw::Prepared;
pub use journal::Journal;
pub use memory::{Interrupted, RunFault, run};
pub use results::{Cell, Row, columns, write_results};

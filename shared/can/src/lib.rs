//! CAN: DBC signals, end-to-end protection, mapping to the table's variables, rest-bus, virtual ECU.
//!
//! Pure but for [`socket`]: time is an argument, a bus is a trait ([`bus::Bus`]). In the order of the data:
//! [`frame`] and [`signal`] are bits; [`database`] is a DBC file; [`e2e`] counters and checksums; [`mapping`] joins
//! a mapping file, a DBC file and the bench's variables into a plan, or says everything that does not fit;
//! [`restbus`] sends in cycles, [`receive`] judges what comes; [`ecu`] is a virtual ECU made of the same parts.
//!
//! Invariant: no step allocates. Invariant: an absent value is NaN, never an old or a plausible number.

pub mod bus;
pub mod database;
pub mod e2e;
pub mod ecu;
pub mod fault;
pub mod frame;
pub mod mapping;
pub mod receive;
pub mod restbus;
pub mod signal;
pub mod socket;
pub mod units;

pub use database::{Database, Message, Signal};
pub use frame::{Frame, Id};

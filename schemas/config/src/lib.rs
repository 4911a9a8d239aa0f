//! Configuration: the checked parameters of every part of the bench, and their loading.
//!
//! One file, one section. A section is a plain struct of numbers with their units in the field names,
//! derived from serde and schemars (so that one definition gives the parser, the JSON schema for editors
//! and the ranges), and a [`Check`] for the rules that join several fields. Physics sees these structs and
//! nothing else: no file, no TOML, no default that hides a missing value.

pub mod axle;
pub mod bench;
pub mod campaign;
pub mod can;
pub mod car;
pub mod check;
pub mod equations;
pub mod library;
pub mod live;
pub mod load;
pub mod model;
pub mod number_table;
pub mod problem;
pub mod record;
pub mod rig;
pub mod road;
pub mod scenario;
pub mod steer;
pub mod study;
pub mod surface;
pub mod tree;
pub mod unit;
pub mod unit_name;
mod validate;
pub mod wheel;

pub use bench::{ResolvedBench, ResolvedCan, ResolvedCar, TextFile, load_can};
pub use check::{Broken, Check, Checker};
pub use library::{Kind, Library};
pub use load::{Loaded, Section, all_schemas, load, load_with, schema_json};
pub use model::ModelFiles;
pub use number_table::NumberTable;
pub use problem::{Mistake, Problems, Violation};
pub use record::{MeasuredSignal, RecordedHistory, TimeSeries};
pub use surface::SurfaceFiles;

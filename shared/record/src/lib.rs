//! Logs of a bench: writing, reading, recovery, comparison, export.
//!
//! A log is an MCAP file (specification: mcap.dev/spec) of flat CDR messages: one channel per region, one
//! message per tick, each the region's words behind a 4-byte CDR header, with a ROS 2 message definition, so
//! that MCAP tools read it as it is. Events are JSON on `/events`. The resolved configuration, its hash and
//! sources travel along as attachments. A file is at every moment a prefix of a valid log: whatever killed
//! its writer, everything up to the last flush is readable ([`LogReader`]) and can be mended ([`recover()`]).

pub mod compare;
mod error;
pub mod export;
mod export_mcap;
mod export_parquet;
mod header;
mod memory;
mod mf4;
pub mod reader;
pub mod recover;
pub mod scan;
mod select;
mod sink;
mod table;
mod thin;
pub mod writer;

pub use compare::{Difference, compare};
pub use error::LogError;
pub use export::{CsvOptions, export_csv};
pub use export_mcap::export_mcap;
pub use export_parquet::export_parquet;
pub use header::{LogHeader, Source, text_hash};
pub use mf4::{Mf4Options, export_mf4};
pub use reader::{Event, LogColumn, LogFile, LogReader, RegionLog, Signal, log_files};
pub use recover::{RecoverReport, recover};
pub use scan::ScanReport;
pub use table::{TableColumn, TableValues, table_csv, table_parquet};
pub use thin::Decimation;
pub use writer::{LogWriter, WriteStats};

//! The shared table: regions in shared memory, one writer each, history by tick. Knows no physics and no region.
//!
//! # Overview
//!
//! A [`Table`] is a list of regions, made from a list of [`RegionSpec`]s and addressed by their index in it. A region
//! is a header and a ring with one slot per tick; its payload is a fixed number of 64-bit words. It has at most one
//! writer, claimed by [`Table::claim_writer`], and any number of readers, [`Table::reader`]. The memory is this
//! process's own ([`Table::create_local`]) or POSIX shared memory ([`Table::create_shared`], [`Table::open`]); the
//! types and their behaviour are the same.
//!
//! ```
//! use table::{Read, RegionSpec, Table, TableInfo};
//! let specs = [RegionSpec { name: "state", version: 1, layout_hash: 0x51, words: 4, depth: 8 }];
//! let info = TableInfo { run_id: 1, period_ns: 1_000_000, t0_ns: 0 };
//! let table = Table::create_local(&specs, info)?;
//! let mut writer = table.claim_writer(0)?; //          RegionWriter: Send; one at a time
//! let reader = table.reader(0).clone(); //             RegionReader: Send + Sync + Clone
//! assert_eq!(writer.write(0, &[1, 2, 3, 4]), Ok(())); // Err(Refused) for a published tick
//! writer.ring(); //                                    publish() = write() + ring()
//! let mut out = [0; 4];
//! assert_eq!(reader.read(0, &mut out), Read::Ready);
//! assert_eq!(reader.read(1, &mut out), Read::NotYet);
//! assert_eq!(reader.latest(5, &mut out).map(|l| (l.tick, l.age)), Some((0, 5)));
//! # Ok::<(), table::TableError>(())
//! ```
//!
//! Reading: [`RegionReader::read`] makes one bounded attempt at one tick: `Ready`, `NotYet`, `Missing` (skipped, or
//! its writer died in it), `Overwritten`. [`RegionReader::latest`] gives the newest with its age in ticks.
//! Waiting: [`RegionReader::wait_for`]`(n, &Wait)` re-checks, sleeps to shortly before the data are due, spins a
//! bounded window, then sleeps on the bell to an absolute deadline. [`monotonic_ns`] is the clock of all times here.
//! None of these, nor [`RegionWriter::write`], allocates; `write` and `read` make no system call.
//!
//! Processes: [`Bench::new`] names a bench. Its supervisor holds [`Bench::lock`], looks for left-overs with
//! [`list_bench`], removes them with [`remove_bench`], makes the table with [`Table::create_shared`], starts the
//! services and, when all are ready, sets the start of tick 0 with [`Table::set_t0`]. Services [`Table::open`]
//! (read-only) and claim what they write. A supervisor that takes over a running bench uses [`Table::adopt`].
//! Segments outlive every process until [`remove_bench`]; [`RegionReader::open_any`] and [`list_benches`] browse them.
//!
//! The header ([`RegionReader::header`]) says run, period, start, epoch (number of claims), writer's pid and start
//! time. A region's claim is a file lock, freed by the kernel when its holder dies.
//!
//! # Invariants
//! - A region has one writer. Published ticks never change. Writers never wait for readers.
//! - A killed writer blocks nobody, tears nothing, and its successor goes on with the next epoch.
//! - No process can crash or hang another by what it leaves in `/dev/shm`.
//! - `unsafe` is in `segment.rs` only.

mod bell;
mod bench;
mod error;
mod header;
mod process;
mod region;
mod segment;
pub mod slot;
mod spec;
mod table;

pub use bell::{Bell, Wait, monotonic_ns};
pub use bench::{Bench, BenchLock, base_from_environment};
pub use error::TableError;
pub use header::{HEADER_WORDS, Header, MAGIC, ProcessId};
pub use process::{is_alive, this_process};
pub use region::{RegionReader, RegionWriter};
pub use segment::{
    Found, list_bench, list_benches, list_segments, remove_bench, segment_name, writers_alive,
};
pub use slot::{Latest, Read, Refused};
pub use spec::{BenchName, Layout, RegionSpec, TableInfo};
pub use table::{CreateOptions, OpenOptions, Table};

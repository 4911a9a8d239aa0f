//! The table's regions: one flat layout each, described once for table, log, console and manual.

//! Logs: writing, reading, recovery, export.

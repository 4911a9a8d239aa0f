//! The logger: reads the table, writes the log.

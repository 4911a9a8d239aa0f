//! The supervisor: starts, watches and ends the services of a bench.

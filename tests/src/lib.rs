//! Tests across the whole bench.

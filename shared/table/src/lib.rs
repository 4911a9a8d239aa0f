//! The shared table: regions in shared memory, one writer each, history by tick.

//! Limits and the bench state machine, as pure functions.

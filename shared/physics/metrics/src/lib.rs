//! Handling, steering-feel, tracking and timing figures of a run.

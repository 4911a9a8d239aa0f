//! Functional models: blocks, frames, composition, compiled step.

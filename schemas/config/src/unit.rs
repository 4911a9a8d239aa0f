//! The steering unit under test.

//! The rig service.

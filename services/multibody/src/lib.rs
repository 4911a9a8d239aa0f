//! The multibody service.

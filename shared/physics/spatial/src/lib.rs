//! Vectors, rotations, Euler parameters and frames.

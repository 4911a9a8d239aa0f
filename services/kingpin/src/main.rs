//! Kingpin: an open, real-time steering hardware-in-the-loop bench.

fn main() {}

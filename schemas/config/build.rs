//! Rebuilds the crate when a shipped reference file is added, removed or changed.

// Cargo reads a build script's standard output.
#![allow(clippy::print_stdout)]

fn main() {
    for directory in [
        "cars",
        "suspensions",
        "tyres",
        "units",
        "scenarios",
        "rigs",
        "models",
        "can",
        "campaigns",
        "studies",
    ] {
        println!("cargo:rerun-if-changed=../{directory}");
    }
}

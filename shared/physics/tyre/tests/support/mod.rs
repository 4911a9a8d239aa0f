//! Helpers of the tyre tests: where the reference data stand, reading of tables.
#![allow(
    dead_code,
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::print_stdout,
    missing_docs
)]

use std::path::{Path, PathBuf};

/// The workspace root: the nearest directory upwards with a `Cargo.lock`.
pub fn workspace() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .ancestors()
        .find(|d| d.join("Cargo.lock").exists())
        .unwrap()
        .to_owned()
}

/// A reference file beside the repository. Where it is missing: says so, and fails under `CI=true`.
pub fn reference(path: &str) -> Option<String> {
    let file = workspace().join("../shared/reference").join(path);
    match std::fs::read_to_string(&file) {
        Ok(text) => Some(text),
        Err(_) => {
            println!("missing reference file: {path}; test skipped");
            assert!(std::env::var("CI").as_deref() != Ok("true"), "missing reference file {path}");
            None
        }
    }
}

/// Columns of a numeric CSV table by name.
pub struct Table {
    pub names: Vec<String>,
    pub rows: Vec<Vec<f64>>,
}

impl Table {
    pub fn parse(text: &str) -> Self {
        let mut lines = text.lines();
        let names = lines.next().unwrap().split(',').map(str::to_owned).collect();
        let rows = lines.map(|l| l.split(',').map(|c| c.parse().unwrap()).collect()).collect();
        Self { names, rows }
    }

    pub fn column(&self, name: &str) -> Vec<f64> {
        let i = self.names.iter().position(|n| n == name).unwrap_or_else(|| panic!("no column {name}"));
        self.rows.iter().map(|r| r[i]).collect()
    }
}

/// A passenger car tyre of our own writing, shipped with the product.
pub fn shipped() -> tyre::Tyre {
    let file = workspace().join("schemas/tyres/car_205_60r15.tir");
    tyre::Tyre::from_tir(&std::fs::read_to_string(file).unwrap(), "car_205_60r15.tir").unwrap()
}

/// The tyres to test the transient model with: ours, and the reference files that are there.
pub fn tyres() -> Vec<tyre::Tyre> {
    let mut found = vec![shipped()];
    for name in [
        "chrono_pactest_235_60R16_PAC2002",
        "chrono_sedan_245_40R18_PAC2002",
        "mfeval_MF52",
        "mfeval_MF61",
        "mfeval_MF62",
    ] {
        if let Some(text) = reference(&format!("tyre/{name}.tir")) {
            found.push(tyre::Tyre::from_tir(&text, name).unwrap());
        }
    }
    found
}

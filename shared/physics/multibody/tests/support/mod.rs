//! Finding and reading reference data; comparing columns.
#![allow(dead_code)]

use std::path::{Path, PathBuf};

/// The shared folder beside the workspace.
pub fn shared() -> PathBuf {
    let mut root = Path::new(env!("CARGO_MANIFEST_DIR"));
    while !root.join("Cargo.lock").exists() {
        root = root.parent().expect("a workspace root above this crate");
    }
    root.parent().expect("a parent of the workspace").join("shared")
}

/// A reference file's text; `None` (after saying so) where it is missing, unless in CI.
pub fn reference(name: &str) -> Option<String> {
    let path = shared().join("reference/suspension").join(name);
    match std::fs::read_to_string(&path) {
        Ok(text) => Some(text),
        Err(error) => {
            assert!(std::env::var("CI").as_deref() != Ok("true"), "missing {}: {error}", path.display());
            println!("skipped: missing reference/suspension/{name}");
            None
        }
    }
}

/// A CSV of numbers with named columns.
pub struct Table {
    names: Vec<String>,
    rows: Vec<Vec<f64>>,
}

impl Table {
    pub fn parse(text: &str) -> Self {
        let mut reader = csv::Reader::from_reader(text.as_bytes());
        let names = reader.headers().unwrap().iter().map(str::to_owned).collect();
        let rows =
            reader.records().map(|r| r.unwrap().iter().map(|x| x.parse().unwrap()).collect()).collect();
        Self { names, rows }
    }

    pub fn len(&self) -> usize {
        self.rows.len()
    }

    pub fn get(&self, row: usize, name: &str) -> f64 {
        let column = self.names.iter().position(|n| n == name).unwrap_or_else(|| panic!("no column {name}"));
        self.rows[row][column]
    }

    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Largest |value| of all columns whose name starts with `prefix`.
    pub fn peak(&self, prefix: &str) -> f64 {
        let columns = (0..self.names.len()).filter(|c| self.names[*c].starts_with(prefix));
        columns.flat_map(|c| self.rows.iter().map(move |r| r[c].abs())).fold(0.0, f64::max)
    }
}

//! Helpers of the tests: the shipped models, the reference folder beside the repository, seeded numbers.
#![allow(dead_code)]

use std::path::PathBuf;

use functional_model::{Model, ModelError};

/// The workspace root.
pub fn root() -> PathBuf {
    let mut at = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    while !at.join("Cargo.lock").exists() {
        assert!(at.pop(), "no workspace above the crate");
    }
    at
}

/// A file of the reference folder beside the workspace. Missing: says so and gives nothing, but fails where CI=true.
pub fn reference(path: &str) -> Option<String> {
    let file = root().join("../shared").join(path);
    match std::fs::read_to_string(&file) {
        Ok(text) => Some(text),
        Err(_) => {
            println!("missing reference file: shared/{path}");
            assert_ne!(std::env::var("CI").as_deref(), Ok("true"), "missing reference file: shared/{path}");
            None
        }
    }
}

/// No files to be had.
pub fn no_files(name: &str) -> Result<String, String> {
    Err(format!("no file '{name}' in this test"))
}

/// Files of schemas/models.
pub fn shipped_files(name: &str) -> Result<String, String> {
    std::fs::read_to_string(root().join("schemas/models").join(name)).map_err(|e| e.to_string())
}

/// A shipped model.
pub fn shipped(name: &str) -> Model {
    let text = shipped_files(name).unwrap();
    show(Model::from_toml(&text, name, &shipped_files))
}

/// A model written in the test.
pub fn model(text: &str) -> Model {
    show(Model::from_toml(&format!("format = \"kingpin-model/1\"\n{text}"), "test", &shipped_files))
}

/// Unwraps, printing every mistake.
pub fn show<T>(result: Result<T, Vec<ModelError>>) -> T {
    match result {
        Ok(v) => v,
        Err(errors) => {
            for e in &errors {
                println!("{e}");
            }
            panic!("{} mistakes", errors.len());
        }
    }
}

/// SplitMix64: seeded, reproducible.
pub struct Random(pub u64);

impl Random {
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }
    /// Uniform in [low, high).
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }
    /// 0..n
    pub fn below(&mut self, n: usize) -> usize {
        (self.next() % n as u64) as usize
    }
    /// Log-uniform.
    pub fn log(&mut self, low: f64, high: f64) -> f64 {
        self.between(low.ln(), high.ln()).exp()
    }
}

/// Largest difference relative to the largest magnitude.
pub fn relative(a: &[f64], b: &[f64]) -> f64 {
    let size = b.iter().chain(a).fold(0.0f64, |m, v| m.max(v.abs()));
    let off = a.iter().zip(b).fold(0.0f64, |m, (x, y)| m.max((x - y).abs()));
    if size == 0.0 { off } else { off / size }
}

//! Functional-model files: the text of a model together with the texts it names (`use = "part.toml"`, tables of a
//! `file`), read once so that composing needs no file. What a model says is read and checked by whoever composes
//! it; here only the names of files are looked at. Blocks of the library (`library/...`) come with the composer.

use crate::bench::TextFile;
use crate::library::Kind;
use crate::load;
use crate::problem::Problems;
use crate::tree::Place;
use serde::{Deserialize, Serialize};

/// Largest model or table file. [bytes]
const BYTES_MAX: u64 = 16 << 20;
/// Most files of one model.
const FILES_MAX: usize = 1000;

/// A model's text and the texts of all files it names.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ModelFiles {
    /// The model: its name in messages, its text.
    pub main: TextFile,
    /// Named files: the name as the model writes it, the text.
    pub parts: Vec<TextFile>,
}

impl ModelFiles {
    /// Reads a model by its path, or a shipped one by its bare name.
    ///
    /// # Errors
    /// The file does not exist or cannot be read. Files it names but that do not exist are left to the composer,
    /// which knows the line.
    pub fn load(reference: &str) -> Result<Self, Problems> {
        Self::at(&load::place_of_argument(reference, Kind::Model)?)
    }

    /// As [`ModelFiles::load`], from a place.
    ///
    /// # Errors
    /// As [`ModelFiles::load`].
    pub fn at(place: &Place) -> Result<Self, Problems> {
        let text = load::read_text(place, BYTES_MAX).map_err(|violation| Problems::one(*violation))?;
        let mut parts: Vec<TextFile> = Vec::new();
        let mut wanted = named(&text);
        while let Some(name) = wanted.pop() {
            if parts.len() >= FILES_MAX || parts.iter().any(|part| part.name == name) {
                continue;
            }
            let found = load::resolve(&name, place, Kind::Model).ok();
            if let Some(text) = found.and_then(|at| load::read_text(&at, BYTES_MAX).ok()) {
                wanted.extend(named(&text));
                parts.push(TextFile { name, text });
            }
        }
        parts.sort_by(|a, b| a.name.cmp(&b.name));
        Ok(Self { main: TextFile { name: place.name(), text }, parts })
    }

    /// Text of a file the model names.
    ///
    /// # Errors
    /// No such file was there when the model was read.
    pub fn part(&self, name: &str) -> Result<String, String> {
        let part = self.parts.iter().find(|part| part.name == name);
        part.map(|part| part.text.clone()).ok_or_else(|| {
            format!("no file '{name}' beside {}, nor a shipped model of that name", self.main.name)
        })
    }
}

/// Files that a text names. A text that is not TOML names none.
fn named(text: &str) -> Vec<String> {
    fn walk(value: &toml::Value, found: &mut Vec<String>) {
        match value {
            toml::Value::Table(table) => {
                for (key, value) in table {
                    match value {
                        toml::Value::String(name) if key == "use" => {
                            if !name.starts_with("model.") && !name.starts_with("library/") {
                                found.push(name.clone());
                            }
                        }
                        toml::Value::String(name) if key == "file" => found.push(name.clone()),
                        _ => walk(value, found),
                    }
                }
            }
            toml::Value::Array(items) => items.iter().for_each(|item| walk(item, found)),
            _ => {}
        }
    }
    let mut found = Vec::new();
    if let Ok(table) = text.parse::<toml::Table>() {
        walk(&toml::Value::Table(table), &mut found);
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_model_brings_the_files_it_names() {
        let directory = tempfile::tempdir().unwrap();
        let at = |name: &str| directory.path().join(name);
        std::fs::write(at("whole.toml"), "[parts.a]\nuse = \"part.toml\"\n[parts.b]\nuse = \"library/mass.toml\"\n[parts.c]\nuse = \"gone.toml\"\n").unwrap();
        std::fs::write(at("part.toml"), "tables.curve = { file = \"curve.csv\" }\n").unwrap();
        std::fs::write(at("curve.csv"), "x [m], value [N]\n0, 0\n1, 1\n").unwrap();
        let files = ModelFiles::load(&at("whole.toml").display().to_string()).unwrap();
        let names: Vec<_> = files.parts.iter().map(|p| p.name.as_str()).collect();
        assert_eq!(names, ["curve.csv", "part.toml"]);
        assert!(files.part("curve.csv").unwrap().starts_with("x [m]"));
        assert!(files.part("gone.toml").is_err());
        assert!(ModelFiles::load("no_such_model").is_err());
        assert!(ModelFiles::load("rack_eps").unwrap().parts.is_empty());
    }
}

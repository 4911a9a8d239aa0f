//! Finished runs, one file each, so that a study that was interrupted goes on where it stopped.
//!
//! A file is made under another name and then renamed: whatever kills the writer, a run is there whole or not at all.
//! Each says which study it belongs to; what belongs to another is not taken over.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde_json::json;

use crate::results::Row;

/// The finished runs of a study in its directory.
#[derive(Debug, Clone)]
pub struct Journal {
    directory: PathBuf,
    hash: String,
}

impl Journal {
    /// Opens the journal in a study's directory, which is made if need be.
    ///
    /// # Errors
    /// What the system says; and if the directory holds runs of another study.
    pub fn open(directory: &Path, hash: &str) -> Result<Self, String> {
        let directory = directory.join("journal");
        let failed = |error: std::io::Error| format!("{}: {error}", directory.display());
        std::fs::create_dir_all(&directory).map_err(failed)?;
        let journal = Journal { directory, hash: hash.to_owned() };
        for (path, other) in journal.files().filter_map(|path| Some((path.clone(), read(&path)?.0))) {
            if other != hash {
                return Err(format!(
                    "{}: holds runs of another study (or of this one before it was changed); name another \
                     directory, or remove it",
                    path.parent().unwrap_or(&path).display()
                ));
            }
        }
        Ok(journal)
    }

    /// The same for one that was opened before: nothing is looked at.
    pub fn open_unchecked(directory: &Path, hash: &str) -> Self {
        Journal { directory: directory.join("journal"), hash: hash.to_owned() }
    }

    /// The finished runs.
    pub fn rows(&self) -> BTreeMap<u64, Row> {
        let rows = self.files().filter_map(|path| read(&path));
        rows.filter(|(hash, _)| *hash == self.hash).map(|(_, row)| (row.run, row)).collect()
    }

    /// Keeps a finished run.
    ///
    /// # Errors
    /// What the system says.
    pub fn keep(&self, row: &Row, wall_s: f64) -> Result<(), String> {
        let path = self.directory.join(format!("{:06}.json", row.run));
        let draft = self.directory.join(format!("{:06}.{}.tmp", row.run, std::process::id()));
        let text = json!({ "study": self.hash, "wall_s": wall_s, "row": row }).to_string();
        std::fs::write(&draft, text)
            .and_then(|()| std::fs::rename(&draft, &path))
            .map_err(|error| format!("{}: {error}", path.display()))
    }

    fn files(&self) -> impl Iterator<Item = PathBuf> {
        let entries = std::fs::read_dir(&self.directory).into_iter().flatten();
        let paths = entries.filter_map(|entry| Some(entry.ok()?.path()));
        paths.filter(|path| path.extension().is_some_and(|extension| extension == "json"))
    }
}

fn read(path: &Path) -> Option<(String, Row)> {
    let mut value: serde_json::Value = serde_json::from_slice(&std::fs::read(path).ok()?).ok()?;
    let row = serde_json::from_value(value.get_mut("row")?.take()).ok()?;
    Some((value.get("study")?.as_str()?.to_owned(), row))
}

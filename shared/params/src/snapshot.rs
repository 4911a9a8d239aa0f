//! Snapshots: all values in a TOML file, for another day, and what differs between two.

use crate::{Kind, LIST, Setting, Values};

/// Why a snapshot cannot be read.
#[derive(Debug)]
pub struct SnapshotError(pub String);

impl std::fmt::Display for SnapshotError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for SnapshotError {}

/// The file's text: a table of paths, one a line, its unit behind it. What a human steers is left out.
pub fn write_snapshot(values: &Values, title: &str) -> String {
    let mut text = format!("# Live parameters: {}\n", title.replace(['\n', '\r'], " "));
    for (parameter, value) in LIST.iter().zip(values).filter(|(p, _)| !p.path.starts_with("human.")) {
        let shown = match parameter.kind {
            Kind::Switch => (if *value == 0.0 { "false" } else { "true" }).to_owned(),
            Kind::Number => format!("{value:?}"),
            Kind::Choice(_) => format!("{:?}", parameter.text(*value)),
        };
        let unit = if parameter.unit == "1" { String::new() } else { format!("  # {}", parameter.unit) };
        text += &format!("\"{}\" = {shown}{unit}\n", parameter.path);
    }
    text
}

/// The settings of a snapshot; paths are checked when they are set.
///
/// # Errors
/// When it is no table of paths with numbers, switches or names.
pub fn read_snapshot(text: &str) -> Result<Vec<(String, Setting)>, SnapshotError> {
    let table: toml::Table = text.parse().map_err(|e: toml::de::Error| SnapshotError(e.to_string()))?;
    table
        .into_iter()
        .map(|(path, value)| {
            let setting = match value {
                toml::Value::Float(number) => Setting::Number(number),
                toml::Value::Integer(number) => Setting::Number(number as f64),
                toml::Value::Boolean(on) => Setting::Switch(on),
                toml::Value::String(text) => Setting::Text(text),
                other => {
                    return Err(SnapshotError(format!("{path} = {other}: must be a number, switch or name")));
                }
            };
            Ok((path, setting))
        })
        .collect()
}

/// Where two sets of values differ: path, first, second.
pub fn difference(a: &Values, b: &Values) -> Vec<(&'static str, f64, f64)> {
    LIST.iter()
        .zip(a.iter().zip(b))
        .filter(|(_, (a, b))| a != b)
        .map(|(parameter, (a, b))| (parameter.path, *a, *b))
        .collect()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::Book;

    #[test]
    fn a_snapshot_reads_back_to_the_same_bits() {
        let defaults = crate::defaults(&config::ResolvedBench::load("growing_slalom_80", &[]).unwrap());
        let mut book = Book::new(defaults);
        let wish = [("unit.assist_scale".to_owned(), Setting::Number(0.1 + 0.2))];
        book.set(&wish, None).unwrap();
        let text = write_snapshot(book.values(), "test\nof lines");
        let mut other = Book::new(defaults);
        other.set(&read_snapshot(&text).unwrap(), None).unwrap();
        assert_eq!(other.values(), book.values());
        assert_eq!(difference(&defaults, other.values()), [("unit.assist_scale", 1.0, 0.1 + 0.2)]);
        assert!(read_snapshot("a = [1]").is_err());
    }
}

//! CSV files of signals over time: a time column, then any others, each name with its unit in brackets where it is
//! not SI: `time_s, hand.T, rack_position [mm]`. Everything wrong is told at once, by line and column.

use super::Wrong;
use config::{Mistake, Problems, Violation};
use functional_model::scale_of;
use std::path::Path;

/// Largest file. [bytes]
const BYTES_MAX: u64 = 1 << 30;

/// Signals over time.
#[derive(Debug, Clone)]
pub struct Series {
    /// The file as the user named it.
    pub name: String,
    /// Times, rising. [s]
    pub time_s: Vec<f64>,
    /// Columns that were read.
    pub columns: Vec<Column>,
}

/// One column.
#[derive(Debug, Clone)]
pub struct Column {
    /// Its header, whole.
    pub header: String,
    /// Its values in SI.
    pub value: Vec<f64>,
}

/// Name and unit of a header.
fn split(header: &str) -> (&str, Option<&str>) {
    match header.strip_suffix(']').and_then(|h| h.rsplit_once('[')) {
        Some((name, unit)) => (name.trim(), Some(unit.trim())),
        None => (header.trim(), None),
    }
}

/// Whether a header is meant by a name: whole, or without its unit.
pub fn means(header: &str, name: &str) -> bool {
    header == name || split(header).0 == name
}

impl Series {
    /// Reads the time and every column for which `wanted` gives the SI unit.
    ///
    /// # Errors
    /// Every violation of the file.
    pub fn read(path: &Path, wanted: impl Fn(&str) -> Option<String>) -> Result<Series, Wrong> {
        let name = path.display().to_string();
        let about = std::fs::metadata(path).map_err(|error| {
            Violation::of_file(Mistake::NotFound, &name, format!("cannot be read: {error}")).to_string()
        })?;
        if about.len() > BYTES_MAX {
            let rule = format!("is too large: {} bytes, at most {BYTES_MAX}", about.len());
            return Err(Violation::of_file(Mistake::Unreadable, &name, rule).to_string());
        }
        let text = std::fs::read_to_string(path).map_err(|error| {
            Violation::of_file(Mistake::Unreadable, &name, format!("cannot be read: {error}")).to_string()
        })?;
        Self::parse(&text, &name, wanted)
    }

    fn parse(text: &str, name: &str, wanted: impl Fn(&str) -> Option<String>) -> Result<Series, Wrong> {
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        let mut problems = Problems::default();
        let violation = |mistake, line: u64, key: &str, value: &str, rule: String| Violation {
            line: u32::try_from(line).unwrap_or(u32::MAX),
            key: key.to_owned(),
            value: value.to_owned(),
            ..Violation::of_file(mistake, name, rule)
        };
        let mut reader = csv::ReaderBuilder::new()
            .flexible(true)
            .comment(Some(b'#'))
            .trim(csv::Trim::All)
            .from_reader(text.as_bytes());
        let headers: Vec<String> = match reader.headers() {
            Ok(headers) => headers.iter().map(str::to_owned).collect(),
            Err(error) => return Err(format!("{name}: {error}")),
        };
        let time = |header: &str| -> Option<f64> {
            match split(header) {
                ("time_s", None) | ("time" | "t", None) => Some(1.0),
                ("time" | "t" | "time_s", Some(unit)) => scale_of(unit, "s").ok(),
                _ => None,
            }
        };
        let Some((time_at, time_scale)) =
            headers.iter().enumerate().find_map(|(k, h)| time(h).map(|scale| (k, scale)))
        else {
            let rule = "no time column: one of time_s, time [s], time [ms]".to_owned();
            return Err(violation(Mistake::MissingKey, 1, "", "", rule).to_string());
        };
        // Place, header, scale.
        let mut read: Vec<(usize, f64)> = Vec::new();
        for (k, header) in headers.iter().enumerate().filter(|(k, _)| *k != time_at) {
            let Some(si) = wanted(header) else { continue };
            if headers[..k].contains(header) {
                let rule = "must not be there twice".to_owned();
                problems.push(violation(Mistake::Rule, 1, header, "", rule));
            }
            match split(header).1.map_or(Ok(1.0), |unit| scale_of(unit, &si)) {
                Ok(scale) => read.push((k, scale)),
                Err(rule) => problems.push(violation(Mistake::Rule, 1, header, "", rule)),
            }
        }
        let mut time_s: Vec<f64> = Vec::new();
        let mut columns: Vec<Column> =
            read.iter().map(|(k, _)| Column { header: headers[*k].clone(), value: Vec::new() }).collect();
        for record in reader.records() {
            let record = match record {
                Ok(record) => record,
                Err(error) => {
                    problems.push(violation(Mistake::Syntax, 0, "", "", error.to_string()));
                    continue;
                }
            };
            let line = record.position().map_or(0, csv::Position::line);
            if record.len() != headers.len() {
                let rule = format!("has {} fields, the header has {}", record.len(), headers.len());
                problems.push(violation(Mistake::WrongLength, line, "", "", rule));
                continue;
            }
            let mut value = |k: usize| match record[k].parse::<f64>() {
                Ok(v) if v.is_finite() => v,
                _ => {
                    let rule = "must be a finite number".to_owned();
                    problems.push(violation(Mistake::NotFinite, line, &headers[k], &record[k], rule));
                    0.0
                }
            };
            let t = value(time_at) * time_scale;
            let values: Vec<f64> = read.iter().map(|(k, scale)| value(*k) * scale).collect();
            if time_s.last().is_some_and(|last| t <= *last) {
                let rule = "must rise from row to row".to_owned();
                problems.push(violation(Mistake::Rule, line, &headers[time_at], &record[time_at], rule));
            }
            time_s.push(t);
            for (column, v) in columns.iter_mut().zip(values) {
                column.value.push(v);
            }
        }
        if time_s.len() < 2 && problems.is_empty() {
            let rule = "needs at least two rows".to_owned();
            problems.push(violation(Mistake::WrongLength, 0, "", "", rule));
        }
        if problems.is_empty() {
            Ok(Series { name: name.to_owned(), time_s, columns })
        } else {
            Err(problems.to_string())
        }
    }

    /// Value of a column at a time: linear between rows, or the row before (`hold`); the ends outside.
    pub fn at(&self, column: usize, t: f64, hold: bool) -> f64 {
        let v = &self.columns[column].value;
        let last = self.time_s.len() - 1;
        if t <= self.time_s[0] {
            return v[0];
        }
        if t >= self.time_s[last] {
            return v[last];
        }
        let i = self.time_s.partition_point(|x| *x <= t) - 1;
        if hold {
            return v[i];
        }
        v[i] + (t - self.time_s[i]) / (self.time_s[i + 1] - self.time_s[i]) * (v[i + 1] - v[i])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_come_in_si_and_mistakes_all_at_once() {
        let wanted = |h: &str| {
            (means(h, "x") || means(h, "F")).then(|| if means(h, "x") { "m".into() } else { "N".into() })
        };
        let s =
            Series::parse("# drive\ntime [ms], x [mm], word, F\n0,1,a,5\n10,3,b,7\n", "IN", wanted).unwrap();
        assert_eq!(s.time_s, [0.0, 0.01]);
        assert!((s.at(0, 0.005, false) - 2e-3).abs() < 1e-15 && s.at(1, 0.005, true) == 5.0);
        let wrong = Series::parse("time_s,x [N],F\n0,1,2\n0,1,nan\n", "IN", wanted).unwrap_err();
        for expected in ["x [N]: 'N' is no unit", "IN:3: time_s = 0: must rise", "IN:3: F = nan: must be"] {
            assert!(wrong.contains(expected), "{expected} not in\n{wrong}");
        }
        assert!(Series::parse("x,F\n1,2\n", "IN", wanted).unwrap_err().contains("no time column"));
    }
}

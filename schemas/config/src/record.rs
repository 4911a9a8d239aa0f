//! Recorded histories: columns of CSV files (and of others, read by whoever loads), scaled to SI and moved to manoeuvre time.
//!
//! Rules for the file: one header line with column names; comma-separated; time in seconds, never falling
//! (equal times happen in real records and are kept; the crate `manoeuvre` averages them); every number
//! finite. The record must cover the run: nothing is held or invented beyond its ends.

use crate::problem::{Mistake, Problems, Violation};
use crate::scenario::Signal;
use crate::validate::closest;
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::path::Path;

/// Largest recorded file. [bytes]
pub const RECORD_BYTES_MAX: u64 = 1 << 30;
/// Kept before and after the run, so that a filter starts settled. [s]
const MARGIN_S: f64 = 2.0;
/// By so much a record may be shorter than the run at each end. [s]
const SHORT_MAX_S: f64 = 0.1;

/// A signal over manoeuvre time.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct TimeSeries {
    /// Times, never falling. [s]
    pub time_s: Vec<f64>,
    /// Values in SI units.
    pub value: Vec<f64>,
}

impl TimeSeries {
    /// Median distance of its samples in time; 0 with fewer than two. [s]
    pub fn median_spacing_s(&self) -> f64 {
        let mut spacing: Vec<f64> = self.time_s.windows(2).map(|pair| pair[1] - pair[0]).collect();
        spacing.sort_by(f64::total_cmp);
        spacing.get(spacing.len() / 2).copied().unwrap_or(0.0)
    }
}

/// A measured signal to be laid over the run's.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MeasuredSignal {
    /// The run's signal.
    pub signal: Signal,
    /// The column's name.
    pub column: String,
    /// The measurement.
    pub series: TimeSeries,
}

/// Everything recorded that a scenario uses.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct RecordedHistory {
    /// Hand-wheel angle, left positive. [rad]
    pub steering_wheel_angle_rad: Option<TimeSeries>,
    /// Target speed. [m/s]
    pub speed_m_s: Option<TimeSeries>,
    /// Measured signals to compare with.
    pub measured: Vec<MeasuredSignal>,
}

/// How a column becomes a series.
pub(crate) struct Wanted<'a> {
    pub(crate) time_column: &'a str,
    pub(crate) column: &'a str,
    /// Added to the time column to give manoeuvre time.
    pub(crate) shift_s: f64,
    pub(crate) scale: f64,
    pub(crate) offset: f64,
    /// Manoeuvre time that must be covered.
    pub(crate) until_s: f64,
}

/// Reads one column of a CSV file.
pub(crate) fn read(path: &Path, wanted: &Wanted<'_>) -> Result<TimeSeries, Problems> {
    let name = path.display().to_string();
    let whole =
        |mistake, rule: String| Problems::one(Violation::of_file(mistake, path.display().to_string(), rule));
    let about = std::fs::metadata(path)
        .map_err(|error| whole(Mistake::NotFound, format!("recorded file cannot be read: {error}")))?;
    if !about.is_file() {
        return Err(whole(Mistake::Unreadable, "is not a regular file".to_owned()));
    }
    if about.len() > RECORD_BYTES_MAX {
        let rule = format!("is too large: {} bytes, at most {RECORD_BYTES_MAX}", about.len());
        return Err(whole(Mistake::Unreadable, rule));
    }
    let file = File::open(path)
        .map_err(|error| whole(Mistake::Unreadable, format!("recorded file cannot be read: {error}")))?;
    read_from(file, &name, wanted)
}

fn read_from(input: impl std::io::Read, name: &str, wanted: &Wanted<'_>) -> Result<TimeSeries, Problems> {
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(input);
    let mut problems = Problems::default();
    let violation = |line: u64, key: &str, value: &str, rule: String| Violation {
        mistake: Mistake::Record,
        file: name.to_owned(),
        line: u32::try_from(line).unwrap_or(u32::MAX),
        column: 0,
        key: key.to_owned(),
        value: value.chars().take(40).collect(),
        rule,
        suggestion: None,
    };
    let csv_rule = |error: &csv::Error| match error.kind() {
        csv::ErrorKind::UnequalLengths { expected_len, len, .. } => {
            format!("has {len} fields where the header has {expected_len}")
        }
        csv::ErrorKind::Utf8 { .. } => "is not UTF-8 text".to_owned(),
        _ => format!("is not CSV: {error}"),
    };
    let header = match reader.headers() {
        Ok(header) => header.clone(),
        Err(error) => return Err(Problems::one(violation(1, "", "", csv_rule(&error)))),
    };
    if header.iter().all(str::is_empty) {
        return Err(Problems::one(violation(0, "", "", "is empty: no header, no rows".to_owned())));
    }
    let mut find = |column: &str| {
        let found = header.iter().position(|title| title == column);
        if found.is_none() {
            let list: Vec<_> = header.iter().take(40).collect();
            let rule = format!("no such column; the file has {}", list.join(", "));
            let meant = closest(column, header.iter());
            problems.push(Violation { suggestion: meant, ..violation(1, column, "", rule) });
        }
        found
    };
    let (Some(time_at), Some(value_at)) = (find(wanted.time_column), find(wanted.column)) else {
        return Err(problems);
    };
    let mut samples = Vec::new();
    let mut previous = f64::NEG_INFINITY;
    let mut rows = 0_u64;
    for row in reader.into_records() {
        rows += 1;
        let row = match row {
            Ok(row) => row,
            Err(error) => {
                let line = error.position().map_or(rows + 1, csv::Position::line);
                problems.push(violation(line, "", "", csv_rule(&error)));
                if matches!(error.kind(), csv::ErrorKind::Io(_)) {
                    break;
                }
                continue;
            }
        };
        let line = row.position().map_or(rows + 1, csv::Position::line);
        let mut number = |at: usize, column: &str| {
            let text = row.get(at).unwrap_or("");
            let value = text.parse::<f64>().ok();
            let rule = match value {
                Some(value) if value.is_finite() => return Some(value),
                Some(_) => "must be a finite number",
                None if text.is_empty() => "is empty; a number is needed",
                None => "must be a number",
            };
            problems.push(violation(line, column, text, rule.to_owned()));
            None
        };
        let (time, value) = (number(time_at, wanted.time_column), number(value_at, wanted.column));
        let (Some(time), Some(value)) = (time, value) else { continue };
        if time < previous {
            let rule = format!("must not fall; the row before has {previous}");
            problems.push(violation(line, wanted.time_column, &time.to_string(), rule));
            continue;
        }
        previous = time;
        samples.push((time, value));
    }
    if rows == 0 {
        problems.push(violation(0, "", "", "is empty: a header, but no rows".to_owned()));
    }
    problems.or(())?;
    cut(samples.into_iter(), name, wanted)
}

/// Reads a record that is not CSV: samples of a column over its time column (`None`: no such format).
pub type ForeignRecord<'a> = dyn Fn(&Path, &str, &str) -> Option<Result<Samples, String>> + 'a;

/// Times and values as recorded.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Samples {
    /// Times. [s]
    pub time_s: Vec<f64>,
    /// Values, in the record's unit.
    pub value: Vec<f64>,
}

/// Makes a series of the samples of a foreign record; what is absent there (not finite) is left out.
pub(crate) fn of_samples(samples: &Samples, name: &str, wanted: &Wanted<'_>) -> Result<TimeSeries, Problems> {
    let whole = |rule: String| {
        let violation = Violation::of_file(Mistake::Record, name, rule);
        Problems::one(Violation { key: wanted.column.to_owned(), ..violation })
    };
    let pairs = samples.time_s.iter().copied().zip(samples.value.iter().copied());
    let sound: Vec<(f64, f64)> = pairs.filter(|(t, v)| t.is_finite() && v.is_finite()).collect();
    if sound.is_empty() {
        return Err(whole("has no finite samples".to_owned()));
    }
    if let Some(pair) = sound.windows(2).find(|pair| pair[1].0 < pair[0].0) {
        return Err(whole(format!("its time must not fall; after {} s comes {} s", pair[0].0, pair[1].0)));
    }
    cut(sound.into_iter(), name, wanted)
}

/// Scales samples, moves them to manoeuvre time and keeps those of the run.
fn cut(
    samples: impl Iterator<Item = (f64, f64)>,
    name: &str,
    wanted: &Wanted<'_>,
) -> Result<TimeSeries, Problems> {
    let mut series = TimeSeries::default();
    let (mut first, mut last) = (f64::INFINITY, f64::NEG_INFINITY);
    for (time, value) in samples {
        let tau = time + wanted.shift_s;
        (first, last) = (first.min(tau), tau);
        if (-MARGIN_S..=wanted.until_s + MARGIN_S).contains(&tau) {
            series.time_s.push(tau);
            series.value.push(value * wanted.scale + wanted.offset);
        }
    }
    let rule = if first > SHORT_MAX_S || last < wanted.until_s - SHORT_MAX_S {
        format!(
            "covers manoeuvre time {first:.2} s to {last:.2} s, but the run needs 0 s to {:.2} s; change \
             duration_s, record.start_s or time_offset_s",
            wanted.until_s
        )
    } else if series.time_s.len() < 2 {
        "has fewer than two samples in the run".to_owned()
    } else {
        return Ok(series);
    };
    let violation = Violation::of_file(Mistake::Record, name, rule);
    Err(Problems::one(Violation { key: wanted.column.to_owned(), ..violation }))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wanted(shift_s: f64, until_s: f64) -> Wanted<'static> {
        Wanted { time_column: "t", column: "x", shift_s, scale: 2.0, offset: 1.0, until_s }
    }

    fn rules(text: &str) -> Vec<String> {
        let problems = read_from(text.as_bytes(), "r.csv", &wanted(0.0, 1.0)).unwrap_err();
        problems.violations.iter().map(ToString::to_string).collect()
    }

    #[test]
    fn a_column_is_scaled_and_moved() {
        let text = "t,y,x\n10,9,1\n10.5,9,2\n10.5,9,3\n11,9,4\n20,9,5\n";
        let series = read_from(text.as_bytes(), "r.csv", &wanted(-10.0, 1.0)).unwrap();
        assert_eq!(series.time_s, [0.0, 0.5, 0.5, 1.0]);
        assert_eq!(series.value, [3.0, 5.0, 7.0, 9.0]);
    }

    #[test]
    fn each_fault_of_a_record_is_told_with_line_and_column() {
        assert!(rules("")[0].contains("is empty"));
        assert!(rules("t,x\n")[0].contains("no rows"));
        assert!(rules("t,y\n0,1\n")[0].starts_with("r.csv:1: x: no such column"));
        assert_eq!(rules("t,x\n0,nan\n1,1\n")[0], "r.csv:2: x = nan: must be a finite number");
        assert_eq!(rules("t,x\n0,a\n1,1\n")[0], "r.csv:2: x = a: must be a number");
        assert_eq!(rules("t,x\n0,1\n1,\n")[0], "r.csv:3: x: is empty; a number is needed");
        assert_eq!(
            rules("t,x\n0,1\n1,1\n0.5,1\n")[0],
            "r.csv:4: t = 0.5: must not fall; the row before has 1"
        );
        assert!(rules("t,x\n0,1\n1,1,1\n")[0].contains("has 3 fields where the header has 2"));
        assert!(rules("t,x\n0,1\n0.5,1\n")[0].contains("the run needs 0 s to 1.00 s"));
        assert_eq!(rules("t,x\n0,a\nb,1\n1,inf\n").len(), 3);
    }
}

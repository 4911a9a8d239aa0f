//! The CSV that says what to solve. Everything wrong with it is told at once, by line and column.

use super::{Wrong, read_text};
use config::{Mistake, Problems, Violation};
use multibody::SuspensionInput;
use std::path::Path;

/// Largest input. [bytes]
const BYTES_MAX: u64 = 512 << 20;
/// Sides as column suffixes.
pub const SIDES: [&str; 2] = ["L", "R"];
/// Load components as column names.
pub const LOADS: [&str; 6] = ["Fxk", "Fyk", "Fzk", "Mxk", "Myk", "Mzk"];

/// One row.
#[derive(Debug, Clone)]
pub struct Row {
    /// Line in the file, from 1.
    pub line: u64,
    /// Its step: the column, else counted from 0.
    pub step: f64,
    /// What is to be solved.
    pub input: SuspensionInput,
}

/// A file of rows, with all its numbers by column.
#[derive(Debug, Clone)]
pub struct Rows {
    /// The file as the user named it.
    pub name: String,
    /// Rows, in file order.
    pub rows: Vec<Row>,
    /// Further columns that were asked for and are there: name and values.
    pub further: Vec<(String, Vec<f64>)>,
}

impl Rows {
    /// A further column.
    pub fn column(&self, name: &str) -> Option<&[f64]> {
        self.further.iter().find(|(n, _)| n == name).map(|(_, values)| values.as_slice())
    }
}

/// Reads the rows. `driven`: rack and heights are required (else absent means 0). `further`: which other
/// columns are read too.
///
/// # Errors
/// Every violation of the file.
pub fn read(path: &Path, driven: bool, further: impl Fn(&str) -> bool) -> Result<Rows, Wrong> {
    let text = read_text(path, BYTES_MAX)?;
    let text = text.strip_prefix('\u{feff}').unwrap_or(&text);
    let name = path.display().to_string();
    let mut problems = Problems::default();
    let violation = |mistake, line: u64, column: usize, key: &str, value: &str, rule: String| Violation {
        mistake,
        file: name.clone(),
        line: u32::try_from(line).unwrap_or(u32::MAX),
        column: u32::try_from(column).unwrap_or(u32::MAX),
        key: key.to_owned(),
        value: value.to_owned(),
        rule,
        suggestion: None,
    };
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .trim(csv::Trim::All)
        .from_reader(text.as_bytes());
    let mut records = reader.records();
    let lines: Vec<&str> = text.lines().collect();
    let place = |line: u64, field: usize| character_column(&lines, line, field);

    let Some(header) = records.next() else {
        return Err(
            violation(Mistake::Syntax, 0, 0, "", "", "is empty: needs a header line".to_owned()).to_string()
        );
    };
    let header = header.map_err(|e| format!("{name}: {e}"))?;
    let header_line = header.position().map_or(1, csv::Position::line);
    let names: Vec<String> = header.iter().map(str::to_owned).collect();
    let known = known_columns();
    for (at, column) in names.iter().enumerate() {
        if names[..at].contains(column) && (known.contains(column) || further(column)) {
            let rule = "must not be there twice".to_owned();
            problems.push(violation(Mistake::Rule, header_line, place(header_line, at), column, "", rule));
        }
        let meant = known.iter().find(|k| k.eq_ignore_ascii_case(column) && *k != column);
        if let Some(meant) = meant.filter(|meant| !names.contains(meant)) {
            let wrong = violation(
                Mistake::UnknownKey,
                header_line,
                place(header_line, at),
                column,
                "",
                "unknown column".to_owned(),
            );
            problems.push(Violation { suggestion: Some(meant.clone()), ..wrong });
        }
    }
    for required in ["rack", "zL", "zR"] {
        if driven && !names.iter().any(|n| n == required) {
            let rule = "column is missing".to_owned();
            problems.push(violation(Mistake::MissingKey, header_line, 0, required, "", rule));
        }
    }
    let place_of = |column: &str| names.iter().position(|n| n == column);
    let places: Vec<Option<usize>> = known.iter().map(|column| place_of(column)).collect();
    let more: Vec<(usize, &String)> =
        names.iter().enumerate().filter(|(_, n)| !known.contains(n) && further(n)).collect();

    let mut rows = Vec::new();
    let mut further_values = vec![Vec::new(); more.len()];
    let mut read_any = false;
    for record in records {
        let record = match record {
            Ok(record) => record,
            Err(error) => {
                problems.push(violation(Mistake::Syntax, 0, 0, "", "", error.to_string()));
                continue;
            }
        };
        read_any = true;
        // A record's position is where the one before ended: blank lines and line ends in between are skipped.
        let begin = record.position().map_or(0, |at| at.byte() as usize).min(text.len());
        let skipped = text.as_bytes()[begin..].iter().take_while(|byte| byte.is_ascii_whitespace()).count();
        let line =
            1 + text.as_bytes()[..begin + skipped].iter().filter(|&&byte| byte == b'\n').count() as u64;
        if record.len() != names.len() {
            let rule = format!("has {} fields, the header has {}", record.len(), names.len());
            problems.push(violation(Mistake::WrongLength, line, 0, "", "", rule));
            continue;
        }
        let mut number = |field: usize| {
            let text = record.get(field).unwrap_or_default();
            let wrong = |mistake, rule: &str| {
                violation(mistake, line, place(line, field), &names[field], text, rule.to_owned())
            };
            match text.parse::<f64>() {
                Ok(value) if value.is_finite() => value,
                Ok(_) => {
                    problems.push(wrong(Mistake::NotFinite, "must be finite"));
                    0.0
                }
                Err(_) if text.is_empty() => {
                    problems.push(wrong(Mistake::WrongType, "must be a number, is empty"));
                    0.0
                }
                Err(_) => {
                    problems.push(wrong(Mistake::WrongType, "must be a number"));
                    0.0
                }
            }
        };
        let mut values = [0.0; 16];
        for (value, place) in values.iter_mut().zip(&places) {
            if let Some(field) = place {
                *value = number(*field);
            }
        }
        for (values, (field, _)) in further_values.iter_mut().zip(&more) {
            values.push(number(*field));
        }
        let step = if places[0].is_some() { values[0] } else { rows.len() as f64 };
        rows.push(Row { line, step, input: input_of(&values) });
    }
    if !read_any {
        problems.push(violation(Mistake::WrongLength, 0, 0, "", "", "has no rows".to_owned()));
    }
    if !problems.is_empty() {
        return Err(problems.to_string());
    }
    let further = more.into_iter().map(|(_, n)| n.clone()).zip(further_values).collect();
    Ok(Rows { name, rows, further })
}

/// Columns that make an input, in the order of [`input_of`].
fn known_columns() -> Vec<String> {
    let mut columns: Vec<String> = ["step", "rack", "zL", "zR"].map(str::to_owned).to_vec();
    for side in SIDES {
        columns.extend(LOADS.iter().map(|load| format!("{load}_{side}")));
    }
    columns
}

fn input_of(values: &[f64; 16]) -> SuspensionInput {
    let vector = |at: usize| spatial::Vector3::new(values[at], values[at + 1], values[at + 2]);
    SuspensionInput {
        rack_m: values[1],
        wheel_height_m: [values[2], values[3]],
        wheel_force_n: [vector(4), vector(10)],
        wheel_moment_n_m: [vector(7), vector(13)],
        ..SuspensionInput::DESIGN
    }
}

/// Column in characters at which a field begins; 0 where quotes make that unclear.
fn character_column(lines: &[&str], line: u64, field: usize) -> usize {
    let at = usize::try_from(line).unwrap_or(0).checked_sub(1);
    let Some(text) = at.and_then(|at| lines.get(at)).filter(|text| !text.contains('"')) else { return 0 };
    let before: usize = text.split(',').take(field).map(|part| part.chars().count() + 1).sum();
    let own = text.split(',').nth(field).unwrap_or_default();
    before + own.chars().take_while(|c| c.is_whitespace()).count() + 1
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read_bytes(text: &str) -> Result<Rows, String> {
        static FILES: std::sync::atomic::AtomicU32 = std::sync::atomic::AtomicU32::new(0);
        let count = FILES.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        let name = format!("kingpin-input-{}-{count}.csv", std::process::id());
        let path = std::env::temp_dir().join(name);
        std::fs::write(&path, text).unwrap();
        let read = read(&path, true, |name| name == "tie_L");
        std::fs::remove_file(&path).unwrap();
        read.map_err(|wrong| wrong.replace(&format!("{}", path.display()), "IN"))
    }

    #[test]
    fn rows_are_read_and_other_columns_are_not() {
        let rows =
            read_bytes("\u{feff}zR, zL,rack,word,Myk_R,tie_L\r\n3,2,1,any,7.5,-4\r\n\r\n0,0,1e-3,,0,5\n")
                .unwrap();
        let first = &rows.rows[0];
        assert_eq!((first.input.rack_m, first.input.wheel_height_m), (1.0, [2.0, 3.0]));
        assert_eq!(first.input.wheel_moment_n_m[1].y, 7.5);
        assert_eq!((rows.rows[1].line, rows.rows[1].step, rows.rows[1].input.rack_m), (4, 1.0, 1e-3));
        assert_eq!(rows.column("tie_L").unwrap(), [-4.0, 5.0]);
    }

    #[test]
    fn everything_wrong_is_told_at_once_with_its_place() {
        let wrong = read_bytes("rack,zL,fxk_l,zL\n0,NaN,1,0\n0, x,1,0\n0,0\n,inf,0,0\n").unwrap_err();
        for expected in [
            "IN:1: zR: column is missing",
            "IN:1:9: fxk_l: unknown column",
            "did you mean `Fxk_L`",
            "IN:1:15: zL: must not be there twice",
            "IN:2:3: zL = NaN: must be finite",
            "IN:3:4: zL = x: must be a number",
            "IN:4: has 2 fields, the header has 4",
            "IN:5:1: rack: must be a number, is empty",
            "IN:5:2: zL = inf: must be finite",
        ] {
            assert!(wrong.contains(expected), "{expected} not in\n{wrong}");
        }
        assert_eq!(read_bytes("").unwrap_err(), "IN: is empty: needs a header line");
        assert_eq!(read_bytes("rack,zL,zR\n").unwrap_err(), "IN: has no rows");
    }
}

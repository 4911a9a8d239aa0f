//! A table of numbers as CSV text: named columns, every violation at once with file, line, column name and rule.
//!
//! Rules: one header line with column names, in any order; comma-separated; lines that start with `#` are comments;
//! every cell of a column that is read must be a finite number; other columns are not read and reported as such.

use crate::problem::{Mistake, Problems, Violation};
use crate::validate::closest;

/// The columns of a table that were asked for.
#[derive(Debug, Clone, PartialEq)]
pub struct NumberTable {
    file: String,
    lines: Vec<u32>,
    columns: Vec<(String, Vec<f64>)>,
    ignored: Vec<String>,
}

impl NumberTable {
    /// Reads the `required` and, where they are there, the `optional` columns of `text`; `file` is for messages.
    ///
    /// # Errors
    /// Columns that are missing or there twice, rows of another length, cells that are not finite numbers, no rows.
    pub fn read(text: &str, file: &str, required: &[&str], optional: &[&str]) -> Result<Self, Problems> {
        let mut table =
            Self { file: file.to_owned(), lines: Vec::new(), columns: Vec::new(), ignored: Vec::new() };
        let mut problems = Problems::default();
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        let mut reader = csv::ReaderBuilder::new()
            .has_headers(false)
            .flexible(true)
            .trim(csv::Trim::All)
            .comment(Some(b'#'))
            .from_reader(text.as_bytes());
        let mut record = csv::StringRecord::new();
        let header = match reader.read_record(&mut record) {
            Ok(true) => record.clone(),
            Ok(false) => {
                let rule = "is empty: needs a line of column names".to_owned();
                return Err(Problems::one(table.told(Mistake::Syntax, 0, "", "", rule)));
            }
            Err(error) => {
                return Err(Problems::one(table.told(Mistake::Syntax, 1, "", "", error.to_string())));
            }
        };
        let mut counter = LineCounter { text: text.as_bytes(), at: 0, line: 1 };
        let header_line = counter.line_of(&header);
        let mut places = Vec::new();
        for (name, needed) in
            required.iter().map(|name| (*name, true)).chain(optional.iter().map(|name| (*name, false)))
        {
            let mut found = header.iter().enumerate().filter(|(_, title)| *title == name);
            match (found.next(), found.next()) {
                (Some((at, _)), None) => {
                    places.push(at);
                    table.columns.push((name.to_owned(), Vec::new()));
                }
                (Some(_), Some(_)) => {
                    let rule = "column must not be there twice".to_owned();
                    problems.push(table.told(Mistake::Rule, header_line, name, "", rule));
                }
                (None, _) if needed => {
                    let unknown = header.iter().filter(|title| !required.contains(title));
                    let suggestion = closest(name, unknown).filter(|_| !header.is_empty());
                    let told = table.told(
                        Mistake::MissingKey,
                        header_line,
                        name,
                        "",
                        "column is missing".to_owned(),
                    );
                    problems.push(Violation { suggestion, ..told });
                }
                (None, _) => {}
            }
        }
        let read = |title: &&str| !required.contains(title) && !optional.contains(title);
        table.ignored = header.iter().filter(read).map(str::to_owned).collect();
        loop {
            match reader.read_record(&mut record) {
                Ok(true) => {}
                Ok(false) => break,
                Err(error) => {
                    problems.push(table.told(Mistake::Syntax, 0, "", "", error.to_string()));
                    break;
                }
            }
            let line = counter.line_of(&record);
            if record.len() != header.len() {
                let rule = format!("has {} cells, the first line has {}", record.len(), header.len());
                problems.push(table.told(Mistake::WrongLength, line, "", "", rule));
                continue;
            }
            table.lines.push(line);
            for (k, at) in places.iter().enumerate() {
                let cell = record.get(*at).unwrap_or_default();
                let (mistake, rule) = match cell.parse::<f64>() {
                    Ok(value) if value.is_finite() => {
                        table.columns[k].1.push(value);
                        continue;
                    }
                    Ok(_) => (Mistake::NotFinite, "must be a finite number"),
                    Err(_) if cell.is_empty() => (Mistake::WrongType, "must be a number, is empty"),
                    Err(_) => (Mistake::WrongType, "must be a number"),
                };
                table.columns[k].1.push(f64::NAN);
                problems.push(table.told(mistake, line, &table.columns[k].0, cell, rule.to_owned()));
            }
        }
        if table.lines.is_empty() && problems.is_empty() {
            problems.push(table.told(Mistake::WrongLength, 0, "", "", "has no rows".to_owned()));
        }
        if problems.is_empty() { Ok(table) } else { Err(problems) }
    }

    /// Number of rows, at least 1.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.lines.len()
    }

    /// The values of a column, `None` when the file has none of that name (or it was not asked for).
    #[must_use]
    pub fn column(&self, name: &str) -> Option<&[f64]> {
        self.columns.iter().find(|(title, _)| title == name).map(|(_, values)| values.as_slice())
    }

    /// Names of the columns that were not read.
    #[must_use]
    pub fn ignored(&self) -> &[String] {
        &self.ignored
    }

    /// A violation at a cell.
    #[must_use]
    pub fn violation(&self, row: usize, column: &str, rule: impl Into<String>) -> Violation {
        let value = self.column(column).and_then(|values| values.get(row)).map(ToString::to_string);
        let line = self.lines.get(row).copied().unwrap_or(0);
        self.told(Mistake::Rule, line, column, &value.unwrap_or_default(), rule.into())
    }

    /// A violation of the table as a whole.
    #[must_use]
    pub fn violation_of_header(&self, rule: impl Into<String>) -> Violation {
        self.told(Mistake::Rule, 1, "", "", rule.into())
    }

    fn told(&self, mistake: Mistake, line: u32, key: &str, value: &str, rule: String) -> Violation {
        Violation {
            line,
            key: key.to_owned(),
            value: value.chars().take(40).collect(),
            ..Violation::of_file(mistake, self.file.clone(), rule)
        }
    }
}

/// Lines of records. A record's own position is where the one before it ended: blank lines and comments that stand
/// between them are not counted in.
struct LineCounter<'a> {
    text: &'a [u8],
    at: usize,
    line: u32,
}

impl LineCounter<'_> {
    fn line_of(&mut self, record: &csv::StringRecord) -> u32 {
        let begin = record.position().map_or(0, |at| at.byte() as usize).min(self.text.len());
        while self.at < begin {
            self.line += u32::from(self.text[self.at] == b'\n');
            self.at += 1;
        }
        while let Some(byte) = self.text.get(self.at) {
            match byte {
                b'\n' => self.line += 1,
                b'#' => {
                    self.at += self.text[self.at..].iter().take_while(|byte| **byte != b'\n').count();
                    continue;
                }
                b'\r' | b' ' | b'\t' => {}
                _ => break,
            }
            self.at += 1;
        }
        self.line
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wrong(text: &str) -> String {
        NumberTable::read(text, "t.csv", &["a", "b"], &["c"]).unwrap_err().to_string()
    }

    #[test]
    fn columns_come_in_any_order_and_others_are_reported() {
        let text = "\u{feff}x, b ,a\n# a comment\nword,2,1e3\r\n,-4,3\n";
        let table = NumberTable::read(text, "t.csv", &["a", "b"], &["c"]).unwrap();
        assert_eq!(table.column("a").unwrap(), [1e3, 3.0]);
        assert_eq!(table.column("b").unwrap(), [2.0, -4.0]);
        assert_eq!((table.column("c"), table.ignored(), table.rows()), (None, &["x".to_owned()][..], 2));
        assert_eq!(table.violation(1, "b", "must be >= 0").to_string(), "t.csv:4: b = -4: must be >= 0");
    }

    #[test]
    fn everything_wrong_is_told_at_once() {
        let all = wrong("A,b,b\n1,2,3\n");
        assert!(all.contains("t.csv:1: a: column is missing"), "{all}");
        assert!(all.contains("did you mean `A`"), "{all}");
        assert!(all.contains("t.csv:1: b: column must not be there twice"), "{all}");
        let all = wrong("a,b\n1,inf\n1\n,x\n");
        for told in [
            "t.csv:2: b = inf: must be a finite number",
            "t.csv:3: has 1 cells, the first line has 2",
            "t.csv:4: a: must be a number, is empty",
            "t.csv:4: b = x: must be a number",
        ] {
            assert!(all.contains(told), "{told} is not in\n{all}");
        }
        assert!(wrong("").contains("is empty"));
        assert!(wrong("a,b\n").contains("has no rows"));
    }
}

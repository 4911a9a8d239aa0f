//! CSV files of numbers, as the commands write them and as the reference data has them.

use std::path::Path;

/// Columns by name.
pub struct Table {
    /// Names, in the file's order.
    pub names: Vec<String>,
    /// Rows of values.
    pub rows: Vec<Vec<f64>>,
}

#[allow(clippy::unwrap_used, clippy::panic)]
impl Table {
    /// # Panics
    /// When it is not a table of numbers.
    pub fn parse(text: &str) -> Self {
        let mut lines = text.lines();
        let names = lines.next().unwrap().split(',').map(str::to_owned).collect();
        let rows = lines.map(|l| l.split(',').map(|x| x.parse().unwrap()).collect()).collect();
        Self { names, rows }
    }

    /// # Panics
    /// When there is no such file, or it is not a table of numbers.
    pub fn read(path: &Path) -> Self {
        Self::parse(&std::fs::read_to_string(path).unwrap())
    }

    /// Whether there is such a column.
    pub fn has(&self, name: &str) -> bool {
        self.names.iter().any(|n| n == name)
    }

    /// # Panics
    /// When there is no such column.
    pub fn column(&self, name: &str) -> Vec<f64> {
        let at = self.names.iter().position(|n| n == name).unwrap_or_else(|| panic!("no column {name}"));
        self.rows.iter().map(|row| row[at]).collect()
    }

    /// Last value of a column.
    ///
    /// # Panics
    /// When there is no such column, or no row.
    pub fn last(&self, name: &str) -> f64 {
        *self.column(name).last().unwrap()
    }

    /// Largest |value| of the columns whose name starts with `prefix`.
    pub fn peak(&self, prefix: &str) -> f64 {
        let of = self.names.iter().enumerate().filter(|(_, n)| n.starts_with(prefix));
        of.flat_map(|(at, _)| self.rows.iter().map(move |row| row[at].abs())).fold(0.0, f64::max)
    }
}

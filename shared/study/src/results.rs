//! The rows of a study, and what is made of them: a table in Parquet and CSV, a page.

use std::io::{BufWriter, Write};
use std::path::Path;

use record::{LogError, TableColumn, TableValues, table_csv, table_parquet};
use report::{StudyColumn, study_html};
use serde::{Deserialize, Serialize};

use crate::draw::Prepared;

/// A parameter of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Cell {
    /// A number.
    Number(f64),
    /// A text.
    Text(String),
}

/// A run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// Its number, from 0.
    pub run: u64,
    /// Seed of everything random in it.
    pub seed: u64,
    /// Its parameters, in the order of the study.
    pub parameters: Vec<Cell>,
    /// Its figures, in the order of the study; none where there is none.
    pub metrics: Vec<Option<f64>>,
    /// What is wrong with it; empty if nothing is.
    pub error: String,
}

/// The table of a study: `run`, `seed`, the parameters, the figures, `error`; by number of the run.
pub fn columns(prepared: &Prepared, rows: &[Row]) -> Vec<TableColumn> {
    let column = |name: &str, values| TableColumn { name: name.to_owned(), values };
    let mut columns = vec![
        column("run", TableValues::Integers(rows.iter().map(|row| row.run).collect())),
        column("seed", TableValues::Integers(rows.iter().map(|row| row.seed).collect())),
    ];
    for (p, parameter) in prepared.study.parameter.iter().enumerate() {
        let texts = matches!(parameter.values, config::study::Values::Texts { .. });
        let cells = rows.iter().map(|row| row.parameters.get(p));
        let values = if texts {
            let text = |cell: Option<&Cell>| match cell {
                Some(Cell::Text(text)) => text.clone(),
                _ => String::new(),
            };
            TableValues::Texts(cells.map(text).collect())
        } else {
            let number = |cell: Option<&Cell>| match cell {
                Some(Cell::Number(number)) => *number,
                _ => f64::NAN,
            };
            TableValues::Numbers(cells.map(number).collect())
        };
        columns.push(column(&parameter.name, values));
    }
    for (m, metric) in prepared.study.metric.iter().enumerate() {
        let values = rows.iter().map(|row| row.metrics.get(m).copied().flatten().unwrap_or(f64::NAN));
        columns.push(column(metric.name(), TableValues::Numbers(values.collect())));
    }
    columns.push(column("error", TableValues::Texts(rows.iter().map(|row| row.error.clone()).collect())));
    columns
}

/// Writes `results.parquet`, `results.csv` and `report.html`, each whole or not at all. The rows are sorted by number.
///
/// # Errors
/// For an output that refuses.
pub fn write_results(prepared: &Prepared, rows: &mut [Row], directory: &Path) -> Result<(), LogError> {
    rows.sort_by_key(|row| row.run);
    let table = columns(prepared, rows);
    let study = &prepared.study;
    let about = [
        ("kingpin.study".to_owned(), serde_json::to_string(study).unwrap_or_default()),
        ("kingpin.study_hash".to_owned(), prepared.hash.clone()),
    ];
    whole(&directory.join("results.parquet"), |out| table_parquet(&table, &about, out))?;
    whole(&directory.join("results.csv"), |out| table_csv(&table, out))?;
    let parts = |from: usize, count: usize| -> Vec<StudyColumn<'_>> {
        let part = table.iter().skip(from).take(count);
        part.filter_map(|column| match &column.values {
            TableValues::Numbers(values) => Some(StudyColumn { name: &column.name, values }),
            _ => None,
        })
        .collect()
    };
    let errors: Vec<(u64, &str)> =
        rows.iter().filter(|row| !row.error.is_empty()).map(|row| (row.run, row.error.as_str())).collect();
    let page = study_html(
        &study.name,
        &[
            study.description.clone(),
            format!(
                "{} of {} runs, {} with an error; scenario {}; seed {}",
                rows.len(),
                prepared.runs(),
                errors.len(),
                study.scenario,
                study.seed
            ),
        ],
        &parts(2, study.parameter.len()),
        &parts(2 + study.parameter.len(), study.metric.len()),
        &errors,
    );
    whole(&directory.join("report.html"), |out| {
        out.write_all(page.as_bytes()).map_err(|error| LogError::Output(error.to_string()))
    })
}

fn whole(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<std::fs::File>) -> Result<(), LogError>,
) -> Result<(), LogError> {
    let failed = |error: std::io::Error| LogError::Output(format!("{}: {error}", path.display()));
    let draft = path.with_extension("tmp");
    let mut out = BufWriter::new(std::fs::File::create(&draft).map_err(failed)?);
    write(&mut out)?;
    out.flush().map_err(failed)?;
    std::fs::rename(&draft, path).map_err(failed)
}

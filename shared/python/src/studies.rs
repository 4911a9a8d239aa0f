//! Parameter studies.

use crate::fault;
use crate::log::signalled;
use config::study::Study;
use pyo3::prelude::*;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use study::{Interrupted, Journal, Prepared, Row, write_results};

pub(crate) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<NativeStudy>()
}

/// A study, ready to be run.
#[pyclass(frozen, module = "kingpin._native")]
struct NativeStudy {
    prepared: Prepared,
    stop: AtomicBool,
}

fn row_of(text: &str) -> PyResult<Row> {
    serde_json::from_str(text).map_err(|error| fault::value(format!("not a row of a study: {error}")))
}

fn text_of(row: &Row) -> String {
    serde_json::to_string(row).unwrap_or_default()
}

#[pymethods]
impl NativeStudy {
    #[new]
    fn new(py: Python<'_>, reference: &str, overrides: Vec<String>) -> PyResult<Self> {
        let made = py.detach(|| {
            let study = config::load_with::<Study>(reference, &overrides)?.value;
            Prepared::new(study)
        });
        let prepared = made.map_err(|problems| fault::of_problems(py, &problems))?;
        Ok(NativeStudy { prepared, stop: AtomicBool::new(false) })
    }

    /// Its name.
    #[getter]
    fn name(&self) -> String {
        self.prepared.study.name.clone()
    }

    /// What tells it from every other.
    #[getter]
    fn hash(&self) -> String {
        self.prepared.hash.clone()
    }

    /// Number of runs.
    #[getter]
    fn runs(&self) -> u64 {
        self.prepared.runs()
    }

    /// Names of the parameters.
    #[getter]
    fn parameters(&self) -> Vec<String> {
        self.prepared.study.parameter.iter().map(|parameter| parameter.name.clone()).collect()
    }

    /// Names of the figures.
    #[getter]
    fn metrics(&self) -> Vec<String> {
        self.prepared.study.metric.iter().map(|metric| metric.name().to_owned()).collect()
    }

    /// What is laid over the scenario for a run.
    fn overrides(&self, run: u64) -> Vec<String> {
        self.prepared.overrides(run)
    }

    /// Makes a run; its row as JSON.
    fn evaluate(&self, py: Python<'_>, run: u64) -> PyResult<String> {
        if run >= self.prepared.runs() {
            return Err(fault::value(format!("run = {run}: must be below {}", self.prepared.runs())));
        }
        let mut raised = None;
        let row = py.detach(|| {
            self.prepared.evaluate(run, |_, _| {
                if self.stop.load(Ordering::Relaxed) {
                    return Err(Interrupted);
                }
                signalled(&mut raised)
            })
        });
        match row {
            Ok(row) => Ok(text_of(&row)),
            Err(Interrupted) => Err(raised.unwrap_or_else(|| fault::broken("stopped"))),
        }
    }

    /// Ends the runs that are being made in other threads.
    fn stop(&self) {
        self.stop.store(true, Ordering::Relaxed);
    }

    /// The row of a run that could not be made, as JSON.
    fn failed(&self, run: u64, error: String) -> String {
        text_of(&Row {
            run,
            seed: self.prepared.seed(run),
            parameters: self.prepared.parameters(run),
            metrics: vec![None; self.prepared.study.metric.len()],
            error,
        })
    }

    /// The rows that a directory has already.
    fn finished(&self, directory: PathBuf) -> PyResult<Vec<String>> {
        let journal = Journal::open(&directory, &self.prepared.hash).map_err(fault::value)?;
        Ok(journal.rows().values().map(text_of).collect())
    }

    /// Keeps a row in a directory.
    fn keep(&self, directory: PathBuf, row: &str, wall_s: f64) -> PyResult<()> {
        let journal = Journal::open_unchecked(&directory, &self.prepared.hash);
        journal.keep(&row_of(row)?, wall_s).map_err(fault::broken)
    }

    /// Writes table and page of rows into a directory.
    fn write(&self, py: Python<'_>, rows: Vec<String>, directory: PathBuf) -> PyResult<()> {
        let mut rows = rows.iter().map(|row| row_of(row)).collect::<PyResult<Vec<_>>>()?;
        py.detach(|| write_results(&self.prepared, &mut rows, &directory))
            .map_err(|error| fault::of_log(&error))
    }
}

//! Logs, read from files or made by a run in this process.

use crate::{fault, words_out};
use config::ResolvedBench;
use pyo3::prelude::*;
use pyo3::types::PyByteArray;
use record::{CsvOptions, Decimation, LogReader, Mf4Options, RegionLog};
use regions::Kind;
use report::{Limits, assessment_json, summarise};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::PathBuf;
use study::{Interrupted, RunFault, judge};

pub(crate) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<NativeLog>()?;
    module.add_function(wrap_pyfunction!(open_log, module)?)?;
    module.add_function(wrap_pyfunction!(run, module)?)
}

/// A log.
#[pyclass(frozen, module = "kingpin._native")]
struct NativeLog {
    log: LogReader,
}

impl NativeLog {
    fn region(&self, name: &str) -> PyResult<&RegionLog> {
        self.log.region(name).map_err(|error| fault::of_log(&error))
    }
}

#[pymethods]
impl NativeLog {
    /// Region, column, whether it is a counter, unit and comment of every signal.
    fn columns(&self) -> Vec<(String, String, bool, String, String)> {
        let mut all = Vec::new();
        for region in self.log.regions() {
            let docs = regions::REGIONS
                .iter()
                .filter(|known| known.name == region.name)
                .flat_map(|known| known.layout.columns())
                .map(|column| (column.name, column.doc))
                .collect::<Vec<_>>();
            for column in &region.columns {
                let doc = docs.iter().find(|(name, _)| *name == column.name).map_or("", |(_, doc)| *doc);
                all.push((
                    region.name.clone(),
                    column.name.clone(),
                    column.kind == Kind::U64,
                    column.unit.clone(),
                    doc.to_owned(),
                ));
            }
        }
        all
    }

    /// Ticks of a region.
    fn ticks<'py>(&self, py: Python<'py>, region: &str) -> PyResult<Bound<'py, PyByteArray>> {
        Ok(words_out(py, self.region(region)?.ticks.iter().copied()))
    }

    /// Words of a column.
    fn column<'py>(&self, py: Python<'py>, region: &str, column: &str) -> PyResult<Bound<'py, PyByteArray>> {
        let region = self.region(region)?;
        let index = region.column_index(column).map_err(|error| fault::of_log(&error))?;
        Ok(words_out(py, region.words_of(index).into_iter()))
    }

    /// The header as JSON.
    fn header(&self) -> String {
        serde_json::to_string(&self.log.header).unwrap_or_default()
    }

    /// The resolved configuration as JSON.
    fn configuration(&self) -> String {
        self.log.header.configuration.clone()
    }

    /// The configuration's files: name and text.
    fn sources(&self) -> Vec<(String, String)> {
        self.log.header.sources.iter().map(|source| (source.name.clone(), source.text.clone())).collect()
    }

    /// Events: tick, time, kind, detail.
    fn events(&self) -> Vec<(u64, f64, String, String)> {
        let events = self.log.events.iter();
        events.map(|event| (event.tick, event.time_s, event.kind.clone(), event.text())).collect()
    }

    /// The figures of `summary.json` as JSON.
    fn summary(&self, py: Python<'_>) -> String {
        py.detach(|| {
            serde_json::to_string(&summarise(&self.log, &[], &Limits::default())).unwrap_or_default()
        })
    }

    /// What the run says by the procedure of its scenario, as JSON.
    fn assess(&self, py: Python<'_>) -> PyResult<String> {
        let resolved = ResolvedBench::from_json(&self.log.header.configuration)
            .map_err(|problems| fault::of_problems(py, &problems))?;
        let assessment = py.detach(|| judge::assess(&self.log, &resolved)).map_err(fault::broken)?;
        Ok(assessment_json(&assessment).to_string())
    }

    /// Writes the log in another format.
    fn export(
        &self,
        py: Python<'_>,
        path: PathBuf,
        format: &str,
        selection: Vec<String>,
        every: u64,
        mean: bool,
    ) -> PyResult<u64> {
        let method = if mean { Decimation::Mean } else { Decimation::Pick };
        let written = py.detach(|| -> Result<u64, String> {
            let log = self.log.clone().thinned(every, method);
            let told = |error: std::io::Error| format!("{}: {error}", path.display());
            let mut out = BufWriter::with_capacity(1 << 20, File::create(&path).map_err(told)?);
            let rows = match format {
                "csv" => {
                    record::export_csv(&log, &CsvOptions { selection, ..CsvOptions::default() }, &mut out)
                }
                "mf4" => record::export_mf4(&log, &Mf4Options { selection, decimation: 1 }, &mut out),
                "parquet" => record::export_parquet(&log, &selection, &mut out),
                "mcap" => record::export_mcap(&log, &selection, &mut out),
                other => return Err(format!("format = {other}: must be csv, mf4, parquet or mcap")),
            };
            let rows = rows.map_err(|error| error.to_string())?;
            out.flush().map_err(told)?;
            Ok(rows)
        });
        written.map_err(fault::LogError::new_err)
    }
}

/// Reads a log file, or all of a run's directory; of some regions, or all.
#[pyfunction]
fn open_log(py: Python<'_>, path: PathBuf, regions: Option<Vec<String>>) -> PyResult<NativeLog> {
    let wanted = |name: &str| regions.as_ref().is_none_or(|wanted| wanted.iter().any(|w| w == name));
    let log = py.detach(|| LogReader::open_regions(&path, wanted));
    Ok(NativeLog { log: log.map_err(|error| fault::of_log(&error))? })
}

/// Looks for signals; with the interpreter let go, so it takes it for a moment.
pub(crate) fn signalled(raised: &mut Option<PyErr>) -> Result<(), Interrupted> {
    match Python::attach(|py| py.check_signals()) {
        Ok(()) => Ok(()),
        Err(error) => {
            *raised = Some(error);
            Err(Interrupted)
        }
    }
}

/// Makes a run in lockstep in this process. `progress`, if given, is called with ticks done and all ticks about ten
/// times a second of the simulation.
#[pyfunction]
fn run(
    py: Python<'_>,
    scenario: &str,
    overrides: Vec<String>,
    progress: Option<Py<PyAny>>,
) -> PyResult<NativeLog> {
    let loaded = py.detach(|| ResolvedBench::load(scenario, &overrides));
    let resolved = loaded.map_err(|problems| fault::of_problems(py, &problems))?;
    let mut raised: Option<PyErr> = None;
    let made = py.detach(|| {
        study::run(&resolved, |done, all| {
            signalled(&mut raised)?;
            if let Some(progress) = &progress
                && let Err(error) = Python::attach(|py| progress.call1(py, (done, all)))
            {
                raised = Some(error);
                return Err(Interrupted);
            }
            Ok(())
        })
    });
    match made {
        Ok(log) => Ok(NativeLog { log }),
        Err(RunFault::Interrupted) => Err(raised.unwrap_or_else(|| fault::ours("ended early"))),
        Err(error) => Err(fault::broken(error)),
    }
}

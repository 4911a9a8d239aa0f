//! Errors as Python exceptions.

use config::Problems;
use pyo3::create_exception;
use pyo3::exceptions::{PyException, PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

create_exception!(kingpin, KingpinError, PyException, "What every error of this package is.");
create_exception!(
    kingpin,
    ConfigError,
    KingpinError,
    "Wrong input. `violations`: a list of dicts with file, line, column, key, value, rule, mistake, suggestion; all at once."
);
create_exception!(kingpin, RunError, KingpinError, "A run or a model that broke off.");
create_exception!(
    kingpin,
    LogError,
    KingpinError,
    "A log that cannot be read, or a signal it does not have."
);

pub(crate) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let py = module.py();
    module.add("KingpinError", py.get_type::<KingpinError>())?;
    module.add("ConfigError", py.get_type::<ConfigError>())?;
    module.add("RunError", py.get_type::<RunError>())?;
    module.add("LogError", py.get_type::<LogError>())
}

/// All that is wrong with the user's input.
pub(crate) fn of_problems(py: Python<'_>, problems: &Problems) -> PyErr {
    let error = ConfigError::new_err(problems.to_string());
    let listed = || -> PyResult<()> {
        let list = PyList::empty(py);
        for violation in &problems.violations {
            let dict = PyDict::new(py);
            let mistake = serde_json::to_value(violation.mistake).unwrap_or_default();
            dict.set_item("file", &violation.file)?;
            dict.set_item("line", violation.line)?;
            dict.set_item("column", violation.column)?;
            dict.set_item("key", &violation.key)?;
            dict.set_item("value", &violation.value)?;
            dict.set_item("rule", &violation.rule)?;
            dict.set_item("mistake", mistake.as_str())?;
            dict.set_item("suggestion", violation.suggestion.as_deref())?;
            list.append(dict)?;
        }
        error.value(py).setattr("violations", list)
    };
    listed().err().unwrap_or(error)
}

/// Wrong input told as text.
pub(crate) fn of_text(py: Python<'_>, text: &str) -> PyErr {
    let error = ConfigError::new_err(text.to_owned());
    let set = error.value(py).setattr("violations", PyList::empty(py));
    set.err().unwrap_or(error)
}

pub(crate) fn of_log(error: &record::LogError) -> PyErr {
    LogError::new_err(error.to_string())
}

pub(crate) fn broken(error: impl std::fmt::Display) -> PyErr {
    RunError::new_err(error.to_string())
}

pub(crate) fn value(text: impl Into<String>) -> PyErr {
    PyValueError::new_err(text.into())
}

/// What our own mistakes become.
pub(crate) fn ours(text: impl Into<String>) -> PyErr {
    PyRuntimeError::new_err(text.into())
}

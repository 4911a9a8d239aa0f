//! The native half of the Python package `kingpin`; `kingpin/__init__.py` is what people see.
//!
//! Numbers cross as bytes, 8 a value, little endian, which numpy takes without looking at them; structures cross as JSON.
//! So nothing here is built against numpy, and one wheel serves every Python from 3.9 on (abi3). Whatever takes long lets
//! go of the interpreter, and looks every 256 ticks whether a signal (Ctrl-C) came.

mod fault;
mod log;
mod physics;
mod studies;

use pyo3::prelude::*;

/// Words as bytes for `numpy.frombuffer`; a bytearray, so that the array can be written to.
pub(crate) fn words_out<'py>(
    py: Python<'py>,
    words: impl Iterator<Item = u64>,
) -> Bound<'py, pyo3::types::PyByteArray> {
    let bytes: Vec<u8> = words.flat_map(u64::to_le_bytes).collect();
    pyo3::types::PyByteArray::new(py, &bytes)
}

/// Numbers as bytes for `numpy.frombuffer`.
pub(crate) fn numbers_out<'py>(py: Python<'py>, values: &[f64]) -> Bound<'py, pyo3::types::PyByteArray> {
    words_out(py, values.iter().map(|value| value.to_bits()))
}

/// Numbers out of the bytes of a contiguous array of doubles.
pub(crate) fn numbers_in(bytes: &[u8]) -> Vec<f64> {
    bytes.as_chunks::<8>().0.iter().map(|chunk| f64::from_le_bytes(*chunk)).collect()
}

#[pymodule]
fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    fault::register(module)?;
    log::register(module)?;
    physics::register(module)?;
    studies::register(module)
}

//! Maps core errors to `ocplanner.errors`.

use ocplanner_core::error::Error;
use pyo3::prelude::*;

/// Turns a core error into the Python exception of the same meaning.
pub fn to_python(py: Python<'_>, error: &Error) -> PyErr {
    let name = match error {
        Error::Shape { .. } => "ShapeError",
        _ => "InvalidValueError",
    };
    match py.import("ocplanner.errors").and_then(|module| module.getattr(name)?.call1((error.to_string(),))) {
        Ok(exception) => PyErr::from_value(exception),
        Err(import_error) => import_error,
    }
}

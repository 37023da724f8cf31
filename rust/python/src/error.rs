//! Maps core errors to `ocplanner.errors`.

use ocplanner_core::error::Error;
use pyo3::prelude::*;

/// The Python exception for a core error.
pub fn to_python(py: Python<'_>, error: &Error) -> PyErr {
    let name = match error {
        Error::Shape { .. } => "ShapeError",
        Error::ModelFile { .. } => "ModelFileError",
        _ => "InvalidValueError",
    };
    named(py, name, error.to_string())
}

/// A `ShapeError`.
pub fn shape_error(py: Python<'_>, message: String) -> PyErr {
    named(py, "ShapeError", message)
}

/// The exception `ocplanner.errors.<class>`.
pub fn named(py: Python<'_>, class: &str, message: String) -> PyErr {
    match py.import("ocplanner.errors").and_then(|module| module.getattr(class)?.call1((message,))) {
        Ok(exception) => PyErr::from_value(exception),
        Err(import_error) => import_error,
    }
}

/// An `UnknownNameError` that lists the known names.
pub fn unknown_name(py: Python<'_>, kind: &str, name: &str, known: &[&str]) -> PyErr {
    let class = py.import("ocplanner.errors").and_then(|module| module.getattr("UnknownNameError"));
    match class.and_then(|class| class.call1((kind, name, known.to_vec()))) {
        Ok(exception) => PyErr::from_value(exception),
        Err(import_error) => import_error,
    }
}

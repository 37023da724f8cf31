//! Bindings of `ocplanner_core::delta_pose`.

use pyo3::prelude::*;

/// Adds this file's functions and classes to the module.
pub fn register(_module: &Bound<'_, PyModule>) -> PyResult<()> {
    Ok(())
}

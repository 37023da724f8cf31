//! `ocplanner._core`: one binding file per core module, nothing clever.

use pyo3::prelude::*;

mod arrays;
mod delta_pose;
mod errors;
mod planner;
mod pose;
mod reward;
mod simulation;

#[pymodule]
mod _core {
    use super::*;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        pose::register(module)?;
        planner::register(module)?;
        delta_pose::register(module)?;
        reward::register(module)?;
        simulation::register(module)
    }
}

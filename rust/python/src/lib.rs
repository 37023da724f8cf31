//! `ocplanner._core`: one binding file per core module, nothing clever.

use pyo3::prelude::*;

mod arguments;
mod arrays;
mod delta_pose;
mod delta_pose_batch;
mod errors;
mod mujoco;
mod native_control;
mod planner;
mod plant;
mod pose;
mod reward;

#[pymodule]
mod _core {
    use super::*;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        pose::register(module)?;
        planner::register(module)?;
        delta_pose::register(module)?;
        delta_pose_batch::register(module)?;
        reward::register(module)?;
        native_control::register(module)
    }
}

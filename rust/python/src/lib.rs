//! `ocplanner._core`: one binding file per module of the core, under the same name.
//!
//! A binding converts its arguments, releases the GIL, calls one function of the core, and converts the result. Besides
//! the bindings there are `arrays` and `arguments`, which read arguments, and `mujoco`, which drives the simulator.

use pyo3::prelude::*;

mod arguments;
mod arrays;
mod delta_pose;
mod delta_pose_batch;
mod error;
mod mujoco;
mod osc;
mod planner;
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
        osc::register(module)
    }
}

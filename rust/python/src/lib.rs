//! `ocplanner._core`: one binding file per module of the core, under the same name.
//!
//! A binding converts its arguments, releases the GIL, calls one function of the core, and converts the result. Besides
//! the bindings there are `arrays` and `arguments`, which read arguments, and `mujoco`, which drives the simulator.

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

#[pyo3::pymodule]
mod _core {
    #[pymodule_export]
    use crate::delta_pose::{DeltaPoseController, DeltaPoseLaw, delta_pose_action};
    #[pymodule_export]
    use crate::delta_pose_batch::DeltaPoseBatch;
    #[pymodule_export]
    use crate::osc::ControlLoop;
    #[pymodule_export]
    use crate::planner::{PlannerEngine, simd_level};
    #[pymodule_export]
    use crate::pose::{
        geodesic_angle, quat_wxyz_from_rotation, quat_xyzw_from_rotation, rotation_exp, rotation_from_6d,
        rotation_from_quat_wxyz, rotation_from_quat_xyzw, rotation_log, rotation_to_6d,
    };
    #[pymodule_export]
    use crate::reward::RewardLaw;
}

//! The part of ocplanner that runs once per control step or once per transition.
//!
//! Every array is row-major. Poses are in robosuite's world frame unless a name says otherwise; lengths are metres,
//! angles radians.

pub mod delta_pose;
pub mod delta_pose_batch;
pub mod error;
pub mod model_file;
pub mod nn;
pub mod osc;
pub mod planner;
pub mod pose;
pub mod reward;

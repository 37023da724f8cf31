//! The layers of a planner's forward pass, in f32.
//!
//! Activation maps are NHWC, with channels padded to whole groups of 16 and a border of zeros stored around each map, so
//! convolutions need no special cases at the edges. All sizes are known when a planner is loaded; running a layer
//! allocates nothing once its workspace has grown.

pub mod activation_map;
pub mod conv;
pub mod encoder;
pub mod kernels;
pub mod linear;
pub mod lstm;
pub mod stem;
pub mod winograd;

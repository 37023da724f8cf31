//! The layers of a planner's forward pass, in f32.
//!
//! Images are NHWC with the channels padded to whole groups of 16 and a border of zeros stored around each image, so that
//! convolutions need no case distinctions. All sizes are known when a planner is loaded; running a layer allocates
//! nothing.

pub mod conv;
pub mod encoder;
pub mod first;
pub mod kernels;
pub mod linear;
pub mod lstm;
pub mod winograd;

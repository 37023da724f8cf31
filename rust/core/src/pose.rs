//! Rigid-body poses: rotations, 6-D rotations and SE(3).

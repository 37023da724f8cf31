"""Poses, rotations and symmetry."""

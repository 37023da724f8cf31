"""Optimisation, run folders and checkpoints, whatever is trained."""

"""Optimisation, schedules, run folders and checkpoints, for planners and policies alike."""

"""Tasks, robots, cameras and simulation."""

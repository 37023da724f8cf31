"""The executor in simulation: episodes, runs, the matrix of robots and tasks."""

"""What moves an arm, simulated or real; needs neither robosuite, mujoco nor torch. See ``docs/control.md``."""

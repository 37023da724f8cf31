"""What moves an arm, simulated or real: neither robosuite, mujoco nor torch is needed."""

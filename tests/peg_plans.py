"""Plans of Square by rule, for tests that need a planner but no network."""

import numpy as np

from ocplanner.geometry.pose import Pose
from ocplanner.geometry.rotation import yaw_rotation

PEG = np.array([0.23, 0.10])


def plan_to_peg(here: Pose, error: np.ndarray, yaw: float) -> tuple[np.ndarray, np.ndarray]:
    """Twenty steps of 13 mm: up, over, down, to a peg that is seen a little beside its place."""
    goal = PEG + error
    position, steps = here.position.copy(), []
    for _ in range(20):
        away = goal - position[:2]
        distance = np.linalg.norm(away)
        if distance < 0.02:
            position = np.array([*goal, max(0.91, position[2] - 0.013)])
        elif position[2] < 0.98:
            position = position + np.array([0, 0, 0.013])
        else:
            position = np.array([*(position[:2] + away / distance * min(0.013, distance)), position[2]])
        steps.append(position)
    return np.array(steps), np.tile(yaw_rotation(yaw), (20, 1, 1))

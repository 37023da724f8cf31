"""Lift: take the cube, raise it and hold it there."""

import numpy as np

from ocplanner.collection.arm_programs import NoisyArmProgram
from ocplanner.collection.carrying import Carrier, DemonstrationVariation, evenly_spaced
from ocplanner.collection.experts import Expert
from ocplanner.envs.environment import ManipulationEnv
from ocplanner.geometry.pose import Pose

_KEPT = 10  # control steps for which the cube is held up


def _draw_variation(rng: np.random.Generator) -> DemonstrationVariation:
    return DemonstrationVariation(
        carry_height=rng.uniform(0.91, 0.93),
        sideways=rng.normal(0.0, 0.02),
        lookahead=rng.uniform(0.02, 0.035),
        release_height=0.0,
        lowering=0.0,
        yaw_error=0.0,
        noise=rng.uniform(0.03, 0.12),
    )


def _solve(env: ManipulationEnv, program: NoisyArmProgram, variation: DemonstrationVariation) -> None:
    carrier = Carrier(env, program, variation)
    start = carrier.take()
    path = bowed_path(start.position, variation)
    carrier.carry(path, start.rotation)
    carrier.hold(Pose(path[-1], start.rotation), _KEPT)


def bowed_path(start: np.ndarray, variation: DemonstrationVariation) -> np.ndarray:
    """(40, 3) evenly spaced points from the cube straight up, with a bow to the robot's left, world, metres."""
    s = np.linspace(0.0, 1.0, 160)[:, None]
    rise = np.array([0.0, 0.0, variation.carry_height - start[2]])
    return evenly_spaced(start + s * rise + np.sin(np.pi * s) * [0.0, variation.sideways, 0.0], 40)


EXPERT = Expert("Lift", _draw_variation, _solve)

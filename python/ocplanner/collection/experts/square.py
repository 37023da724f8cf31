"""Square: take the nut by its handle, carry it over the peg, lower it, release it and withdraw."""

import numpy as np

from ocplanner.collection.arm_programs import NoisyArmProgram
from ocplanner.collection.carrying import Carrier, DemonstrationVariation, carry_path
from ocplanner.collection.experts import Expert
from ocplanner.envs.environment import ManipulationEnv
from ocplanner.geometry.pose import Pose
from ocplanner.geometry.rotation import yaw_rotation

_HANDLE_TOWARD_ROBOT = np.pi


def _draw_variation(rng: np.random.Generator) -> DemonstrationVariation:
    """A variation within the spread of the human demonstrations."""
    return DemonstrationVariation(
        carry_height=rng.uniform(0.98, 1.04),
        sideways=rng.normal(0.0, 0.025),
        lookahead=rng.uniform(0.025, 0.04),
        release_height=rng.uniform(0.895, 0.925),
        lowering=rng.uniform(0.008, 0.016),
        yaw_error=rng.normal(0.0, 0.05),
        noise=rng.uniform(0.03, 0.12),
    )


def _solve(env: ManipulationEnv, program: NoisyArmProgram, variation: DemonstrationVariation) -> None:
    carrier = Carrier(env, program, variation)
    start = carrier.take()
    peg = env.data.body("peg1").xpos
    rotation = yaw_rotation(_final_yaw(start) + variation.yaw_error)
    goal = Pose(np.array([peg[0], peg[1], variation.carry_height]), rotation)
    carrier.carry(carry_path(start.position, goal.position, variation), goal.rotation)
    carrier.lower(goal)
    carrier.release()


def _final_yaw(start: Pose) -> float:
    """The yaw that fits the peg and is nearest to the nut's; not the one with the handle away from the robot."""
    yaw = np.arctan2(start.rotation[1, 0], start.rotation[0, 0])
    choices = _HANDLE_TOWARD_ROBOT + np.array([-np.pi / 2, 0.0, np.pi / 2])
    return float(choices[np.argmin(np.abs((choices - yaw + np.pi) % (2 * np.pi) - np.pi))])


EXPERT = Expert("Square", _draw_variation, _solve)

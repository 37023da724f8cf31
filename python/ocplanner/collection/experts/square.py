"""Square: take the nut by its handle, carry it over the peg, let it down, let go and withdraw."""

import numpy as np

from ocplanner.collection.carrying import Carrier, DemonstrationVariation, NoisyArmProgram, carry_path
from ocplanner.collection.experts.expert import Expert
from ocplanner.envs.environment import ManipulationEnv
from ocplanner.geometry.pose import Pose
from ocplanner.geometry.rotation import yaw_rotation

_HANDLE_TOWARD_ROBOT = np.pi


def _manner(rng: np.random.Generator) -> DemonstrationVariation:
    """A manner within the spread of the human demonstrations."""
    return DemonstrationVariation(
        carry_height=rng.uniform(0.98, 1.04),
        sideways=rng.normal(0.0, 0.025),
        lookahead=rng.uniform(0.025, 0.04),
        release_height=rng.uniform(0.895, 0.925),
        lowering=rng.uniform(0.008, 0.016),
        yaw_error=rng.normal(0.0, 0.05),
        noise=rng.uniform(0.03, 0.12),
    )


def _solve(env: ManipulationEnv, body: NoisyArmProgram, manner: DemonstrationVariation) -> None:
    carrier = Carrier(env, body, manner)
    start = carrier.take()
    peg = env.data.body("peg1").xpos
    goal = Pose(np.array([peg[0], peg[1], manner.carry_height]), yaw_rotation(_final_yaw(start) + manner.yaw_error))
    carrier.carry(carry_path(start.position, goal.position, manner), goal.rotation)
    carrier.let_down(goal)
    carrier.let_go()


def _final_yaw(start: Pose) -> float:
    """Of the four yaws that fit the peg, the nearest to the nut's but never the handle away from the robot."""
    yaw = np.arctan2(start.rotation[1, 0], start.rotation[0, 0])
    choices = _HANDLE_TOWARD_ROBOT + np.array([-np.pi / 2, 0.0, np.pi / 2])
    return float(choices[np.argmin(np.abs((choices - yaw + np.pi) % (2 * np.pi) - np.pi))])


EXPERT = Expert("Square", _manner, _solve)

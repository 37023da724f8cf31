"""Stack: take the red cube, carry it over the green one, lower it, release it and withdraw."""

import numpy as np

from ocplanner.collection.arm_programs import NoisyArmProgram
from ocplanner.collection.carrying import Carrier, DemonstrationVariation, carry_path
from ocplanner.collection.experts import Expert
from ocplanner.envs.environment import ManipulationEnv
from ocplanner.geometry.pose import Pose


def _draw_variation(rng: np.random.Generator) -> DemonstrationVariation:
    return DemonstrationVariation(
        carry_height=rng.uniform(0.94, 0.97),
        sideways=rng.normal(0.0, 0.02),
        lookahead=rng.uniform(0.02, 0.035),
        release_height=rng.uniform(0.874, 0.88),
        lowering=rng.uniform(0.008, 0.016),
        yaw_error=0.0,
        noise=rng.uniform(0.03, 0.12),
    )


def _solve(env: ManipulationEnv, program: NoisyArmProgram, variation: DemonstrationVariation) -> None:
    carrier = Carrier(env, program, variation)
    start = carrier.take()
    lower_cube = env.data.body("cubeB_main").xpos
    goal = Pose(np.array([lower_cube[0], lower_cube[1], variation.carry_height]), start.rotation)
    carrier.carry(carry_path(start.position, goal.position, variation), goal.rotation)
    carrier.lower(goal)
    carrier.release()


EXPERT = Expert("Stack", _draw_variation, _solve)

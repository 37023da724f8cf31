"""Stack: take the red cube, carry it over the green one, let it down, let go and withdraw."""

import numpy as np

from ocplanner.collection.carrying import Carrier, DemonstrationVariation, NoisyArmProgram, carry_path
from ocplanner.collection.experts.expert import Expert
from ocplanner.envs.environment import ManipulationEnv
from ocplanner.geometry.pose import Pose


def _manner(rng: np.random.Generator) -> DemonstrationVariation:
    return DemonstrationVariation(
        carry_height=rng.uniform(0.94, 0.97),
        sideways=rng.normal(0.0, 0.02),
        lookahead=rng.uniform(0.02, 0.035),
        release_height=rng.uniform(0.874, 0.88),
        lowering=rng.uniform(0.008, 0.016),
        yaw_error=0.0,
        noise=rng.uniform(0.03, 0.12),
    )


def _solve(env: ManipulationEnv, body: NoisyArmProgram, manner: DemonstrationVariation) -> None:
    carrier = Carrier(env, body, manner)
    start = carrier.take()
    lower_cube = env.data.body("cubeB_main").xpos
    goal = Pose(np.array([lower_cube[0], lower_cube[1], manner.carry_height]), start.rotation)
    carrier.carry(carry_path(start.position, goal.position, manner), goal.rotation)
    carrier.let_down(goal)
    carrier.let_go()


EXPERT = Expert("Stack", _manner, _solve)

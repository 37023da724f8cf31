"""Can: take the can, carry it over the walls into its compartment, let it down, let go and withdraw."""

import numpy as np

from ocplanner.collection.carrying import Carrier, DemonstrationVariation, NoisyArmProgram, carry_path
from ocplanner.collection.experts.expert import Expert
from ocplanner.envs.environment import ManipulationEnv
from ocplanner.geometry.pose import Pose

_NEARER = np.array([-0.045, -0.03])  # from the compartment's middle, which is out of the Panda's comfortable reach, m


def _manner(rng: np.random.Generator) -> DemonstrationVariation:
    return DemonstrationVariation(
        carry_height=rng.uniform(1.03, 1.08),
        sideways=rng.normal(0.0, 0.025),
        lookahead=rng.uniform(0.03, 0.05),
        release_height=rng.uniform(0.88, 0.9),
        lowering=rng.uniform(0.012, 0.02),
        yaw_error=rng.normal(0.0, 0.05),
        noise=rng.uniform(0.03, 0.12),
    )


def _solve(env: ManipulationEnv, body: NoisyArmProgram, manner: DemonstrationVariation) -> None:
    carrier = Carrier(env, body, manner)
    start = carrier.take()
    compartment = env.robosuite_env.target_bin_placements[env.robosuite_env.object_id]
    goal = Pose(np.array([*(compartment[:2] + _NEARER), manner.carry_height]), start.rotation)
    carrier.carry(carry_path(start.position, goal.position, manner), goal.rotation)
    carrier.let_down(goal)
    carrier.let_go()


EXPERT = Expert("Can", _manner, _solve)

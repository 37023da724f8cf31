"""Can: take the can, carry it over the walls into its compartment, lower it, release it and withdraw."""

import numpy as np

from ocplanner.collection.arm_programs import NoisyArmProgram
from ocplanner.collection.carrying import Carrier, DemonstrationVariation, carry_path
from ocplanner.collection.experts import Expert
from ocplanner.envs.environment import ManipulationEnv
from ocplanner.geometry.pose import Pose

_NEARER = np.array([-0.045, -0.03])  # from the compartment's middle, which the Panda barely reaches, m


def _draw_variation(rng: np.random.Generator) -> DemonstrationVariation:
    return DemonstrationVariation(
        carry_height=rng.uniform(1.03, 1.08),
        sideways=rng.normal(0.0, 0.025),
        lookahead=rng.uniform(0.03, 0.05),
        release_height=rng.uniform(0.88, 0.9),
        lowering=rng.uniform(0.012, 0.02),
        yaw_error=rng.normal(0.0, 0.05),
        noise=rng.uniform(0.03, 0.12),
    )


def _solve(env: ManipulationEnv, program: NoisyArmProgram, variation: DemonstrationVariation) -> None:
    carrier = Carrier(env, program, variation)
    start = carrier.take()
    compartment = env.robosuite_env.target_bin_placements[env.robosuite_env.object_id]
    goal = Pose(np.array([*(compartment[:2] + _NEARER), variation.carry_height]), start.rotation)
    carrier.carry(carry_path(start.position, goal.position, variation), goal.rotation)
    carrier.lower(goal)
    carrier.release()


EXPERT = Expert("Can", _draw_variation, _solve)

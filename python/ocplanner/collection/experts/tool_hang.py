"""Tool Hang: turn the frame upright, insert it into the stand, hook the tool's ring over it and let it swing down."""

import numpy as np
from scipy.spatial.transform import Rotation

from ocplanner.collection.arm_programs import NoisyArmProgram
from ocplanner.collection.carrying import Carrier, DemonstrationVariation, carry_path
from ocplanner.collection.experts import Expert
from ocplanner.envs.environment import ManipulationEnv
from ocplanner.geometry.pose import Pose
from ocplanner.geometry.rotation import yaw_rotation

_UPRIGHT = yaw_rotation(np.pi)  # the frame's arm points away from the robot, the hand comes from the left
_ASIDE = np.array([0.0, 0.15, 0.0])  # how the hand withdraws from the inserted frame, m
_ROUND_THE_STAND = np.array([(-0.06, 0.2, 0.05), (-0.1, -0.2, 0.05)])  # of the hand from its initial position, m
_TILT = np.deg2rad(49)  # of the tool, ring up, at the release, rad
_RING = 0.0097  # inner radius of the tool's ring, m


def _draw_variation(rng: np.random.Generator) -> DemonstrationVariation:
    return DemonstrationVariation(
        carry_height=rng.uniform(1.13, 1.15),
        sideways=rng.normal(0.0, 0.015),
        lookahead=rng.uniform(0.02, 0.03),
        release_height=rng.uniform(0.96, 0.98),
        lowering=rng.uniform(0.008, 0.014),
        yaw_error=rng.normal(0.0, 0.03),
        noise=rng.uniform(0.02, 0.08),
    )


def _solve(env: ManipulationEnv, program: NoisyArmProgram, variation: DemonstrationVariation) -> None:
    home = env.eef_pose()
    _mount_frame(env, Carrier(env, program, variation, "frame"), variation)
    for aside in _ROUND_THE_STAND:
        program.return_hand(Pose(home.position + aside, home.rotation))
    _hang_tool(env, Carrier(env, program, variation, "tool"), variation)


def _mount_frame(env: ManipulationEnv, carrier: Carrier, variation: DemonstrationVariation) -> None:
    start = carrier.take("grip")
    rotation = yaw_rotation(variation.yaw_error) @ _UPRIGHT
    hole = (env.data.geom("stand_wall0").xpos + env.data.geom("stand_wall2").xpos) / 2
    foot = rotation @ (env.model.site("frame_mount_site").pos * [1, 1, 0])
    goal = np.array([*(hole - foot)[:2], variation.carry_height])
    carrier.carry(carry_path(start.position, goal, variation), rotation)
    carrier.lower(Pose(goal, rotation))
    carrier.release(_ASIDE)


def _hang_tool(env: ManipulationEnv, carrier: Carrier, variation: DemonstrationVariation) -> None:
    start = carrier.take("grip-1")
    hook = env.data.geom("frame_hook_frame").xpos
    ring = env.model.body("tool_hole1_root").pos
    level = np.eye(3)
    over = hook - ring + [0.0, 0.0, 0.05]
    carrier.carry(carry_path(start.position, over, variation), level)
    carrier.lower(Pose(over, level), hook[2])
    for angle in np.linspace(0.0, _TILT, 20):
        tilted = Rotation.from_euler("y", angle).as_matrix()
        sunk = np.array([0.0, 0.0, _RING * np.sin(angle)])
        carrier.hold(Pose(hook - sunk - tilted @ ring, tilted), 2)
    carrier.release()


EXPERT = Expert("ToolHang", _draw_variation, _solve)

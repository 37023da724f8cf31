"""Tool Hang: stand the frame up and put it into its stand, then hook the tool's ring over it and let it swing down."""

import numpy as np
from scipy.spatial.transform import Rotation

from ocplanner.collection.carrying import Carrier, DemonstrationVariation, NoisyArmProgram, carry_path
from ocplanner.collection.experts.expert import Expert
from ocplanner.envs.environment import ManipulationEnv
from ocplanner.geometry.pose import Pose
from ocplanner.geometry.rotation import yaw_rotation

_UPRIGHT = yaw_rotation(np.pi)  # the frame's arm away from the robot, the hand from the left
_ASIDE = np.array([0.0, 0.15, 0.0])  # where the hand goes that has inserted the frame, m
_ROUND_THE_STAND = np.array([(-0.06, 0.2, 0.05), (-0.1, -0.2, 0.05)])  # places of the hand from its first one, m
_TILT = np.deg2rad(49)  # of the tool, ring up, when it is let go
_RING = 0.0097  # inner radius of the tool's ring, m


def _manner(rng: np.random.Generator) -> DemonstrationVariation:
    return DemonstrationVariation(
        carry_height=rng.uniform(1.13, 1.15),
        sideways=rng.normal(0.0, 0.015),
        lookahead=rng.uniform(0.02, 0.03),
        release_height=rng.uniform(0.96, 0.98),
        lowering=rng.uniform(0.008, 0.014),
        yaw_error=rng.normal(0.0, 0.03),
        noise=rng.uniform(0.02, 0.08),
    )


def _solve(env: ManipulationEnv, body: NoisyArmProgram, manner: DemonstrationVariation) -> None:
    home = env.eef_pose()
    _mount_frame(env, Carrier(env, body, manner, "frame"), manner)
    for aside in _ROUND_THE_STAND:
        body.return_hand(Pose(home.position + aside, home.rotation))
    _hang_tool(env, Carrier(env, body, manner, "tool"), manner)


def _mount_frame(env: ManipulationEnv, carrier: Carrier, manner: DemonstrationVariation) -> None:
    start = carrier.take("grip")
    rotation = yaw_rotation(manner.yaw_error) @ _UPRIGHT
    hole = (env.data.geom("stand_wall0").xpos + env.data.geom("stand_wall2").xpos) / 2
    foot = rotation @ (env.model.site("frame_mount_site").pos * [1, 1, 0])
    goal = np.array([*(hole - foot)[:2], manner.carry_height])
    carrier.carry(carry_path(start.position, goal, manner), rotation)
    carrier.let_down(Pose(goal, rotation))
    carrier.let_go(_ASIDE)


def _hang_tool(env: ManipulationEnv, carrier: Carrier, manner: DemonstrationVariation) -> None:
    start = carrier.take("grip-1")
    hook = env.data.geom("frame_hook_frame").xpos
    ring = env.model.body("tool_hole1_root").pos
    level = np.eye(3)
    over = hook - ring + [0.0, 0.0, 0.05]
    carrier.carry(carry_path(start.position, over, manner), level)
    carrier.let_down(Pose(over, level), hook[2])
    for angle in np.linspace(0.0, _TILT, 20):
        tilted = Rotation.from_euler("y", angle).as_matrix()
        sunk = np.array([0.0, 0.0, _RING * np.sin(angle)])
        carrier.hold(Pose(hook - sunk - tilted @ ring, tilted), 2)
    carrier.let_go()


EXPERT = Expert("ToolHang", _manner, _solve)

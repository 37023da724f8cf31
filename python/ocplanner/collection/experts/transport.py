"""Transport: open one bin, clear the other of rubbish, take the hammer, hand it over and put it into that bin."""

from dataclasses import replace

import numpy as np

from ocplanner.collection.arm_programs import NoisyArmProgram
from ocplanner.collection.carrying import Carrier, DemonstrationVariation, carry_path
from ocplanner.collection.experts import Expert
from ocplanner.envs.environment import ManipulationEnv
from ocplanner.geometry.pose import Pose
from ocplanner.geometry.rotation import yaw_rotation

_LID_ASIDE = np.array([-0.2, -0.45])  # where the lid is put on the table, world, m
_LID_RELEASE = 0.835  # height at which the lid is released, m; it lies at 0.82
_MEETING = np.array([0.0, -0.02])  # the hammer's middle at the hand-over, world, m
_READY = np.array([0.0, 0.2, 0.08])  # of the waiting second hand, from there, m
_CLEAR = 0.985  # height of the hammer above the walls, m
_BACK = 0.02  # how far the hammer is drawn back while it is lifted, as its head is next to a wall, m
_NEAR = 0.02  # tolerance of the meeting, m: the second hand senses where the hammer is
_OFF = 0.01  # from the goal's middle, which leaves room for the head and for the hand at the foot, m
_LOWER = 0.04  # how much lower than the hammer the lid and the rubbish are carried, m


def _draw_variation(rng: np.random.Generator) -> DemonstrationVariation:
    return DemonstrationVariation(
        carry_height=rng.uniform(1.06, 1.1),
        sideways=rng.normal(0.0, 0.02),
        lookahead=rng.uniform(0.035, 0.05),
        release_height=rng.uniform(0.87, 0.91),
        lowering=rng.uniform(0.018, 0.028),
        yaw_error=rng.normal(0.0, 0.05),
        noise=rng.uniform(0.03, 0.12),
    )


def _solve(env: ManipulationEnv, program: NoisyArmProgram, variation: DemonstrationVariation) -> None:
    first, second = env.task.object("payload").arms
    homes = [_level(arm.eef_pose()) for arm in env.arms]
    lower = replace(variation, carry_height=variation.carry_height - _LOWER)
    program.arms.wait_at(_above(env.object_pose("trash"), homes[second]), second)
    lid = Carrier(env, program, lower, "lid")
    _put(lid, Pose(np.array([*_LID_ASIDE, _LID_RELEASE]), homes[first].rotation), lower)
    trash = Carrier(env, program, lower, "trash")
    program.arms.wait_at(_above(env.object_pose("payload"), homes[first]), first)
    _put(trash, Pose(np.array([*_middle(env, "trash_bin"), variation.release_height]), homes[second].rotation), lower)
    _hand_over(env, program, variation, homes[second])


def _level(hand: Pose) -> Pose:
    """The pose with the palm straight down, which keeps the wrist far from its limits all over the table."""
    closing = hand.rotation[:, 0] * [1, 1, 0]
    closing /= np.linalg.norm(closing)
    down = np.array([0.0, 0.0, -1.0])
    return Pose(hand.position, np.column_stack([closing, np.cross(down, closing), down]))


def _above(pose: Pose, home: Pose) -> Pose:
    """Above an object in a bin, at the height and rotation that the hand had at the start."""
    return Pose(np.array([*pose.position[:2], home.position[2]]), home.rotation)


def _put(carrier: Carrier, goal: Pose, variation: DemonstrationVariation) -> None:
    """Take an object, carry it over the goal and release it there. The goal's rotation is the hand's."""
    start, hand = carrier.take(), carrier.hand()
    rotation = goal.rotation @ hand.rotation.T @ start.rotation
    over = Pose(np.array([*goal.position[:2], variation.carry_height]), rotation)
    carrier.carry(carry_path(start.position, over.position, variation), over.rotation)
    carrier.lower(over, goal.position[2])
    carrier.release()


def _hand_over(env: ManipulationEnv, program: NoisyArmProgram, variation: DemonstrationVariation, home: Pose) -> None:
    """Move the hammer from one bin to the other with a hand-over."""
    first, second = env.task.object("payload").arms
    forward = env.object_pose("payload").rotation[1, 2] > 0  # the head away from the first arm
    near, far = ("lower", "head") if forward else ("upper", "foot")
    giver = Carrier(env, program, variation, "payload", first)
    program.arms.wait_at(Pose(np.array([*_MEETING, variation.carry_height]) + _READY, home.rotation), second)
    lying = giver.take(*_grasps(env, near))
    start = giver.lift(np.array([*(lying.position - _BACK * lying.rotation[:, 2])[:2], _CLEAR]))
    meeting = Pose(np.array([*_MEETING, variation.carry_height]), _across(start.rotation, variation))
    giver.carry(carry_path(start.position, meeting.position, variation), meeting.rotation, _NEAR)
    taker = Carrier(env, program, variation, "payload", second)
    held = taker.take_from(giver, *_grasps(env, far))
    place = _middle(env, "target_bin") - _OFF * held.rotation[:2, 2]
    goal = Pose(np.array([*place, variation.carry_height]), held.rotation)
    taker.carry(carry_path(held.position, goal.position, variation), goal.rotation)
    taker.lower(goal)
    taker.release()


def _grasps(env: ManipulationEnv, end: str) -> tuple[str, ...]:
    return tuple(grasp.name for grasp in env.task.object("payload").grasps if grasp.name.startswith(end))


def _across(rotation: np.ndarray, variation: DemonstrationVariation) -> np.ndarray:
    """The hammer's rotation turned about the world's z until its handle points from one arm to the other."""
    handle = rotation[:, 2]
    forward = np.sign(handle[1])
    turn = np.arctan2(forward * handle[0], forward * handle[1])
    return yaw_rotation(turn + variation.yaw_error) @ rotation


def _middle(env: ManipulationEnv, name: str) -> np.ndarray:
    """(2,) horizontal position of a bin, world, metres."""
    return env.data.body(f"transport_{name}_root").xpos[:2].copy()


EXPERT = Expert("Transport", _draw_variation, _solve)

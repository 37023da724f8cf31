"""Transport: take the lid off, clear the other bin of rubbish, take the hammer, hand it over, put it into that bin."""

from dataclasses import replace

import numpy as np

from ocplanner.collection.carrying import Carrier, DemonstrationVariation, NoisyArmProgram, carry_path
from ocplanner.collection.experts.expert import Expert
from ocplanner.envs.environment import ManipulationEnv
from ocplanner.geometry.pose import Pose
from ocplanner.geometry.rotation import yaw_rotation

_LID_ASIDE = np.array([-0.2, -0.45])  # where the lid is put on its table, world, m
_LID_RELEASE = 0.835  # height at which the lid is let go of: it lies at 0.82, m
_MEETING = np.array([0.0, -0.02])  # where the hammer's middle is when the hands meet, world, m
_READY = np.array([0.0, 0.2, 0.08])  # from there, where the second hand waits, m
_CLEAR = 0.985  # height at which the hammer is over the walls, m
_BACK = 0.02  # how far the hammer is drawn back meanwhile, since its head is next to a wall, m
_NEAR = 0.02  # how exactly the hammer is brought there: the second hand looks where it is, m
_OFF = 0.01  # of the hammer from the middle of its goal: room for the head, and for the hand at the foot, m
_LOWER = 0.04  # by how much the lid and the rubbish are carried lower than the hammer, m


def _manner(rng: np.random.Generator) -> DemonstrationVariation:
    return DemonstrationVariation(
        carry_height=rng.uniform(1.06, 1.1),
        sideways=rng.normal(0.0, 0.02),
        lookahead=rng.uniform(0.035, 0.05),
        release_height=rng.uniform(0.87, 0.91),
        lowering=rng.uniform(0.018, 0.028),
        yaw_error=rng.normal(0.0, 0.05),
        noise=rng.uniform(0.03, 0.12),
    )


def _solve(env: ManipulationEnv, body: NoisyArmProgram, manner: DemonstrationVariation) -> None:
    first, second = env.task.object("payload").arms
    homes = [_level(arm.eef_pose()) for arm in env.arms]
    lower = replace(manner, carry_height=manner.carry_height - _LOWER)
    body.hands.wait_at(_above(env.object_pose("trash"), homes[second]), second)
    lid = Carrier(env, body, lower, "lid")
    _put(lid, Pose(np.array([*_LID_ASIDE, _LID_RELEASE]), homes[first].rotation), lower)
    trash = Carrier(env, body, lower, "trash")
    body.hands.wait_at(_above(env.object_pose("payload"), homes[first]), first)
    _put(trash, Pose(np.array([*_middle(env, "trash_bin"), manner.release_height]), homes[second].rotation), lower)
    _hand_over(env, body, manner, homes[second])


def _level(hand: Pose) -> Pose:
    """The pose with the palm straight down: so turned, the wrist is far from its limits on the whole table."""
    closing = hand.rotation[:, 0] * [1, 1, 0]
    closing /= np.linalg.norm(closing)
    down = np.array([0.0, 0.0, -1.0])
    return Pose(hand.position, np.column_stack([closing, np.cross(down, closing), down]))


def _above(pose: Pose, home: Pose) -> Pose:
    """Over what lies in a bin, the hand as high and turned as when the episode began."""
    return Pose(np.array([*pose.position[:2], home.position[2]]), home.rotation)


def _put(carrier: Carrier, goal: Pose, manner: DemonstrationVariation) -> None:
    """Take an object, carry it over the goal's position and let it go there, the hand turned as the goal is."""
    start, hand = carrier.take(), carrier.hand()
    over = Pose(np.array([*goal.position[:2], manner.carry_height]), goal.rotation @ hand.rotation.T @ start.rotation)
    carrier.carry(carry_path(start.position, over.position, manner), over.rotation)
    carrier.let_down(over, goal.position[2])
    carrier.let_go()


def _hand_over(env: ManipulationEnv, body: NoisyArmProgram, manner: DemonstrationVariation, home: Pose) -> None:
    """The hammer from one bin to the other, over both hands."""
    first, second = env.task.object("payload").arms
    forward = env.object_pose("payload").rotation[1, 2] > 0  # the head away from the first arm
    near, far = ("lower", "head") if forward else ("upper", "foot")
    giver = Carrier(env, body, manner, "payload", first)
    body.hands.wait_at(Pose(np.array([*_MEETING, manner.carry_height]) + _READY, home.rotation), second)
    lying = giver.take(*_grasps(env, near))
    start = giver.lift(np.array([*(lying.position - _BACK * lying.rotation[:, 2])[:2], _CLEAR]))
    meeting = Pose(np.array([*_MEETING, manner.carry_height]), _across(start.rotation, manner))
    giver.carry(carry_path(start.position, meeting.position, manner), meeting.rotation, _NEAR)
    taker = Carrier(env, body, manner, "payload", second)
    held = taker.take_from(giver, *_grasps(env, far))
    place = _middle(env, "target_bin") - _OFF * held.rotation[:2, 2]
    goal = Pose(np.array([*place, manner.carry_height]), held.rotation)
    taker.carry(carry_path(held.position, goal.position, manner), goal.rotation)
    taker.let_down(goal)
    taker.let_go()


def _grasps(env: ManipulationEnv, end: str) -> tuple[str, ...]:
    return tuple(grasp.name for grasp in env.task.object("payload").grasps if grasp.name.startswith(end))


def _across(rotation: np.ndarray, manner: DemonstrationVariation) -> np.ndarray:
    """The hammer's rotation turned about the world's z until its handle leads from one arm to the other."""
    handle = rotation[:, 2]
    forward = np.sign(handle[1])
    turn = np.arctan2(forward * handle[0], forward * handle[1])
    return yaw_rotation(turn + manner.yaw_error) @ rotation


def _middle(env: ManipulationEnv, name: str) -> np.ndarray:
    """(2,) horizontal place of a bin, world, metres."""
    return env.data.body(f"transport_{name}_root").xpos[:2].copy()


EXPERT = Expert("Transport", _manner, _solve)

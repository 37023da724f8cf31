"""Taking hold of an object whose pose is known, with any gripper (Section 4 of the paper: the grasp is given)."""

import numpy as np

from ocplanner.control.arm import CLOSE, OPEN, STAY, Reachability, Reading
from ocplanner.control.arm_program import ArmProgram
from ocplanner.control.settings import GraspSettings
from ocplanner.envs.robots import RobotSpec
from ocplanner.envs.tasks import ObjectSpec
from ocplanner.geometry.pose import Pose
from ocplanner.geometry.rotation import angle_between

_STILL_STEPS = 4
_BESIDE = 0.01  # m from the object's middle, at which a grasp counts as beside it


def choose_grasp(spec: ObjectSpec, robot: RobotSpec, now: Reading, reach: Reachability | None = None) -> Pose:
    """The end-effector pose, in the object's frame, of the grasp that turns the wrist least.

    Passed over are grasps with which a spare finger would come down on the object and, for an arm that has to bring
    its hand inward, those with which the wrist would come to its limit while the object is turned so that the hand is
    on the robot's side.

    Args:
        spec: the object and its grasps.
        robot: the arm.
        now: what is sensed before the approach.
        reach: where the arm gets to; without it no grasp is passed over for the wrist's limit.
    """
    site = Pose(-robot.rotation_grasp_site @ robot.middle, robot.rotation_grasp_site)
    inward = None if reach is None else -now.object.rotation.T @ reach.outward(now.object.position)
    candidates = [_hand(grasp.pose_object_eef, robot, spec, site, inward) for grasp in spec.grasps]
    if robot.spare_finger is not None:
        pairs = zip(candidates, spec.grasps, strict=True)
        free = [hand for hand, grasp in pairs if _points_away(hand, grasp.pose_object_eef.position)]
        candidates = free or candidates
    candidates.sort(key=lambda grasp: angle_between((now.object @ grasp).rotation, now.eef.rotation))
    if reach is None or not robot.inward:
        return candidates[0]
    rooms = []
    for grasp in candidates:
        turn = _turn_inward(now.object.rotation @ grasp.position, reach.outward(now.object.position))
        rooms.append(reach.wrist_room(now.object @ grasp, turn))
        if rooms[-1] > 0:
            return grasp
    return candidates[int(np.argmax(rooms))]


def _hand(grasp: Pose, robot: RobotSpec, spec: ObjectSpec, site: Pose, inward: np.ndarray | None) -> Pose:
    """The end-effector pose of a grasp; a hand whose spare finger would then reach lower does not lean outward."""
    upright = robot.spare_finger is not None and np.linalg.norm(grasp.position[:2]) > _BESIDE
    return leaning(grasp, 0.0 if upright else max(robot.lean, spec.lean), inward) @ site


def _points_away(hand: Pose, grasp: np.ndarray) -> bool:
    """Whether a spare finger has room: what is held is the object's middle, or the hand's middle lies beyond it."""
    beside = grasp[:2]
    return float(np.linalg.norm(beside)) < _BESIDE or float((hand.position[:2] - beside) @ beside) >= 0


def _turn_inward(beside: np.ndarray, outward: np.ndarray) -> float:
    """The shortest turn about z that brings what is held beside the object's middle to the robot's side, radians."""
    if np.linalg.norm(beside[:2]) < _BESIDE:
        return 0.0
    across = beside[1] * outward[0] - beside[0] * outward[1]
    return float(np.arctan2(across, -beside[:2] @ outward[:2]))


def leaning(grasp: Pose, angle: float, inward: np.ndarray | None = None) -> Pose:
    """A grasp with the palm tilted away from the object's middle, about the line along which the fingers close.

    The fingers keep their places on the object. A grasp at the middle leans toward the robot.

    Args:
        grasp: grasp frame in the object's frame, see :class:`ocplanner.envs.tasks.GraspFrame`.
        angle: radians.
        inward: (3,) direction to the robot in the object's frame; without it a grasp at the middle stays upright.
    """
    closing, sideways, approach = grasp.rotation.T
    aside = float(sideways @ grasp.position)
    if abs(aside) < _BESIDE:
        if inward is None:
            return grasp
        aside = float(sideways @ inward)
    tilted = np.cos(angle) * approach - np.sign(aside) * np.sin(angle) * sideways
    return Pose(grasp.position, np.column_stack([closing, np.cross(tilted, closing), tilted]))


def take_hold(
    body: ArmProgram, spec: ObjectSpec, robot: RobotSpec, settings: GraspSettings, reach: Reachability | None = None
) -> np.ndarray | None:
    """Open, approach from above, close and lift a little.

    Returns:
        (3,) the grip point in the object's frame, or None if the object did not come along.

    Raises:
        HorizonReached: the episode ended before.
    """
    close_around(body, spec, robot, settings, reach)
    held_at = body.read()
    grip_point, lifted = held_at.grip_point, held_at.eef.raised(settings.probe)
    for _ in range(settings.approach_steps):
        now = body.move_hand(lifted, body.holding)
        if not is_held(now, grip_point, settings):
            return None
        if now.eef.position[2] > lifted.position[2] - settings.near:
            return now.grip_point
    return None


def hover_over(spec: ObjectSpec, settings: GraspSettings) -> float:
    """Height above the grasp from which the hand comes down, metres."""
    return settings.hover if spec.hover is None else spec.hover


def opening_before(spec: ObjectSpec, robot: RobotSpec) -> float:
    """Gap to which the fingers open before a grasp, metres."""
    widths = [grasp.width for grasp in spec.grasps]
    if robot.spread is None or None in widths:
        return np.inf
    return max(width for width in widths if width is not None) + robot.spread


def toward(wide: float, opening: float) -> float:
    """The gripper's command on the way to a gap: it opens, and stays once it is as wide."""
    return OPEN if opening < wide else STAY


def close_around(
    body: ArmProgram, spec: ObjectSpec, robot: RobotSpec, settings: GraspSettings, reach: Reachability | None = None
) -> None:
    """Open as far as the object needs, approach from above and close.

    Raises:
        HorizonReached: the episode ended before.
    """
    wide = opening_before(spec, robot)
    met = 0.0 if robot.spread is None or wide == np.inf else wide - robot.spread
    for _ in range(settings.settle_steps):
        body.wait(toward(wide, body.read().opening))
    grasp = choose_grasp(spec, robot, body.read(), reach)
    _approach(body, grasp, settings.clearance + hover_over(spec, settings), 3 * settings.near, wide, settings)
    steep = settings.steep if spec.hover is not None else np.inf
    _approach(body, grasp, settings.clearance, settings.near, wide, settings, steep)
    squeeze = robot.squeeze_round_steps if spec.round else robot.squeeze_steps
    _close(body, (body.read().object @ grasp).raised(settings.clearance), met, robot, settings, squeeze)


def is_held(now: Reading, grip_point: np.ndarray, settings: GraspSettings) -> bool:
    """Whether the hand still is where it took hold of the object; the object may turn in the grip."""
    return float(np.linalg.norm(now.grip_point - grip_point)) < settings.held


def _approach(
    body: ArmProgram,
    grasp: Pose,
    height: float,
    near: float,
    wide: float,
    settings: GraspSettings,
    steep: float = np.inf,
) -> None:
    """Move above the grasp; the object is watched all along, since the hand may push it.

    A hand that is farther than ``steep`` from the vertical through the grasp, metres, does not come down.
    """
    still, before = 0, body.read().eef.position
    for _ in range(settings.approach_steps):
        target = (body.read().object @ grasp).raised(height)
        now = body.move_hand(_from_above(target, before, steep), toward(wide, body.read().opening))
        moved = float(np.linalg.norm(now.eef.position - before))
        before = now.eef.position
        if (
            np.linalg.norm(now.eef.position - target.position) < near
            and angle_between(now.eef.rotation, target.rotation) < settings.near_rotation
            and moved < max(settings.slow, 0.5 * near)
        ):
            return
        still = still + 1 if moved < settings.still else 0
        if still >= 2 * _STILL_STEPS:  # as near as this arm gets
            return


def _from_above(target: Pose, hand: np.ndarray, steep: float) -> Pose:
    """Where a hand at a position (3,) goes to reach a target from above."""
    if np.linalg.norm(hand[:2] - target.position[:2]) < steep or hand[2] < target.position[2]:
        return target
    return target._replace(position=np.append(target.position[:2], hand[2]))


def _close(body: ArmProgram, hand: Pose, met: float, robot: RobotSpec, settings: GraspSettings, squeeze: int) -> None:
    """Close until the fingers stop, or are so near each other that they have met the object, and squeeze.

    A stroke takes 12 steps for one gripper and 200 for another.
    """
    opening, still = body.read().opening, 0
    for _ in range(robot.stroke_steps + 2 * _STILL_STEPS):
        now = body.move_hand(hand, CLOSE)
        still = still + 1 if abs(now.opening - opening) < settings.still else 0
        opening = now.opening
        if still >= _STILL_STEPS or opening < met:
            break
    for _ in range(squeeze):
        body.move_hand(hand, CLOSE)


def open_fingers(body: ArmProgram, robot: RobotSpec, settings: GraspSettings) -> None:
    """Open until the object is free; a slow gripper's fingers rest at first, while its command unwinds."""
    before = start = body.read().opening
    freed = settings.freed if robot.spread is None else robot.spread
    still = 0
    for _ in range(robot.stroke_steps):
        now = body.wait(OPEN)
        still = still + 1 if abs(now.opening - before) < settings.still else 0
        before = now.opening
        opened = now.opening - start
        if opened > freed or (opened > settings.near and still >= 2):
            return

"""Taking hold of an object whose pose is known, with any gripper (Section 4 of the paper: the grasp is given)."""

import numpy as np

from ocplanner.control.arm import CLOSE, OPEN, STAY, Reachability, Reading
from ocplanner.control.arm_program import ArmProgram, Patience
from ocplanner.control.settings import GraspSettings
from ocplanner.envs.robots import RobotSpec
from ocplanner.envs.tasks import ObjectSpec
from ocplanner.geometry.pose import Pose
from ocplanner.geometry.rotation import angle_between


def take_hold(
    program: ArmProgram, spec: ObjectSpec, robot: RobotSpec, settings: GraspSettings, reach: Reachability | None = None
) -> np.ndarray | None:
    """Open, approach from above, close and lift a little.

    Args:
        program: the arm.
        spec: the object and its grasps.
        robot: what is particular about the arm.
        settings: of the grasp.
        reach: where the arm gets to; without it no grasp is passed over for the wrist's limit.

    Returns:
        (3,) the grip point in the object's frame, or None if the object did not come along.

    Raises:
        HorizonReached: the episode ended before.
    """
    close_around(program, spec, robot, settings, reach)
    held_at = program.read()
    grip_point, lifted = held_at.grip_point, held_at.eef.raised(settings.probe)
    for _ in range(settings.approach_steps):
        now = program.move_hand(lifted, program.holding)
        if not is_held(now, grip_point, settings):
            return None
        if now.eef.position[2] > lifted.position[2] - settings.near:
            return now.grip_point
    return None


def close_around(
    program: ArmProgram, spec: ObjectSpec, robot: RobotSpec, settings: GraspSettings, reach: Reachability | None = None
) -> None:
    """Open as far as the object needs, approach from above and close; arguments as for :func:`take_hold`.

    Raises:
        HorizonReached: the episode ended before.
    """
    wide = opening_before(spec, robot)
    for _ in range(settings.settle_steps):
        program.wait(toward(wide, program.read().opening))
    grasp = choose_grasp(spec, robot, program.read(), settings, reach)
    above = settings.clearance + hover_over(spec, settings)
    _approach(program, grasp, above, settings.near_above * settings.near, np.inf, wide, settings)
    steep = settings.steep if spec.hover is not None else np.inf
    _approach(program, grasp, settings.clearance, settings.near, steep, wide, settings)
    _close(program, (program.read().object @ grasp).raised(settings.clearance), spec, robot, settings)


def is_held(now: Reading, grip_point: np.ndarray, settings: GraspSettings) -> bool:
    """Whether the hand still is where it took hold of the object; the object may turn in the grip."""
    return float(np.linalg.norm(now.grip_point - grip_point)) < settings.held


def hover_over(spec: ObjectSpec, settings: GraspSettings) -> float:
    """Height above the grasp from which the hand comes down, metres."""
    return settings.hover if spec.hover is None else spec.hover


def opening_before(spec: ObjectSpec, robot: RobotSpec) -> float:
    """Gap to which the fingers open before a grasp, metres; infinite for fully."""
    widths = [grasp.width for grasp in spec.grasps]
    if robot.spread is None or None in widths:
        return np.inf
    return max(width for width in widths if width is not None) + robot.spread


def toward(wide: float, opening: float) -> float:
    """The gripper's command on the way to a gap: it opens, and stays once it is as wide."""
    return OPEN if opening < wide else STAY


def choose_grasp(
    spec: ObjectSpec, robot: RobotSpec, now: Reading, settings: GraspSettings, reach: Reachability | None = None
) -> Pose:
    """The end-effector pose, in the object's frame, of the grasp that turns the wrist least.

    Passed over are grasps with which a spare finger would come down on the object and, for an arm that has to bring
    its hand inward, those with which the wrist would come to its limit while the object is turned so that the hand is
    on the robot's side.

    Args:
        spec: the object and its grasps.
        robot: what is particular about the arm.
        now: what is sensed before the approach.
        settings: ``beside`` tells grasps beside the object's middle from those at it.
        reach: where the arm gets to; without it no grasp is passed over for the wrist's limit.
    """
    here, beside = now.object, settings.beside
    site = Pose(-robot.rotation_grasp_site @ robot.middle, robot.rotation_grasp_site)
    inward = None if reach is None else -here.rotation.T @ reach.outward(here.position)
    hands: list[Pose] = []
    free: list[Pose] = []
    for grasp in (frame.pose_object_eef for frame in spec.grasps):
        off = grasp.position[:2]
        in_the_middle = bool(np.linalg.norm(off) < beside)
        # A spare finger would reach lower on a hand that leans outward.
        upright = robot.spare_finger is not None and not in_the_middle
        hand = leaning(grasp, 0.0 if upright else max(robot.lean, spec.lean), inward, beside) @ site
        hands.append(hand)
        # It has room where the object's middle is held, or where the hand's own middle lies beyond what is held.
        if in_the_middle or (hand.position[:2] - off) @ off >= 0:
            free.append(hand)
    if robot.spare_finger is not None and free:
        hands = free
    hands.sort(key=lambda hand: angle_between((here @ hand).rotation, now.eef.rotation))
    if reach is None or not robot.inward:
        return hands[0]
    rooms = []
    for hand in hands:
        turn = _turn_inward(here.rotation @ hand.position, reach.outward(here.position), beside)
        rooms.append(reach.wrist_room(here @ hand, turn))
        if rooms[-1] > 0:
            return hand
    return hands[int(np.argmax(rooms))]


def leaning(grasp: Pose, angle: float, inward: np.ndarray | None = None, beside: float = GraspSettings.beside) -> Pose:
    """A grasp with the palm tilted away from the object's middle, about the line along which the fingers close.

    The fingers keep their places on the object. A grasp at the middle leans toward the robot.

    Args:
        grasp: grasp frame in the object's frame, see :class:`ocplanner.envs.tasks.GraspFrame`.
        angle: radians.
        inward: (3,) direction to the robot in the object's frame; without it a grasp at the middle stays upright.
        beside: distance from the middle below which the grasp is at it, metres.
    """
    closing, sideways, approach = grasp.rotation.T
    aside = float(sideways @ grasp.position)
    if abs(aside) < beside:
        if inward is None:
            return grasp
        aside = float(sideways @ inward)
    tilted = np.cos(angle) * approach - np.sign(aside) * np.sin(angle) * sideways
    return Pose(grasp.position, np.column_stack([closing, np.cross(tilted, closing), tilted]))


def _turn_inward(held: np.ndarray, outward: np.ndarray, beside: float) -> float:
    """The shortest turn about z that brings what is held, (3,) from the object's middle, to the robot's side."""
    if np.linalg.norm(held[:2]) < beside:
        return 0.0
    across = held[1] * outward[0] - held[0] * outward[1]
    return float(np.arctan2(across, -held[:2] @ outward[:2]))


def _approach(
    program: ArmProgram, grasp: Pose, height: float, near: float, steep: float, wide: float, settings: GraspSettings
) -> None:
    """Move above the grasp; the object is watched all along, since the hand may push it.

    A hand that is farther than ``steep`` metres from the vertical through the grasp does not come down.
    """

    def aim(now: Reading) -> tuple[Pose, float]:
        target = (now.object @ grasp).raised(height)
        return _from_above(target, now.eef.position, steep), toward(wide, now.opening)

    def has_arrived(now: Reading, target: Pose, moved: float) -> bool:
        return (
            float(np.linalg.norm(now.eef.position - target.position)) < near
            and angle_between(now.eef.rotation, target.rotation) < settings.near_rotation
            and moved < max(settings.slow, settings.arriving * near)
        )

    program.travel(aim, has_arrived, Patience(settings.approach_steps, settings.still, settings.stalled_steps))


def _from_above(target: Pose, hand: np.ndarray, steep: float) -> Pose:
    """Where a hand at a position (3,) goes to reach a target from above."""
    if np.linalg.norm(hand[:2] - target.position[:2]) < steep or hand[2] < target.position[2]:
        return target
    return target._replace(position=np.append(target.position[:2], hand[2]))


def _close(program: ArmProgram, hand: Pose, spec: ObjectSpec, robot: RobotSpec, settings: GraspSettings) -> None:
    """Close until the fingers stop, or are so near each other that they have met the object, and squeeze.

    A stroke takes 12 steps for one gripper and 200 for another.
    """
    wide = opening_before(spec, robot)
    met = 0.0 if robot.spread is None or wide == np.inf else wide - robot.spread
    opening, still = program.read().opening, 0
    for _ in range(robot.stroke_steps + settings.stalled_steps):
        now = program.move_hand(hand, CLOSE)
        still = still + 1 if abs(now.opening - opening) < settings.still else 0
        opening = now.opening
        if still >= settings.still_steps or opening < met:
            break
    for _ in range(robot.squeeze_round_steps if spec.round else robot.squeeze_steps):
        program.move_hand(hand, CLOSE)

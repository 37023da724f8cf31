"""Moving the open hand: letting go, leaving an object, and passing places on the way to one."""

import numpy as np

from ocplanner.control.arm import OPEN, Reading
from ocplanner.control.arm_program import ArmProgram, Patience
from ocplanner.control.grasp import opening_before, toward
from ocplanner.control.settings import ControlSettings, GraspSettings, OpenHandSettings
from ocplanner.envs.robots import RobotSpec
from ocplanner.envs.tasks import ObjectSpec
from ocplanner.geometry.pose import Pose
from ocplanner.geometry.rotation import angle_between


def bring_hand(program: ArmProgram, hand: Pose, settings: OpenHandSettings) -> None:
    """Move the open hand near a pose, world, or as near as the arm gets."""

    def has_arrived(now: Reading, target: Pose, moved: float) -> bool:  # noqa: ARG001
        away = float(np.linalg.norm(now.eef.position - target.position))
        return away < settings.near and angle_between(now.eef.rotation, target.rotation) < settings.near_rotation

    def moved(before: Pose, after: Pose) -> float:
        turned = angle_between(after.rotation, before.rotation)
        return float(np.linalg.norm(after.position - before.position)) + turned

    patience = Patience(settings.go_steps, settings.stalled, settings.stalled_steps)
    program.travel(lambda _: (hand, OPEN), has_arrived, patience, moved)


def rise(program: ArmProgram, height: float, settings: OpenHandSettings) -> None:
    """Move the open hand straight up, metres, or as high as the arm gets."""
    start = program.read().eef
    top = start.position[2] + height
    above = start._replace(position=np.append(start.position[:2], top + settings.rise_beyond))
    program.travel(
        lambda _: (above, OPEN),
        lambda now, target, moved: bool(now.eef.position[2] > top),  # noqa: ARG005
        Patience(settings.rise_steps, settings.stalled, settings.stalled_steps),
        lambda before, after: float(after.position[2] - before.position[2]),
    )


def release(program: ArmProgram, spec: ObjectSpec, robot: RobotSpec, settings: ControlSettings) -> None:
    """Open the hand, withdraw it, and wait until an object that hangs no longer swings.

    Raises:
        HorizonReached: the episode ended before.
    """
    open_fingers(program, robot, settings.grasp)
    if spec.withdraw == "up":
        rise(program, settings.open_hand.retreat, settings.open_hand)
    else:
        start = program.read().eef
        palm = (start.rotation @ robot.rotation_grasp_site.T)[:, 2]
        back = start._replace(position=start.position - settings.open_hand.retreat * palm)
        bring_hand(program, back, settings.open_hand)
    if spec.placing == "trace":
        _wait_for_rest(program, settings.open_hand)


def back_off(program: ArmProgram, spec: ObjectSpec, robot: RobotSpec, settings: ControlSettings) -> None:
    """Rise from an object that was missed or lost, and open as far as the next try needs.

    Raises:
        HorizonReached: the episode ended before.
    """
    rise(program, settings.grasp.hover, settings.open_hand)
    wide = opening_before(spec, robot)
    for _ in range(robot.stroke_steps // settings.grasp.reopen_part):
        program.wait(toward(wide, program.read().opening))


def open_fingers(program: ArmProgram, robot: RobotSpec, settings: GraspSettings) -> None:
    """Open until the object is free; a slow gripper's fingers rest at first, while its command unwinds."""
    before = start = program.read().opening
    freed = settings.freed if robot.spread is None else robot.spread
    still = 0
    for _ in range(robot.stroke_steps):
        now = program.wait(OPEN)
        still = still + 1 if abs(now.opening - before) < settings.still else 0
        before = now.opening
        opened = now.opening - start
        if opened > freed or (opened > settings.partly_freed and still >= settings.rest_steps):
            return


def _wait_for_rest(program: ArmProgram, settings: OpenHandSettings) -> None:
    for _ in range(settings.swing_steps):
        before = program.read().object.position
        if np.linalg.norm(program.wait(OPEN).object.position - before) < settings.swing:
            return

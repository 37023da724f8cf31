"""The arms, and how their grippers differ."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ocplanner.errors import UnknownNameError
from ocplanner.geometry.rotation import yaw_rotation


@dataclass(frozen=True)
class RobotSpec:
    """One arm with its own gripper, as robosuite ships it.

    Attributes:
        name: robosuite's name.
        closing_axis: axis of the end-effector site along which the fingers close.
        stroke_steps: control steps (20 Hz) from fully open to fully closed.
        lean: angle by which the hand tilts, radians: away from an object that it holds off-centre, toward the robot
            over one that it holds at its centre. This brings the wrist of an arm with a short reach nearer to the base:
            0.3 rad gains 4 to 7 cm.
        inward: whether the arm reaches the far end of its table only with the hand on its own side of an object that it
            holds off-centre, and has a wrist with limits: grasps are chosen that leave room for that turn.
        holding: the gripper's action while it holds: 1 keeps closing; 0 keeps the present command, for grippers in
            which two fingers press against one and would push the object out.
        spare_finger: prefix of the names of a finger that has no counterpart. The object is held between the other
            fingers, whose gap is the opening.
        squeeze_steps: control steps for which the fingers keep closing after contact, until they lie flat.
        squeeze_round_steps: the same for a round object, which has no flat side.
        spread: gap between the fingers before a grasp, beyond the object's width, metres; None: fully open. A slow
            gripper has no time to open further.
        turn: angle about the approach from the line along which the fingers meet to the closing axis, radians. It is
            not 0 for a hand whose three fingers meet askew.
        middle: centre of the held object in the end-effector site's frame, metres.
        patches: corrections of robosuite's model that apply by default; see :mod:`ocplanner.envs.patches`.
    """

    name: str
    closing_axis: Literal["x", "y"] = "x"
    stroke_steps: int = 20
    lean: float = 0.0
    inward: bool = False
    holding: float = 1.0
    squeeze_steps: int = 0
    squeeze_round_steps: int = 0
    spare_finger: str | None = None
    spread: float | None = None
    turn: float = 0.0
    middle: tuple[float, float, float] = (0.0, 0.0, 0.0)
    patches: tuple[str, ...] = ()

    @property
    def rotation_grasp_site(self) -> np.ndarray:
        """(3, 3) rotation, end-effector site -> grasp frame, whose x is the closing axis."""
        straight = np.eye(3)
        if self.closing_axis == "y":
            straight = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
        return yaw_rotation(self.turn) @ straight if self.turn else straight


ROBOTS = {
    spec.name: spec
    for spec in (
        RobotSpec("Panda"),
        RobotSpec("Sawyer", patches=("sawyer-base-contact",)),
        RobotSpec("UR5e"),
        RobotSpec("IIWA", inward=True),
        RobotSpec("Kinova3", lean=0.3),
        RobotSpec(
            "Jaco",
            stroke_steps=200,
            lean=0.3,
            holding=0.0,
            squeeze_steps=36,
            squeeze_round_steps=13,
            spare_finger="pinky",
            spread=0.02,
            turn=0.18,
            middle=(0.002, 0.016, 0.005),
        ),
        RobotSpec("XArm7", closing_axis="y", lean=0.3),
    )
}


def robot(name: str) -> RobotSpec:
    """The arm called ``name``.

    Raises:
        UnknownNameError: there is none.
    """
    if name not in ROBOTS:
        raise UnknownNameError("robot", name, ROBOTS)
    return ROBOTS[name]

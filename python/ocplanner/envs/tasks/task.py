"""The description of a task: a robosuite environment, the objects to manipulate, and where to hold them."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from ocplanner.errors import UnknownNameError
from ocplanner.geometry.pose import Pose

Placing = Literal["drop", "insert", "trace"]
PART = ":"
"""Separates an object's name from the number of the arm that carries it for a part of the way (``payload:0``)."""


@dataclass(frozen=True)
class GraspFrame:
    """One grasp of an object, the same for every gripper.

    Attributes:
        name: the part of the object that is held.
        pose_object_eef: the grasp frame in the object's frame. The fingers close along x, z points out of the palm (the
            approach), and the origin is midway between the finger tips. A robot's end-effector site may be rotated
            against this frame: see :attr:`ocplanner.envs.robots.RobotSpec.rotation_grasp_site`.
        width: of the object at the grasp, along x, metres; None if unknown.
    """

    name: str
    pose_object_eef: Pose
    width: float | None = None


@dataclass(frozen=True)
class ObjectSpec:
    """An object that a task manipulates. Several objects are placed one after another, each by its own plan.

    Attributes:
        name: robosuite's name, the prefix of its sensors (``SquareNut`` of ``SquareNut_pos``).
        joint: its free joint.
        grasps: the possible grasps, the preferred one first.
        yaw_fold: rotational symmetry of the goal about the object's z: 4 if every quarter turn is equally good, 0 if
            every yaw is, 1 if only one is.
        round: whether it is round at the grasp.
        let_go: whether the hand releases it at the goal.
        hover: height above the grasp from which the hand descends, metres, for objects between walls; the grasp
            primitive's own if not given.
        arms: numbers of the arms that carry it; the first takes it and hands it over to the next.
        ends: for a hand-over, pairs of prefixes of the giver's and the taker's grasps that leave room for two hands.
        placing: how it reaches the end of the plan, and when it is released. ``"drop"``: aligned above the end and
            lowered until it hangs free there. ``"insert"``: likewise, until it rests there. ``"trace"``: led through
            each pose of the plan, until it rests at the last one.
        tolerance: of the alignment, or of following the plan, metres and radians; the follower's own if not given.
        descent: how far below the object the target is while it is lowered, metres, which sets the speed; the
            follower's own if not given.
        lift: how far it is raised before it moves sideways, and how far along its own z meanwhile, metres; if not
            given, straight up by the follower's own height.
        lean: smallest angle by which every arm's palm tilts, radians, see :func:`ocplanner.control.grasp.leaning`.
        withdraw: how the open hand leaves it: ``"up"``, or ``"back"``, against the palm's direction.
        way: (3,) world positions, metres, that the open hand passes on its way to the object, rotated as at the start
            of the episode, if something blocks the straight way.
    """

    name: str
    joint: str
    grasps: tuple[GraspFrame, ...]
    yaw_fold: int = 1
    round: bool = False
    let_go: bool = True
    hover: float | None = None
    arms: tuple[int, ...] = (0,)
    ends: tuple[tuple[str, str], ...] = ()
    placing: Placing = "drop"
    tolerance: tuple[float, float] | None = None
    descent: float | None = None
    lift: tuple[float, float] | None = None
    lean: float = 0.0
    withdraw: Literal["up", "back"] = "up"
    way: tuple[tuple[float, float, float], ...] = ()

    def grasp(self, name: str) -> GraspFrame:
        """The grasp called ``name``.

        Raises:
            UnknownNameError: the object has no such grasp.
        """
        for candidate in self.grasps:
            if candidate.name == name:
                return candidate
        raise UnknownNameError("grasp", name, (candidate.name for candidate in self.grasps))

    @property
    def parts(self) -> tuple[str, ...]:
        """What planners are trained for: the object, or if several arms carry it each arm's part, in order."""
        return (self.name,) if len(self.arms) == 1 else tuple(f"{self.name}{PART}{arm}" for arm in self.arms)

    def held_at(self, end: str) -> "ObjectSpec":
        """The object with only the grasps whose names start with ``end``."""
        return replace(self, grasps=tuple(grasp for grasp in self.grasps if grasp.name.startswith(end)))


@dataclass(frozen=True)
class Task:
    """A manipulation task.

    Attributes:
        name: our name, such as ``"Square"``.
        env_name: robosuite's name, such as ``"NutAssemblySquare"``.
        objects: the manipulated objects, in order; the first is the main one.
        cameras: cameras whose images a planner reads by default.
        horizon: control steps of an episode.
    """

    name: str
    env_name: str
    objects: tuple[ObjectSpec, ...]
    cameras: tuple[str, ...] = ("agentview",)
    horizon: int = 400

    @property
    def arms(self) -> int:
        """Number of arms."""
        return 1 + max(arm for spec in self.objects for arm in spec.arms)

    def object(self, name: str | None = None) -> ObjectSpec:
        """The object called ``name``, or the main one.

        Raises:
            UnknownNameError: the task has no such object.
        """
        if name is None:
            return self.objects[0]
        for candidate in self.objects:
            if candidate.name == name:
                return candidate
        raise UnknownNameError("object", name, (candidate.name for candidate in self.objects))


def top_grasp(
    name: str, position: tuple[float, float, float], yaw: float = 0.0, width: float | None = None
) -> GraspFrame:
    """A grasp from above.

    Args:
        name: the part of the object that is held.
        position: (3,) of the grasp frame's origin in the object's frame, metres.
        yaw: angle in the object's xy plane from its x axis to the line along which the fingers close, radians.
        width: of the object along that line, metres; None if unknown.
    """
    closing = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    approach = np.array([0.0, 0.0, -1.0])
    rotation = np.column_stack([closing, np.cross(approach, closing), approach])
    return GraspFrame(name, Pose(np.array(position, dtype=np.float64), rotation), width)

"""What a task is: a robosuite environment, the objects that matter in it, and where to hold them."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from ocplanner.errors import UnknownNameError
from ocplanner.geometry.pose import Pose

Placing = Literal["drop", "insert", "trace"]
PART = ":"
"""Stands between an object's name and the number of the arm that carries it for a part of the way."""


@dataclass(frozen=True)
class GraspFrame:
    """A way of holding an object, the same for every gripper.

    Attributes:
        name: what the hand takes hold of.
        pose_object_eef: the grasp frame in the object's frame: x along which the fingers close, z out of the palm
            (the approach), the origin midway between the finger tips. A robot's own end-effector site may be turned
            against it: see :attr:`ocplanner.envs.robots.RobotSpec.rotation_grasp_site`.
        width: of the object where it is held, along x, metres; None if not known.
    """

    name: str
    pose_object_eef: Pose
    width: float | None = None


@dataclass(frozen=True)
class ObjectSpec:
    """An object that a task is about. Where tasks have several, they are placed one after another, each as planned.

    Attributes:
        name: robosuite's name, the prefix of its sensors (``SquareNut`` of ``SquareNut_pos``).
        joint: its free joint.
        grasps: the ways of holding it, the preferred one first.
        yaw_fold: rotational symmetry of the goal about the object's z: 4 means every quarter turn is as good, 0 that
            any yaw is, 1 that only one is.
        round: whether it is round where the fingers take it.
        let_go: whether the goal wants it let go of; False: it stays in the hand.
        hover: height above the grasp, metres, from which the hand comes down on it, where walls stand round it; the
            grasp primitive's own if not given.
        arms: numbers of the arms that carry it; the first takes it and hands it over to the next.
        ends: where two arms hold it at a time: pairs of what the names of the giver's and of the taker's grasps begin
            with, far enough from each other for two hands.
        placing: how it gets to where the plan ends, and when it is let go of. ``"drop"``: lined up above that place and
            let down, until it hangs free there. ``"insert"``: in the same way, until it rests there. ``"trace"``: led
            through each pose of the plan, until it rests at the last.
        tolerance: how exactly it is lined up, or led along the plan: metres and radians. The follower's own numbers
            if not given.
        descent: how far below the object its target is while it is let down, metres: how fast. The follower's own
            number if not given.
        lift: how far it goes up before it goes aside, and along its own z meanwhile, metres; straight up, by the
            follower's own number, if not given.
        lean: least angle by which every arm's palm is tilted, radians; see :func:`ocplanner.control.grasp.leaning`.
        withdraw: how the open hand leaves it: ``"up"``, or ``"back"``, against the palm's direction.
        way: (3,) world positions, metres, that the open hand passes on its way to it, turned as it was when the episode
            began: where the straight way would lead through something.
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
        """What planners of it are called: its name, or with several arms one name for the part of each, in order."""
        return (self.name,) if len(self.arms) == 1 else tuple(f"{self.name}{PART}{arm}" for arm in self.arms)

    def held_at(self, end: str) -> "ObjectSpec":
        """The object with only those of its grasps whose names begin so."""
        return replace(self, grasps=tuple(grasp for grasp in self.grasps if grasp.name.startswith(end)))


@dataclass(frozen=True)
class Task:
    """A manipulation task.

    Attributes:
        name: our name, such as ``"Square"``.
        env_name: robosuite's, such as ``"NutAssemblySquare"``.
        objects: what is manipulated, in this order; the first is the main one.
        cameras: cameras whose pictures a planner sees unless told otherwise.
        horizon: control steps of an episode.
    """

    name: str
    env_name: str
    objects: tuple[ObjectSpec, ...]
    cameras: tuple[str, ...] = ("agentview",)
    horizon: int = 400

    @property
    def arms(self) -> int:
        """How many arms it takes."""
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
        name: what the hand takes hold of.
        position: (3,) of the grasp frame's origin in the object's frame, metres.
        yaw: angle in the object's xy plane from its x axis to the line along which the fingers close, radians.
        width: of the object along that line, metres; None if not known.
    """
    closing = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    approach = np.array([0.0, 0.0, -1.0])
    rotation = np.column_stack([closing, np.cross(approach, closing), approach])
    return GraspFrame(name, Pose(np.array(position, dtype=np.float64), rotation), width)

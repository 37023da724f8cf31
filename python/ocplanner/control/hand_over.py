"""Where two hands hold an object that one gives to the other."""

from dataclasses import replace

import numpy as np

from ocplanner.control.arm import Reachability
from ocplanner.control.settings import SeveralArmsSettings
from ocplanner.envs.tasks import ObjectSpec
from ocplanner.geometry.pose import Pose
from ocplanner.geometry.rotation import yaw_rotation


def ready_beside(meeting: np.ndarray, home: Pose, settings: SeveralArmsSettings) -> Pose:
    """Where the taker waits for what a plan leads to a place, turned as at home; at home while that is far.

    Args:
        meeting: (3,) the plan's end, world, metres.
        home: of the taker's hand, world.
        settings: ``far``, ``beside`` and ``above``.
    """
    way = (home.position - meeting) * [1, 1, 0]
    distance = float(np.linalg.norm(way))
    if not settings.beside < distance < settings.far:
        return home
    return home._replace(position=meeting + settings.beside * way / distance + [0.0, 0.0, settings.above])


def ends_for_hands(
    spec: ObjectSpec, pose_object: Pose, reach: Reachability, settings: SeveralArmsSettings
) -> tuple[ObjectSpec, ObjectSpec]:
    """The object as the giver takes it and as the taker does: the giver's end is the one nearer to itself.

    Args:
        spec: the object.
        pose_object: where it lies, world.
        reach: the giver's.
        settings: ``lean`` is the taker's.
    """
    outward = reach.outward(pose_object.position)
    taken = replace(spec, hover=None, lean=settings.lean)
    pairs = [(spec.held_at(near), taken.held_at(far)) for near, far in spec.ends]
    return max(pairs, key=lambda pair: float((_middle(pair[1], pose_object) - _middle(pair[0], pose_object)) @ outward))


def rotation_to_taker(pose_object: Pose, held: ObjectSpec, left: ObjectSpec, way: np.ndarray) -> np.ndarray:
    """(3, 3) the object's rotation, turned about the world's z until the end that is left points to the taker.

    Args:
        pose_object: world.
        held: the object as the giver holds it.
        left: the object as the taker is to hold it.
        way: (3,) from the giver's base to the taker's.
    """
    end = _middle(left, pose_object) - _middle(held, pose_object)
    turn = np.arctan2(way[1], way[0]) - np.arctan2(end[1], end[0])
    return yaw_rotation(turn) @ pose_object.rotation


def _middle(held: ObjectSpec, pose_object: Pose) -> np.ndarray:
    """(3,) world, metres: the middle of where an object is held."""
    return np.mean([(pose_object @ grasp.pose_object_eef).position for grasp in held.grasps], axis=0)

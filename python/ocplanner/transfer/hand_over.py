"""Where two hands hold an object that one gives to the other."""

import numpy as np

from ocplanner.envs.tasks import ObjectSpec
from ocplanner.pose import Pose
from ocplanner.transfer.body import Foresight


def ends_for_hands(spec: ObjectSpec, pose_object: Pose, reach: Foresight) -> tuple[ObjectSpec, ObjectSpec]:
    """The object as the giver takes it and as the taker does: the giver's end is the one nearer to itself.

    Args:
        spec: the object.
        pose_object: where it lies, world.
        reach: the giver's.
    """
    outward = reach.outward(pose_object.position)
    pairs = [(spec.held_at(near), spec.held_at(far)) for near, far in spec.ends]
    return max(pairs, key=lambda pair: float((_middle(pair[1], pose_object) - _middle(pair[0], pose_object)) @ outward))


def _middle(held: ObjectSpec, pose_object: Pose) -> np.ndarray:
    """(3,) world, metres: the middle of where an object is held."""
    return np.mean([(pose_object @ grasp.pose_object_eef).position for grasp in held.grasps], axis=0)

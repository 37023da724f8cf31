"""Tells whether the robot holds the object, by the same rule live and in recordings; hints and rewards depend on it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ocplanner.errors import ShapeError
from ocplanner.geometry.pose import Pose


@dataclass(frozen=True)
class GraspRule:
    """When a closed gripper holds the object: it takes the object along. Lengths in metres."""

    carried: float = 0.004
    """How far the hand must have moved with the object before the object counts as held."""
    slip: float = 0.001
    """How far the hand may move in the object's frame meanwhile; fingers that push an object, or miss it, move
    farther."""
    lost: float = 0.03
    """How far the hand may move in the object's frame from where it held the object before the object is lost."""


DEFAULT_RULE = GraspRule()


class GraspDetector:
    """Says step by step whether the object is held, from what has happened so far."""

    def __init__(self, rule: GraspRule = DEFAULT_RULE) -> None:
        self._rule = rule
        self._since: tuple[Sequence[float], Sequence[float]] | None = None
        """The hand in the world and in the object's frame when it closed, or when the hold began."""
        self._held = False

    def update(self, object_pose: Pose, eef_position: np.ndarray, last_gripper: float) -> bool:
        """Note a step; returns whether the object is held before the next action.

        Args:
            object_pose: present pose, world.
            eef_position: (3,) present position of the end-effector site, world, metres.
            last_gripper: the gripper's part of the last action: above 0 closes, below 0 opens, 0 keeps. Before the
                first action, any number below 0.
        """
        grip = object_pose.rotation.T @ (eef_position - object_pose.position)
        return self.follow(eef_position.tolist(), grip.tolist(), last_gripper)

    def follow(self, hand: Sequence[float], grip: Sequence[float], last_gripper: float) -> bool:
        """:meth:`update` from the hand's three coordinates in the world and in the object's frame, metres."""
        now = (hand, grip)
        if last_gripper < 0:
            self._since, self._held = None, False
        elif self._since is None:
            self._since = now if last_gripper > 0 else None
        else:
            slip = math.dist(grip, self._since[1])
            if slip > (self._rule.lost if self._held else self._rule.slip):
                self._since, self._held = now, False
            elif not self._held and math.dist(hand, self._since[0]) >= self._rule.carried:
                self._since, self._held = now, True
        return self._held


def held_steps(
    object_positions: np.ndarray,
    object_rotations: np.ndarray,
    eef_positions: np.ndarray,
    gripper_actions: np.ndarray,
    rule: GraspRule = DEFAULT_RULE,
) -> np.ndarray:
    """(T,) bool: the object is held before the action of that step, as :class:`GraspDetector` tells it live.

    Args:
        object_positions: (T, 3) world, metres.
        object_rotations: (T, 3, 3), object -> world.
        eef_positions: (T, 3) of the end-effector site, world, metres.
        gripper_actions: (T,), above 0 closes and below 0 opens, 0 keeps.
        rule: thresholds.

    Raises:
        ShapeError: the arrays do not fit together.
    """
    steps = len(gripper_actions)
    shapes = (object_positions.shape, object_rotations.shape, eef_positions.shape)
    if shapes != ((steps, 3), (steps, 3, 3), (steps, 3)):
        raise ShapeError(f"positions, rotations and hands of shapes {shapes} for {steps} actions; expected one a step")
    hold, last = GraspDetector(rule), np.concatenate([[-1.0], gripper_actions[:-1]])
    grips = np.einsum("tji,tj->ti", object_rotations, eef_positions - object_positions)
    told = zip(eef_positions.tolist(), grips.tolist(), last.tolist())
    return np.array([hold.follow(*step) for step in told], dtype=bool)

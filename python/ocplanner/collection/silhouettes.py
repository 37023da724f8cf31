"""The pixels that another arm would cover with its end effector at the recorded arm's pose; of a pair, both arms."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ocplanner.collection.settings import RenderSettings
from ocplanner.envs import make_env
from ocplanner.envs.recorded_model import RecordedModels
from ocplanner.envs.robots import robot as robot_spec
from ocplanner.envs.tasks import Task
from ocplanner.geometry.pose import Pose

REACHED_M = 0.08
"""Largest reach error, a radian counted as 0.1 m, with which an arm still counts as reaching a pose.

It is large on purpose: near the edge of its workspace an arm (Kinova3 over the peg) holds the object tilted, and its
silhouette should look so.
"""

_HALF_TURN = np.diag([-1.0, -1.0, 1.0])


class Hand(NamedTuple):
    """A recorded hand: the pose of its end-effector site, world frame, and the gap between its finger pads, metres."""

    pose: Pose
    opening: float


class SilhouetteArm:
    """Another arm in the same scene, or as many of its kind as the task needs.

    Args:
        task: the task.
        source: name of the recorded arm.
        name: name of the arm to place.
        settings: cameras, size and visual preset.
    """

    def __init__(self, task: Task, source: str, name: str, settings: RenderSettings) -> None:
        self._env = make_env(task, name, cameras=settings.cameras, image_size=settings.size, visual=settings.visual)
        self._models = RecordedModels(self._env)
        # Recorded site -> grasp frame -> this arm's site.
        straight = robot_spec(source).rotation_grasp_site.T @ robot_spec(name).rotation_grasp_site
        # Two fingers close alike after half a turn; which of the two the arm reaches more easily varies.
        self._both_turns = (straight, straight @ _HALF_TURN)
        self._turns = self._initial_turns()

    def start(self, model_file: str | None) -> None:
        """Begin a demonstration, so that its masks do not depend on earlier ones.

        Args:
            model_file: the recorded model, for the sizes of its objects.
        """
        self._env.reset(0)
        self._models.take_over(model_file, other_arm=True)
        self._turns = self._initial_turns()

    def masks(self, poses_objects: Mapping[str, Pose], hands: Sequence[Hand]) -> dict[str, np.ndarray]:
        """Masks (h, w) bool by camera; all False if an arm cannot reach its pose.

        Args:
            poses_objects: poses of the task's objects by name, world frame.
            hands: the recorded arms' hands.
        """
        env = self._env
        for name, pose in poses_objects.items():
            env.place_object(pose, name)
        if all(self._place(number, hand) for number, hand in enumerate(hands)):
            return {camera: env.robot_mask(camera) for camera in env.cameras}
        return {camera: np.zeros((env.image_size, env.image_size), bool) for camera in env.cameras}

    def close(self) -> None:
        """Free the environment."""
        self._env.close()

    def _initial_turns(self) -> list[list[np.ndarray]]:
        """For each arm, the turns in the order in which they are tried."""
        return [list(self._both_turns) for _ in self._env.arms]

    def _place(self, number: int, hand: Hand) -> bool:
        """Place one arm's hand, and return whether it reaches.

        The turn that succeeds is tried first in the next frame, so that the wrist does not flip back and forth.
        """
        turns = self._turns[number]
        for turn in list(turns):
            target = Pose(hand.pose.position, hand.pose.rotation @ turn)
            error = self._env.place_eef(target, hand.opening, arm=number, tolerance=REACHED_M, restarts=0)
            if error < REACHED_M:
                if turn is not turns[0]:
                    turns.reverse()
                return True
        return False

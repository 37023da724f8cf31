"""What another arm would cover with its end effector where the recorded arm's is; of a pair, both arms."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ocplanner.envs import make_env
from ocplanner.envs.robots import robot as robot_spec
from ocplanner.envs.tasks import Task
from ocplanner.geometry.pose import Pose

REACHED_M = 0.08
"""How far the nearest reachable pose may be from the wanted one, a radian counted as 0.1 m.

Generous on purpose: near the edge of its workspace an arm (Kinova3 over the peg) would come in tilted, and that is what
it would look like.
"""

_HALF_TURN = np.diag([-1.0, -1.0, 1.0])


class Hand(NamedTuple):
    """Where a recorded hand is: its end-effector site, world frame, and the gap between the finger pads, metres."""

    pose: Pose
    opening: float


class SilhouetteArm:
    """One other arm before the same task, or as many of its kind as the task takes.

    Args:
        task: the task.
        source: name of the recorded arm.
        name: name of the arm to place.
        cameras: camera names.
        size: width and height, pixels.
        visual: visual preset.
    """

    def __init__(self, task: Task, source: str, name: str, cameras: tuple[str, ...], size: int, visual: str) -> None:
        self._env = make_env(task, name, cameras=cameras, image_size=size, visual=visual)
        # Recorded site -> grasp frame -> this arm's site.
        straight = robot_spec(source).rotation_grasp_site.T @ robot_spec(name).rotation_grasp_site
        # Two fingers close alike when turned by half a turn; which of the two the arm reaches more easily varies.
        self._both_turns = (straight, straight @ _HALF_TURN)
        self._turns = self._as_at_first()

    def start(self) -> None:
        """Begin a demonstration: what follows depends on it alone."""
        self._env.reset(0)
        self._turns = self._as_at_first()

    def masks(self, poses_objects: Mapping[str, Pose], hands: Sequence[Hand]) -> dict[str, np.ndarray]:
        """Masks (h, w) bool by camera; nothing where an arm cannot reach.

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

    def _as_at_first(self) -> list[list[np.ndarray]]:
        """Of each arm the turns to try, in this order."""
        return [list(self._both_turns) for _ in self._env.arms]

    def _place(self, number: int, hand: Hand) -> bool:
        """Put one arm's hand there; whether it reaches. The turn with which it does is tried first in the next frame.

        So the wrist does not flip back and forth.
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

"""What another arm would cover with its end effector where the recorded arm's is."""

from collections.abc import Mapping

import numpy as np

from ocplanner.envs import make_env
from ocplanner.envs.robots import robot as robot_spec
from ocplanner.envs.tasks import Task
from ocplanner.pose import Pose

REACHED_M = 0.08
"""How far the nearest reachable pose may be from the wanted one, a radian counted as 0.1 m.

Generous on purpose: near the edge of its workspace an arm (Kinova3 over the peg) would come in tilted, and that is what
it would look like.
"""

_HALF_TURN = np.diag([-1.0, -1.0, 1.0])


class SilhouetteArm:
    """One other arm before the same task.

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
        self._turns = list(self._both_turns)

    def start(self) -> None:
        """Begin a demonstration: what follows depends on it alone."""
        self._env.reset(0)
        self._turns = list(self._both_turns)

    def masks(self, poses_objects: Mapping[str, Pose], pose_eef: Pose, opening: float) -> dict[str, np.ndarray]:
        """Masks (h, w) bool by camera; nothing where the arm cannot reach.

        Args:
            poses_objects: poses of the task's objects by name, world frame.
            pose_eef: the recorded arm's end-effector site, world frame.
            opening: the recorded gap between the finger pads, metres.
        """
        env = self._env
        for name, pose in poses_objects.items():
            env.place_object(pose, name)
        for turn in list(self._turns):
            target = Pose(pose_eef.position, pose_eef.rotation @ turn)
            if env.place_eef(target, opening, tolerance=REACHED_M, restarts=0) < REACHED_M:
                self._prefer(turn)
                return {camera: env.robot_mask(camera) for camera in env.cameras}
        return {camera: np.zeros((env.image_size, env.image_size), bool) for camera in env.cameras}

    def close(self) -> None:
        """Free the environment."""
        self._env.close()

    def _prefer(self, turn: np.ndarray) -> None:
        """Try this turn first in the next frame, so that the wrist does not flip back and forth."""
        if turn is not self._turns[0]:
            self._turns.reverse()

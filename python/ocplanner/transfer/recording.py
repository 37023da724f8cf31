"""Recording an episode as a video with the plan drawn into the picture."""

from pathlib import Path

import numpy as np

from ocplanner.envs.environment import ManipulationEnv
from ocplanner.report.drawing import Caption
from ocplanner.report.video import write_episode_video
from ocplanner.transfer.episode import Episode

_CAMERA, _SIDE = "agentview", 320


class Recorder:
    """Takes a picture after every control step.

    Args:
        env: the environment.
    """

    def __init__(self, env: ManipulationEnv) -> None:
        self._env = env
        self.frames: list[np.ndarray] = []
        self._positions: list[np.ndarray] = []

    def __call__(self) -> None:
        """Take a picture, and note where the object is."""
        self.frames.append(self._env.render(_CAMERA, _SIDE, _SIDE))
        self._positions.append(self._env.object_pose().position)

    def write(self, path: Path, episode: Episode) -> Path:
        """Write the mp4: the plan in force in red, the object's own path in another colour."""
        project = self._env.project
        trace = episode.trace
        planned: list[np.ndarray | None] = []
        plans = dict(trace.plans)
        current = None
        for step, phase in enumerate(trace.phases):
            if step in plans:
                current = project(_CAMERA, plans[step], _SIDE, _SIDE)
            planned.append(None if phase in ("grasp", "release", "recover") else current)
        outcome = "success" if episode.success else episode.failure
        last = len(trace.phases) - 1
        captions = [
            Caption(self._env.robot.name, episode.seed, step, phase, outcome if step == last else None)
            for step, phase in enumerate(trace.phases)
        ]
        achieved = project(_CAMERA, np.array(self._positions), _SIDE, _SIDE)
        return write_episode_video(path, self.frames, planned, achieved, captions=captions)

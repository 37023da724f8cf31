"""Recording an episode as a video with the plan drawn into the picture."""

from pathlib import Path

import numpy as np

from ocplanner.drawing.overlay import Caption
from ocplanner.drawing.style import BAD, GOOD
from ocplanner.drawing.video import write_episode_video
from ocplanner.envs.environment import ManipulationEnv
from ocplanner.zero_shot.episode import Episode

_CAMERA, _SIDE = "agentview", 320


class Recorder:
    """Takes a picture after every control step.

    Args:
        env: the environment.
    """

    def __init__(self, env: ManipulationEnv) -> None:
        self._env = env
        self.frames: list[np.ndarray] = []
        self._positions: list[dict[str, np.ndarray]] = []

    def __call__(self) -> None:
        """Take a picture and note the objects' positions."""
        self.frames.append(self._env.render(_CAMERA, _SIDE, _SIDE))
        self._positions.append(
            {spec.name: self._env.object_pose(spec.name).position for spec in self._env.task.objects}
        )

    def write(self, path: Path, episode: Episode) -> Path:
        """Write the mp4: the plan in force in red, the path of the active object in another colour."""
        trace, env = episode.trace, self._env
        planned = [
            None if plan is None else env.project(_CAMERA, plan, _SIDE, _SIDE) for plan in trace.followed_plans()
        ]
        robot, seed, last = env.robot.name, f"seed {episode.seed}", len(trace.phases) - 1
        captions = [Caption(robot, seed, f"{phase} · step {step}") for step, phase in enumerate(trace.phases[:-1])]
        outcome = "success" if episode.success else str(episode.failure)
        captions.append(Caption(robot, seed, f"step {last}", outcome, GOOD if episode.success else BAD))
        achieved_world = [positions[name] for positions, name in zip(self._positions, trace.objects)]
        achieved = env.project(_CAMERA, np.array(achieved_world), _SIDE, _SIDE)
        return write_episode_video(path, self.frames, planned, achieved, captions=captions)

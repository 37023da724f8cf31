"""Plans in a live environment, made when and from what ``ocplanner label`` makes them: for hints and rewards alike."""

from collections.abc import Mapping

import numpy as np

from ocplanner.envs.environment import ManipulationEnv
from ocplanner.errors import MismatchError
from ocplanner.planner.planner import Plan, Planner

Pictures = Mapping[tuple[str, int, str], np.ndarray]
"""What was drawn at this step already: (camera, size, observation) -> (h, w, 3) uint8."""


class LivePlan:
    """Plans from what the environment shows.

    Args:
        env: the environment, drawn with the planner's visual preset.
        planner: the planner.

    Raises:
        MismatchError: the planner is of another task or visual preset.
    """

    def __init__(self, env: ManipulationEnv, planner: Planner) -> None:
        config = planner.config
        if config["task"] != env.task.name or config["visual"] not in (None, env.visual.name):
            raise MismatchError(
                f"{planner.path} plans for {config['task']} drawn as {config['visual']}, but the environment is "
                f"{env.task.name} drawn as {env.visual.name}"
            )
        self._env, self._planner = env, planner

    def plan(self, drawn: Pictures, steps: int | None = None) -> Plan:
        """The plan (batch of one) before the next action.

        Args:
            drawn: pictures of this step that need not be drawn again.
            steps: how many steps of the plan are wanted; all if not given.
        """
        images = {camera: self._picture(camera, drawn)[None] for camera in self._planner.config["cameras"]}
        return self._planner.plan(images, steps=steps)

    def _picture(self, camera: str, drawn: Pictures) -> np.ndarray:
        size, observe = int(self._planner.config["image_size"]), str(self._planner.config["observe"])
        key = (camera, size, observe)
        return drawn[key] if key in drawn else self._env.render(camera, size, size, observe)

"""Plans in a live environment, made from what and when ``ocplanner label`` makes them: for hints and rewards alike."""

from collections.abc import Mapping

import numpy as np

from ocplanner.envs.environment import ManipulationEnv
from ocplanner.errors import MismatchError
from ocplanner.planner.planner import Plan, Planner

Pictures = Mapping[tuple[str, int, str], np.ndarray]
"""Pictures already drawn at this step: (camera, size, observation) -> (h, w, 3) uint8."""


class LivePlan:
    """Plans from what the environment shows.

    Args:
        env: the environment, drawn with the planner's visual preset.
        planner: the planner.
        steps: steps of each plan; the planner's horizon if not given.

    Raises:
        MismatchError: the planner is of another task or visual preset.
    """

    def __init__(self, env: ManipulationEnv, planner: Planner, steps: int | None = None) -> None:
        header = planner.header
        if header.task != env.task.name or header.visual not in (None, env.visual.name):
            raise MismatchError(
                f"{planner.path} plans for {header.task} drawn as {header.visual}, but the environment is "
                f"{env.task.name} drawn as {env.visual.name}"
            )
        self._env, self._planner, self._steps = env, planner, steps

    def plan(self, drawn: Pictures) -> Plan:
        """The plan (batch of one) before the next action; cameras that ``drawn`` lacks are rendered."""
        images = {camera: self._picture(camera, drawn)[None] for camera in self._planner.header.cameras}
        return self._planner.plan(images, steps=self._steps)

    def _picture(self, camera: str, drawn: Pictures) -> np.ndarray:
        size, observe = self._planner.header.image_size, self._planner.header.observe
        key = (camera, size, observe)
        return drawn[key] if key in drawn else self._env.render(camera, size, size, observe)

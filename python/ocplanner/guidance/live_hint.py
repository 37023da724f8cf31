"""The hint of :data:`ocplanner.policies.config.HINT_KEY` in a live environment, as ``ocplanner label`` writes it."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ocplanner.envs.environment import ManipulationEnv
from ocplanner.errors import MismatchError
from ocplanner.guidance.hints import HINT_WIDTH, action_law, plan_hints
from ocplanner.guidance.live_plan import LivePlan, Pictures
from ocplanner.planner.planner import Planner


class LiveHint:
    """Plans while the object is held, and turns the plan into a hint.

    Args:
        env: the environment, drawn with the planner's visual preset.
        planner: the planner that the policy's data set was labelled with.
        labels: what ``ocplanner label`` recorded in that data set, and the policy's file in ``labels``.

    Attributes:
        object: name of the object that is planned for.

    Raises:
        MismatchError: another planner, task or visual preset than that of the labels.
    """

    def __init__(self, env: ManipulationEnv, planner: Planner, labels: Mapping[str, Any]) -> None:
        check_planner(planner, labels)
        settings, scale = labels["settings"], labels["action_scale"]
        self._env, self._plans, self.object = env, LivePlan(env, planner), str(planner.config["object"])
        self._steps, self._origin = tuple(settings["horizon_steps"]), settings["hint_from"]
        self._world = labels["action_frame"] == "world"
        self._law = action_law(scale["position"], scale["rotation"])

    def row(self, held: bool, drawn: Pictures) -> np.ndarray:
        """(6 K + 1,) float32: the hint before the next action, zeros where nothing is held.

        Args:
            held: the object is held, by :class:`ocplanner.control.grasp_detection.GraspDetector`.
            drawn: pictures of this step that need not be drawn again.
        """
        row = np.zeros(HINT_WIDTH * len(self._steps) + 1, np.float32)
        if held:
            plan = self._plans.plan(drawn)
            pose, eef = self._env.object_pose(self.object), self._env.eef_pose()
            frame = np.eye(3) if self._world else self._env.base_rotation
            here = (pose.position[None], pose.rotation[None])
            row[:-1] = plan_hints(plan, here, eef.position[None], frame[None], self._steps, self._law, self._origin)[0]
            row[-1] = 1.0
        return row


def check_planner(planner: Planner, labels: Mapping[str, Any]) -> None:
    """Compare a planner with the one that made the labels of a policy's data set.

    Raises:
        MismatchError: it is another.
    """
    if planner.sha256 != labels["planner_sha256"]:
        raise MismatchError(
            f"{planner.path} (sha256 {planner.sha256[:12]}) is not the planner that the policy's data set was "
            f"labelled with (sha256 {labels['planner_sha256'][:12]}); give that one, or label and train again"
        )

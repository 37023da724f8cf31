"""Hints in a live environment: those that ``ocplanner label`` writes as ``obs/ocp_hint`` for the same states."""

import numpy as np

from ocplanner.envs.environment import ManipulationEnv
from ocplanner.errors import MismatchError
from ocplanner.files.records.labels import LabelRecord
from ocplanner.guidance.hints import HINT_WIDTH, action_law, plan_hints, steps_needed
from ocplanner.guidance.live_plan import LivePlan, Pictures
from ocplanner.guidance.settings import LabelSettings
from ocplanner.planner.planner import Planner


class LiveHint:
    """Plans while the object is held, and turns the plan into a hint.

    Args:
        env: the environment, drawn with the planner's visual preset.
        planner: the planner that the policy's data set was labelled with.
        labels: how that data set was labelled, as the policy's file records it.

    Attributes:
        object: name of the object that is planned for.

    Raises:
        MismatchError: another planner, task or visual preset than that of the labels, or labels without hints.
    """

    def __init__(self, env: ManipulationEnv, planner: Planner, labels: LabelRecord) -> None:
        check_planner(planner, labels)
        if labels.action_scale is None:
            raise MismatchError(f"the data set labelled with {planner.path} has no hints; label it again with hints")
        self._env, self._settings, self.object = env, LabelSettings.of(labels), planner.header.object
        self._plans = LivePlan(env, planner, steps_needed(self._settings.horizon_steps, self._settings.hint_from))
        self._world = labels.action_frame == "world"
        self._law = action_law(labels.action_scale)

    def row(self, held: bool, drawn: Pictures) -> np.ndarray:
        """(6 K + 1,) float32: the hint before the next action, zeros where nothing is held.

        Args:
            held: whether the object is held, see :class:`ocplanner.control.grasp_detection.GraspDetector`.
            drawn: pictures already drawn at this step.
        """
        steps, origin = self._settings.horizon_steps, self._settings.hint_from
        row = np.zeros(HINT_WIDTH * len(steps) + 1, np.float32)
        if held:
            plan = self._plans.plan(drawn)
            pose, eef = self._env.object_pose(self.object), self._env.eef_pose()
            frame = np.eye(3) if self._world else self._env.base_rotation
            here = (pose.position[None], pose.rotation[None])
            row[:-1] = plan_hints(plan, here, eef.position[None], frame[None], steps, self._law, origin)[0]
            row[-1] = 1.0
        return row


def check_planner(planner: Planner, labels: LabelRecord) -> None:
    """Check that a planner is the one that made the labels of a policy's data set.

    Raises:
        MismatchError: it is another one.
    """
    if planner.sha256 != labels.planner_sha256:
        raise MismatchError(
            f"{planner.path} (sha256 {planner.sha256[:12]}) is not the planner that the policy's data set was "
            f"labelled with (sha256 {labels.planner_sha256[:12]}); give that one, or label and train again"
        )

"""One episode of a policy."""

from typing import NamedTuple, cast

import numpy as np

from ocplanner.control.grasp_detection import GraspDetector
from ocplanner.demos.recorded_observation import recorded_observation
from ocplanner.envs.environment import ManipulationEnv
from ocplanner.errors import MismatchError
from ocplanner.files.records.labels import ActionScale
from ocplanner.guidance.live_hint import LiveHint
from ocplanner.policies.config import HINT_KEY
from ocplanner.policies.evaluable import check_evaluable, object_of
from ocplanner.policies.policy import Policy

_SCALE_POSITION, _SCALE_ROTATION = 0.05, 0.5
"""What an action of 1 asks of :class:`ManipulationEnv`: metres, radians."""


class Outcome(NamedTuple):
    """How an episode ended.

    Attributes:
        success: the task was solved.
        steps: control steps used.
        failure: None, or ``missed grasp`` (the object was never held, see :mod:`ocplanner.control.grasp_detection`),
            ``lost grasp`` (it was, and is no more) or ``time-out`` (it still is).
    """

    success: bool
    steps: int
    failure: str | None


class PolicyRollout:
    """A policy before its task: it sees what it was trained on, and its actions are carried out as recorded ones were.

    Args:
        env: the environment, with the arm, the visual preset and the observation of the policy's data set.
        policy: the policy.
        hint: gives the hint, where the policy reads one.

    Raises:
        MismatchError: the policy's actions or observations cannot be had here, or the hint is missing.
    """

    def __init__(self, env: ManipulationEnv, policy: Policy, hint: LiveHint | None = None) -> None:
        if policy.training.reads_hints and hint is None:
            raise MismatchError(f"{policy.path} reads hints: give the planner that its data set was labelled with")
        check_evaluable(policy)
        header = policy.header
        self.env, self.policy, self.hint = env, policy, hint
        self._world = header.action_frame == "world"
        reads = policy.training.network.hint
        self._plan_instead = reads is not None and reads.instead_of_pictures
        self._blank = np.zeros((env.image_size, env.image_size, 3), np.uint8)
        scale = cast(ActionScale, header.action_scale)  # what has none cannot be evaluated
        self._scale = (scale.position / _SCALE_POSITION, scale.rotation / _SCALE_ROTATION)
        self._object = object_of(header) if "object" in policy.training.observation.low_dim else None

    def play(self, seed: int, horizon: int | None = None) -> Outcome:
        """Run one episode until the task is solved, as robomimic does, or the horizon is reached.

        Args:
            seed: of the reset and of the policy's draws.
            horizon: control steps; the environment's own if not given.
        """
        self.env.reset(seed)
        self.policy.reset(seed)
        main = None if self.hint is None else self.hint.object
        gripper, hold, held, ever = -1.0, GraspDetector(), False, False
        for step in range(horizon or self.env.horizon):
            held = hold.update(self.env.object_pose(main), self.env.eef_pose().position, gripper)
            ever = ever or held
            action = self.policy.act(self._observation(held))[0]
            self.env.step(self._carried_out(action))
            gripper = float(action[-1])
            if self.env.success():
                return Outcome(True, step + 1, None)
        failure = "time-out" if held else "lost grasp" if ever else "missed grasp"
        return Outcome(False, horizon or self.env.horizon, failure)

    def _observation(self, held: bool) -> dict[str, np.ndarray]:
        env = self.env
        found = recorded_observation(env, self._object)
        unseen = held and self._plan_instead
        pictures = dict.fromkeys(env.cameras, self._blank) if unseen else env.observe()
        if self.hint is not None:
            drawn = {} if unseen else {(name, env.image_size, env.observe_mode): pictures[name] for name in pictures}
            found[HINT_KEY] = self.hint.row(held, drawn)
        found |= {f"{name}_image": image for name, image in pictures.items()}
        return {key: np.asarray(found[key])[None] for key in self.policy.observation_keys}

    def _carried_out(self, action: np.ndarray) -> np.ndarray:
        """The recorded frame and scale turned into the environment's own."""
        action = action.astype(np.float64)
        frame = self.env.base_rotation.T if self._world else np.eye(3)
        position, rotation = (frame @ action[3 * part : 3 * part + 3] * self._scale[part] for part in (0, 1))
        return np.clip(np.concatenate([position, rotation, action[6:]]), -1.0, 1.0)

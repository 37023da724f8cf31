"""The plan's reward in a live environment: what ``ocplanner label --reward`` writes for the same states."""

from pathlib import Path
from typing import Any, Literal, NamedTuple, SupportsFloat

import gymnasium
import numpy as np

from ocplanner.control.grasp_detection import GraspDetector
from ocplanner.demos.recorded_task import carriers, object_of
from ocplanner.envs.environment import ManipulationEnv
from ocplanner.envs.gymnasium_env import GymnasiumEnv
from ocplanner.errors import MismatchError
from ocplanner.geometry.pose import Pose
from ocplanner.guidance.live_plan import LivePlan
from ocplanner.guidance.rewards import DEFAULT_REWARD, RewardConfig, Rewards, plan_reward
from ocplanner.planner.planner import Plan, Planner
from ocplanner.settings import require_choice

LiveMode = Literal["augment", "only"]


class _Transition(NamedTuple):
    """The plan made before a transition (None: nothing was held), and where the object went."""

    plan: Plan | None
    achieved: Pose


class LiveReward:
    """Rewards the transitions of a live episode one by one; see :func:`ocplanner.plan_reward`.

    Args:
        env: the environment, drawn with the planner's visual preset.
        planner: the planner.
        config: weights and form.

    Raises:
        MismatchError: the planner is of another task or visual preset.
    """

    def __init__(self, env: ManipulationEnv, planner: Planner, config: RewardConfig = DEFAULT_REWARD) -> None:
        self._env, self._config, self._plans = env, config, LivePlan(env, planner, steps=1)
        part = planner.header.object
        self._object, self._arms = object_of(part), carriers(env.task.env_name, part)
        self._rotations = planner.header.outputs == "pose"
        self.reset()

    def reset(self) -> None:
        """Begin an episode; the environment has been reset."""
        self._detectors = {arm: GraspDetector() for arm in self._arms}
        self._last: list[_Transition] = []
        self._plan = self._planned(None)

    def after(self, action: np.ndarray, terminal: bool) -> Rewards:
        """Terms and reward, each (1,), of the transition that the environment has just made.

        Args:
            action: (7 arms,) the action that made it.
            terminal: it ended the episode for good, not by a time limit.
        """
        # The form "potential" looks one transition back; no form looks farther.
        self._last = [*self._last[-1:], _Transition(self._plan, self._env.object_pose(self._object))]
        position = np.stack([step.achieved.position for step in self._last])
        rotation = np.stack([step.achieved.rotation for step in self._last])
        planned = (position.copy(), rotation.copy() if self._rotations else None)
        for row, step in enumerate(self._last):
            if step.plan is not None:  # elsewhere the terms are zero whatever the plan
                planned[0][row] = step.plan.position[0, 0]
                if planned[1] is not None and step.plan.rotation is not None:
                    planned[1][row] = step.plan.rotation[0, 0]
        held = np.array([step.plan is not None for step in self._last])
        rewards = plan_reward(planned, (position, rotation), held, self._config, terminal=terminal)
        self._plan = None if terminal else self._planned(action)
        return rewards.last

    def _planned(self, last_action: np.ndarray | None) -> Plan | None:
        """The plan before the next action, if one of the arms that carry the object holds it."""
        pose, held = self._env.object_pose(self._object), False
        for arm, detector in self._detectors.items():
            gripper = -1.0 if last_action is None else float(last_action[7 * arm + 6])
            held |= detector.update(pose, self._env.arms[arm].eef_pose().position, gripper)
        return self._plans.plan({}) if held else None


class PlanReward(gymnasium.Wrapper[Any, np.ndarray, Any, np.ndarray]):
    """Adds the plan's reward to that of an ``ocplanner/<Task>-v0`` environment, or replaces it.

    ``info`` holds the task's own reward as ``reward_sparse``, and the unweighted terms as ``ocp_reward_position`` (m^2)
    and, from planners with rotations, ``ocp_reward_rotation``. The wrapper must see actions as the environment gets
    them: put wrappers that change actions around it. While the object is held, a step draws the planner's pictures and
    makes one plan.

    Args:
        env: the environment, drawn with the planner's visual preset.
        planner: the planner or its file.
        config: weights and form of the plan's reward.
        mode: ``"augment"`` adds it to the task's own reward, ``"only"`` replaces that.

    Raises:
        MismatchError: the environment is not ocplanner's, or the planner is of another task or visual preset.
        ModelFileError: the planner cannot be read.
        UnknownNameError: no such mode.
    """

    def __init__(
        self,
        env: gymnasium.Env[Any, np.ndarray],
        planner: Planner | str | Path,
        config: RewardConfig = DEFAULT_REWARD,
        mode: LiveMode = "augment",
    ) -> None:
        super().__init__(env)
        inner = env.unwrapped
        if not isinstance(inner, GymnasiumEnv):
            raise MismatchError(
                f"{inner} is no environment of ocplanner; make one with gymnasium.make('ocplanner/...-v0')"
            )
        require_choice("reward mode", mode, LiveMode)
        planner = planner if isinstance(planner, Planner) else Planner.load(planner)
        self._live, self._augment = LiveReward(inner.env, planner, config), mode == "augment"

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Start an episode."""
        started = self.env.reset(seed=seed, options=options)
        self._live.reset()
        return started

    def step(self, action: np.ndarray) -> tuple[dict[str, np.ndarray], SupportsFloat, bool, bool, dict[str, Any]]:
        """Advance 0.05 s."""
        observation, sparse, terminated, truncated, info = self.env.step(action)
        rewards = self._live.after(action, terminated)
        seen = {"reward_sparse": float(sparse), **{name: float(term[0]) for name, term in rewards.terms.items()}}
        reward = float(rewards.reward[0]) + (float(sparse) if self._augment else 0.0)
        return observation, reward, terminated, truncated, {**info, **seen}

"""The plan's reward in a live environment: the one that ``ocplanner label --reward`` writes for the same states."""

from pathlib import Path
from typing import Any, Literal, NamedTuple, SupportsFloat, get_args

import gymnasium
import numpy as np

from ocplanner.control.grasp_detection import GraspDetector
from ocplanner.envs.environment import ManipulationEnv
from ocplanner.envs.gymnasium_env import GymnasiumEnv
from ocplanner.errors import MismatchError, UnknownNameError
from ocplanner.geometry.pose import Pose
from ocplanner.guidance.live_plan import LivePlan
from ocplanner.guidance.rewards import DEFAULT, Rewards, plan_reward
from ocplanner.guidance.settings import RewardConfig
from ocplanner.planner.planner import Plan, Planner

LiveMode = Literal["augment", "only"]


class _Transition(NamedTuple):
    """What the planner wanted before a transition (None: nothing is held), and where the object went."""

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

    def __init__(self, env: ManipulationEnv, planner: Planner, config: RewardConfig = DEFAULT) -> None:
        self._env, self._config, self._plans = env, config, LivePlan(env, planner)
        self._object, self._rotations = str(planner.config["object"]), planner.config["outputs"] != "position"
        self._hold = GraspDetector()
        self._plan: Plan | None = None
        self._last: list[_Transition] = []

    def reset(self) -> None:
        """Begin an episode; the environment has been reset."""
        self._hold, self._last = GraspDetector(), []
        self._plan = self._planned(-1.0)

    def after(self, gripper: float, terminal: bool) -> Rewards:
        """Terms and reward, each (1,), of the transition that the environment has just made.

        Args:
            gripper: the gripper's part of the action that made it.
            terminal: it ended the episode for good, not by a time limit.
        """
        # The form "potential" looks one transition back, no form farther.
        self._last = [*self._last[-1:], _Transition(self._plan, self._env.object_pose(self._object))]
        position = np.stack([step.achieved.position for step in self._last])
        rotation = np.stack([step.achieved.rotation for step in self._last])
        planned = (position.copy(), rotation.copy() if self._rotations else None)
        for row, step in enumerate(self._last):
            if step.plan is not None:  # elsewhere the terms are zero whatever was planned
                planned[0][row] = step.plan.position[0, 0]
                if planned[1] is not None and step.plan.rotation is not None:
                    planned[1][row] = step.plan.rotation[0, 0]
        held = np.array([step.plan is not None for step in self._last])
        terms = plan_reward(planned, (position, rotation), held, self._config, terminal=terminal)
        self._plan = None if terminal else self._planned(gripper)
        return Rewards(*(None if term is None else term[-1:] for term in terms))  # type: ignore[arg-type]

    def _planned(self, last_gripper: float) -> Plan | None:
        held = self._hold.update(self._env.object_pose(self._object), self._env.eef_pose().position, last_gripper)
        return self._plans.plan({}, steps=1) if held else None


class PlanReward(gymnasium.Wrapper[Any, np.ndarray, Any, np.ndarray]):
    """Gives the plan's reward, added to the task's own or in its place, in an ``ocplanner/<Task>-v0`` environment.

    ``info`` has the task's own reward as ``reward_sparse``, and the unweighted terms as ``ocp_reward_position`` (m^2)
    and, from planners with rotations, ``ocp_reward_rotation``. It must see the actions as the environment gets them, so
    wrappers that change actions go around it. While the object is held, a step draws one picture and makes one plan.

    Args:
        env: the environment, drawn with the planner's visual preset.
        planner: the planner or its file.
        config: weights and form of the plan's reward.
        mode: ``"augment"`` adds it to the task's own reward, ``"only"`` puts it in its place.

    Raises:
        MismatchError: the environment is none of ocplanner's, or of another task or visual preset than the planner.
        ModelFileError: the planner cannot be read.
        UnknownNameError: no such mode.
    """

    def __init__(
        self,
        env: gymnasium.Env[Any, np.ndarray],
        planner: Planner | str | Path,
        config: RewardConfig = DEFAULT,
        mode: LiveMode = "augment",
    ) -> None:
        super().__init__(env)
        inner = env.unwrapped
        if not isinstance(inner, GymnasiumEnv):
            raise MismatchError(
                f"{inner} is no environment of ocplanner; make one as gymnasium.make('ocplanner/...-v0')"
            )
        if mode not in get_args(LiveMode):
            raise UnknownNameError("reward mode", mode, get_args(LiveMode))
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
        terms = self._live.after(float(action[-1]), terminated)
        seen = {"reward_sparse": float(sparse), "ocp_reward_position": float(terms.position[0])}
        if terms.rotation is not None:
            seen["ocp_reward_rotation"] = float(terms.rotation[0])
        reward = float(terms.reward[0]) + (float(sparse) if self._augment else 0.0)
        return observation, reward, terminated, truncated, {**info, **seen}

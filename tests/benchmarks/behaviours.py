"""Episodes of Square, good and bad, with what a planner wanted at every step: what `reward_order.py` compares."""

import contextlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ocplanner import _core
from ocplanner.collection.attempts import attempt
from ocplanner.control.arm import CLOSE
from ocplanner.control.arm_program import ArmProgram, HorizonReached
from ocplanner.control.grasp import take_hold
from ocplanner.control.grasp_detection import GraspDetector
from ocplanner.control.settings import GraspSettings
from ocplanner.demos.demonstration import Demonstration
from ocplanner.envs.environment import ManipulationEnv
from ocplanner.geometry.pose import Pose
from ocplanner.guidance.live_plan import LivePlan
from ocplanner.planner.planner import Plan, Planner

AIMLESS_STEPS = 100
NEARER_STEPS = 10


@dataclass(frozen=True)
class Episode:
    """T transitions.

    Attributes:
        success: the task is solved at the end.
        held: (T,) bool, the object is held and a plan was made.
        planned: the plan's next pose, positions (T, 3) in m and rotations (T, 3, 3); the achieved one where not held.
        achieved: the object's pose after the transition.
        nearer: (T,) how much nearer to the peg, horizontally, the nut is some steps later, m.
    """

    success: bool
    held: np.ndarray
    planned: tuple[np.ndarray, np.ndarray]
    achieved: tuple[np.ndarray, np.ndarray]
    nearer: np.ndarray


class _Row(NamedTuple):
    plan: Plan | None
    achieved: Pose


class Recorder:
    """Plans along a live episode and keeps what the planner wanted and what happened."""

    def __init__(self, env: ManipulationEnv, planner: Planner) -> None:
        self.env, self._plans, self._rows = env, LivePlan(env, planner, steps=1), list[_Row]()
        self._hold = GraspDetector()
        self._plan: Plan | None = None

    def begin(self) -> None:
        """The environment has been reset."""
        self._hold, self._rows = GraspDetector(), []
        self._plan = self._planned(-1.0)

    def after(self, gripper: float) -> None:
        """The environment has made a step with this gripper command."""
        self._rows.append(_Row(self._plan, self.env.object_pose()))
        self._plan = self._planned(gripper)

    def _planned(self, last_gripper: float) -> Plan | None:
        held = self._hold.update(self.env.object_pose(), self.env.eef_pose().position, last_gripper)
        return self._plans.plan({}) if held else None

    def episode(self) -> Episode:
        """What was recorded since :meth:`begin`."""
        position = np.stack([row.achieved.position for row in self._rows])
        rotation = np.stack([row.achieved.rotation for row in self._rows])
        wanted = position.copy(), rotation.copy()
        for i, (plan, _) in enumerate(self._rows):
            if plan is not None and plan.rotation is not None:
                wanted[0][i], wanted[1][i] = plan.position[0, 0], plan.rotation[0, 0]
        distance = np.linalg.norm((position - self.env.data.body("peg1").xpos)[:, :2], axis=1)
        later = np.minimum(np.arange(len(distance)) + NEARER_STEPS, len(distance) - 1)
        held = np.array([row.plan is not None for row in self._rows])
        return Episode(self.env.success(), held, wanted, (position, rotation), distance - distance[later])


class RecordedArm:
    """An environment whose steps are recorded."""

    def __init__(self, recorder: Recorder) -> None:
        self._recorder = recorder

    def __getattr__(self, name: str) -> Any:
        return getattr(self._recorder.env, name)

    def reset(self, seed: int) -> None:
        """Begin an episode."""
        self._recorder.env.reset(seed)
        self._recorder.begin()

    def step(self, action: np.ndarray) -> None:
        """One control step."""
        self._recorder.env.step(action)
        self._recorder.after(float(action[-1]))


def _ignored(_: np.ndarray) -> None:
    pass


def expert(arm: Any, seed: int) -> None:
    """The scripted expert."""
    attempt(arm, seed, _ignored)


def released_early(arm: Any, seed: int) -> None:
    """The expert, whose hand opens on the way."""
    attempt(arm, seed, _ignored, flaw="early-release")


def beside_the_peg(arm: Any, seed: int) -> None:
    """The expert, who takes the peg to be 5 to 12 cm nearer than it is."""
    attempt(arm, seed, _ignored, flaw="misjudged-goal")


def aimless(arm: Any, seed: int) -> None:
    """Takes the nut and moves it about at random."""
    body, rng, drift = _with_the_nut(arm, seed), np.random.default_rng([seed, 1]), np.zeros(6)
    for _ in range(AIMLESS_STEPS):
        drift = 0.9 * drift + 0.3 * rng.normal(0.0, 0.6, 6) * [1, 1, 1, 0.3, 0.3, 0.3]
        body.act(np.clip(drift, -1, 1), CLOSE)


def still(arm: Any, seed: int) -> None:
    """Takes the nut and keeps it where it is."""
    body = _with_the_nut(arm, seed)
    for _ in range(AIMLESS_STEPS):
        body.wait(CLOSE)


def _with_the_nut(arm: Any, seed: int) -> ArmProgram:
    arm.reset(seed)
    body = ArmProgram(arm, _core.DeltaPoseLaw(gain_position=1.5, gain_rotation=1.5), arm.horizon)
    take_hold(body, arm.task.object(), arm.robot, GraspSettings())
    return body


BEHAVIOURS: dict[str, Callable[[Any, int], None]] = {
    "expert": expert,
    "released early": released_early,
    "beside the peg": beside_the_peg,
    "aimless": aimless,
    "still": still,
}


def play(recorder: Recorder, behaviour: str, seed: int) -> Episode:
    """One episode of a behaviour."""
    with contextlib.suppress(HorizonReached):
        BEHAVIOURS[behaviour](RecordedArm(recorder), seed)
    return recorder.episode()


def replay(recorder: Recorder, demo: Demonstration) -> Episode:
    """A recorded demonstration, state by state."""
    states, actions = demo.states, demo.actions
    recorder.env.set_state(states[0])
    recorder.begin()
    for state, action in zip(states[1:], actions[:-1]):
        recorder.env.set_state(state)
        recorder.after(float(action[-1]))
    return recorder.episode()

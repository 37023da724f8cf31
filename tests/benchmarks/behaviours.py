"""Episodes of Square, good and bad, with what a planner wanted at every step: what `reward_order.py` compares."""

import contextlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ocplanner.demos.demonstration import Demonstration
from ocplanner.demos.expert import Manner, NoisyBody, square_expert
from ocplanner.envs.environment import ManipulationEnv
from ocplanner.live_plan import LivePlan
from ocplanner.planner.planner import Plan, Planner
from ocplanner.pose import Pose
from ocplanner.transfer.body import CLOSE, OPEN, HorizonReached, Reading
from ocplanner.transfer.grasp import take_hold
from ocplanner.transfer.settings import GraspSettings

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
        self.env, self._plans, self._rows = env, LivePlan(env, planner), list[_Row]()
        self._plan: Plan | None = None

    def begin(self) -> None:
        """The environment has been reset."""
        self._plans.reset()
        self._rows, self._plan = [], self._plans.plan(-1.0, {}, steps=1)

    def after(self, gripper: float) -> None:
        """The environment has made a step with this gripper command."""
        self._rows.append(_Row(self._plan, self.env.object_pose()))
        self._plan = self._plans.plan(gripper, {}, steps=1)

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


class RecordedBody(NoisyBody):
    """The expert's body, recorded; once the nut is held it may lose it, or be wrong about where everything is.

    Args:
        recorder: sees every step.
        rng: the manner's and the tremor's.
        lose_after: steps with the nut in hand until the hand opens; None: never.
        bias: (3,) how far from the truth everything seems to be while the nut is in hand, m.
    """

    def __init__(
        self,
        recorder: Recorder,
        rng: np.random.Generator,
        lose_after: int | None = None,
        bias: np.ndarray | None = None,
    ) -> None:
        self.manner = Manner.draw(rng)
        super().__init__(recorder.env, recorder.env.horizon, self.manner.noise, rng, lambda _: None)
        self._recorder, self._lose_after, self._bias = recorder, lose_after, np.zeros(3) if bias is None else bias
        self.in_hand: int | None = None
        self.steady = True

    def act(self, delta: np.ndarray, grip: float) -> Reading:
        """One control step."""
        if not self.steady and self.in_hand is None:
            self.in_hand = 0  # the expert's hand is steady until it has taken hold
        if self.in_hand is not None:
            self.in_hand += 1
            if self._lose_after is not None and self.in_hand > self._lose_after:
                grip = OPEN
        reading = super().act(delta, grip)
        self._recorder.after(grip)
        return reading

    def read(self) -> Reading:
        """Sense, wrongly where there is a bias."""
        now = super().read()
        if self.steady and self.in_hand is None:
            return now
        shifted = (Pose(pose.position - self._bias, pose.rotation) for pose in (now.object, now.eef))
        return Reading(*shifted, now.opening)


def expert(recorder: Recorder, rng: np.random.Generator) -> None:
    """The scripted expert."""
    body = RecordedBody(recorder, rng)
    square_expert(recorder.env, body, body.manner)


def released_early(recorder: Recorder, rng: np.random.Generator) -> None:
    """The expert, whose hand opens on the way."""
    body = RecordedBody(recorder, rng, lose_after=int(rng.integers(10, 40)))
    square_expert(recorder.env, body, body.manner)


def beside_the_peg(recorder: Recorder, rng: np.random.Generator) -> None:
    """The expert, who takes the peg to be 5 to 12 cm from where it is."""
    angle = rng.uniform(0, 2 * np.pi)
    bias = rng.uniform(0.05, 0.12) * np.array([np.cos(angle), np.sin(angle), 0.0])
    body = RecordedBody(recorder, rng, bias=bias)
    square_expert(recorder.env, body, body.manner)


def aimless(recorder: Recorder, rng: np.random.Generator) -> None:
    """Takes the nut and moves it about at random."""
    body = _with_the_nut(recorder, rng)
    drift = np.zeros(6)
    for _ in range(AIMLESS_STEPS):
        drift = 0.9 * drift + 0.3 * rng.normal(0.0, 0.6, 6) * [1, 1, 1, 0.3, 0.3, 0.3]
        body.act(np.clip(drift, -1, 1), CLOSE)


def still(recorder: Recorder, rng: np.random.Generator) -> None:
    """Takes the nut and keeps it where it is."""
    body = _with_the_nut(recorder, rng)
    for _ in range(AIMLESS_STEPS):
        body.wait(CLOSE)


def _with_the_nut(recorder: Recorder, rng: np.random.Generator) -> RecordedBody:
    body = RecordedBody(recorder, rng)
    take_hold(body, recorder.env.task.object(), recorder.env.robot, GraspSettings())
    return body


BEHAVIOURS: dict[str, Callable[[Recorder, np.random.Generator], None]] = {
    "expert": expert,
    "released early": released_early,
    "beside the peg": beside_the_peg,
    "aimless": aimless,
    "still": still,
}


def play(recorder: Recorder, behaviour: str, seed: int) -> Episode:
    """One episode of a behaviour."""
    recorder.env.reset(seed)
    recorder.begin()
    with contextlib.suppress(HorizonReached):
        BEHAVIOURS[behaviour](recorder, np.random.default_rng([seed, 1]))
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

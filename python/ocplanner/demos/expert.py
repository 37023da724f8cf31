"""Scripted experts: they know where the goal is, and solve a task the way people demonstrated it."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from ocplanner import _core
from ocplanner.envs.environment import ManipulationEnv
from ocplanner.errors import UnknownNameError
from ocplanner.pose import Pose
from ocplanner.transfer.body import OPEN, Body, HorizonReached, Reading, raised
from ocplanner.transfer.grasp import is_held, take_hold
from ocplanner.transfer.settings import GraspSettings
from ocplanner.transfer.symmetry import angle_between, yaw_rotation

_GAIN = 1.5
_HANDLE_TOWARD_ROBOT = np.pi
_ALIGNED, _ALIGNED_ROTATION, _RESTING = 0.004, 0.12, 0.002


@dataclass(frozen=True)
class Manner:
    """How one demonstration differs from the next. Lengths in metres, per-step noise in units of the action."""

    carry_height: float
    """Height of the object over the table's surface on its way."""
    sideways: float
    """Largest distance of the path from the straight line, to the left of the way."""
    lookahead: float
    """How far ahead on the path the object is drawn: its speed."""
    release_height: float
    """Height of the object at which it is let go."""
    lowering: float
    """How far below the object its target is while it is let down."""
    yaw_error: float
    """Inaccuracy of the final yaw, radians."""
    noise: float
    """Standard deviation of the noise added to the hand's action."""

    @classmethod
    def draw(cls, rng: np.random.Generator) -> "Manner":
        """A manner within the spread of the human Square demonstrations."""
        return cls(
            carry_height=rng.uniform(0.98, 1.04),
            sideways=rng.normal(0.0, 0.025),
            lookahead=rng.uniform(0.025, 0.04),
            release_height=rng.uniform(0.895, 0.925),
            lowering=rng.uniform(0.008, 0.016),
            yaw_error=rng.normal(0.0, 0.05),
            noise=rng.uniform(0.03, 0.12),
        )


class NoisyBody(Body):
    """A body whose hand trembles slowly (an autoregressive noise on the first six numbers of the action)."""

    def __init__(
        self,
        env: ManipulationEnv,
        horizon: int,
        noise: float,
        rng: np.random.Generator,
        on_action: Callable[[np.ndarray], None],
    ) -> None:
        law = _core.DeltaPoseLaw(gain_position=_GAIN, gain_rotation=_GAIN)
        super().__init__(env, law, horizon)
        self._noise, self._rng, self._on_action = noise, rng, on_action
        self._tremor = np.zeros(6)
        self.steady = False

    def act(self, delta: np.ndarray, grip: float) -> Reading:
        """One control step, with noise unless :attr:`steady`."""
        self._tremor = 0.8 * self._tremor + 0.6 * self._rng.normal(0.0, self._noise, 6) * [1, 1, 1, 0.2, 0.2, 0.2]
        noisy = delta if self.steady else np.clip(delta + self._tremor, -1.0, 1.0)
        if self.steps < self.horizon:
            self._on_action(np.append(noisy, grip))
        return super().act(noisy, grip)


def square_expert(env: ManipulationEnv, body: NoisyBody, manner: Manner) -> bool:
    """Take the nut by its handle, carry it over the peg, let it down, let go and withdraw.

    Returns:
        Whether it got to the end; success is the environment's to judge.

    Raises:
        HorizonReached: it took too long.
    """
    grasp = GraspSettings()
    body.steady = True
    grip_point = take_hold(body, env.task.object(), env.robot, grasp)
    if grip_point is None:
        return False
    body.steady = False
    peg = env.data.body("peg1").xpos
    start = body.read().object
    goal = Pose(np.array([peg[0], peg[1], manner.carry_height]), yaw_rotation(_final_yaw(start) + manner.yaw_error))
    path = carry_path(start.position, goal.position, manner)
    place = 0
    aligned = 0  # steps in a row
    while aligned < 2:
        here = body.read().object
        place = advance(path, place, here.position, manner.lookahead)
        share = place / (len(path) - 1)
        now = body.move_object(Pose(path[place], _turned(start.rotation, goal.rotation, min(1.0, 1.3 * share))))
        if not is_held(now, grip_point, grasp):
            return False
        there = np.linalg.norm(now.object.position[:2] - goal.position[:2]) < _ALIGNED
        upright = angle_between(now.object.rotation, goal.rotation) < _ALIGNED_ROTATION
        slow = np.linalg.norm(now.object.position - here.position) < _RESTING
        body.steady = share > 0.95
        aligned = aligned + 1 if there and upright and slow else 0
    now = body.read()
    while now.object.position[2] > manner.release_height:
        below = np.array([*goal.position[:2], now.object.position[2] - manner.lowering])
        now = body.move_object(Pose(below, goal.rotation))
        if not is_held(now, grip_point, grasp):
            return False
    for _ in range(min(env.robot.stroke_steps, 10)):
        body.wait(OPEN)
    hand = raised(body.read().eef, 0.14)
    while body.move_hand(hand, OPEN).eef.position[2] < hand.position[2] - 0.02:
        pass
    return True


EXPERTS: dict[str, Callable[[ManipulationEnv, NoisyBody, Manner], bool]] = {"Square": square_expert}


def expert_of(task: str) -> Callable[[ManipulationEnv, NoisyBody, Manner], bool]:
    """The expert for a task.

    Raises:
        UnknownNameError: there is none.
    """
    if task not in EXPERTS:
        raise UnknownNameError("task with a scripted expert", task, EXPERTS)
    return EXPERTS[task]


def demonstrate(env: ManipulationEnv, seed: int, on_action: Callable[[np.ndarray], None]) -> bool:
    """Reset to a seed and let the expert work in a manner that the seed decides.

    Args:
        env: the robot before its task.
        seed: of the reset and of the manner.
        on_action: called before each control step with the action (7,).

    Returns:
        Whether the task is solved.
    """
    expert = expert_of(env.task.name)
    env.reset(seed)
    rng = np.random.default_rng([seed, 1])
    manner = Manner.draw(rng)
    body = NoisyBody(env, env.horizon, manner.noise, rng, on_action)
    try:
        finished = expert(env, body, manner)
    except HorizonReached:
        return False
    return finished and env.success()


def carry_path(start: np.ndarray, goal: np.ndarray, manner: Manner, points: int = 80) -> np.ndarray:
    """(points, 3) from the object's place up, over and along to above the goal, evenly spaced, metres."""
    way = goal - start
    left = np.array([-way[1], way[0], 0.0]) / max(1e-6, float(np.hypot(way[0], way[1])))
    up = np.array([0.0, 0.0, 1.0]) * (manner.carry_height - start[2])
    control = np.array(
        [start, start + 0.9 * up, start + 0.35 * way * [1, 1, 0] + up + 1.3 * manner.sideways * left, goal]
    )
    s = np.linspace(0.0, 1.0, 4 * points)[:, None]
    curve = (
        (1 - s) ** 3 * control[0]
        + 3 * s * (1 - s) ** 2 * control[1]
        + 3 * s**2 * (1 - s) * control[2]
        + s**3 * control[3]
    )
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
    even = np.linspace(0.0, length[-1], points)
    return np.stack([np.interp(even, length, curve[:, axis]) for axis in range(3)], axis=1)


def advance(path: np.ndarray, place: int, position: np.ndarray, lookahead: float) -> int:
    """Index of the path's point to aim at: the farthest within the lookahead, never going back."""
    ahead = np.flatnonzero(np.linalg.norm(path[place:] - position, axis=1) < lookahead)
    return place + int(ahead[-1]) if len(ahead) else place


def _final_yaw(start: Pose) -> float:
    """Of the four yaws that fit the peg, the nearest to the nut's but never the handle away from the robot."""
    yaw = np.arctan2(start.rotation[1, 0], start.rotation[0, 0])
    choices = _HANDLE_TOWARD_ROBOT + np.array([-np.pi / 2, 0.0, np.pi / 2])
    return float(choices[np.argmin(np.abs((choices - yaw + np.pi) % (2 * np.pi) - np.pi))])


def _turned(start: np.ndarray, goal: np.ndarray, share: float) -> np.ndarray:
    """Rotation part of the way along the shortest turn."""
    turn = Rotation.from_matrix(goal @ start.T).as_rotvec()
    return Rotation.from_rotvec(share * turn).as_matrix() @ start

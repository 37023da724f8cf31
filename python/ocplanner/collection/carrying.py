"""What every scripted expert does: take an object, carry it along a path, let it down, let go; or hand it over."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from ocplanner import _core
from ocplanner.control.arm import OPEN, Reading
from ocplanner.control.arm_multiplexer import ArmMultiplexer
from ocplanner.control.arm_program import ArmProgram
from ocplanner.control.grasp import close_around, is_held, take_hold
from ocplanner.control.settings import GraspSettings
from ocplanner.envs.environment import ManipulationEnv
from ocplanner.envs.tasks import ObjectSpec
from ocplanner.geometry.pose import Pose
from ocplanner.geometry.rotation import angle_between

_GAIN = 1.5
_GRASP = GraspSettings(steep=np.inf)
_ALIGNED, _ALIGNED_ROTATION, _RESTING = 0.004, 0.12, 0.002
_NEAR, _NEAR_ROTATION = 0.02, 0.15
_UPWARD = np.array([0.0, 0.0, 0.14])
_ARRIVING = 0.95  # share of the path from which the hand is steady and may have arrived


class ObjectLostError(Exception):
    """The expert did not get hold of the object, or it slipped out of the hand."""


@dataclass(frozen=True)
class DemonstrationVariation:
    """How one demonstration differs from the next. Lengths in metres, per-step noise in units of the action."""

    carry_height: float
    """Height of the object, in the world, on its way."""
    sideways: float
    """Largest distance of the path from the straight line, to the left of the way."""
    lookahead: float
    """How far ahead on the path the object is drawn: its speed."""
    release_height: float
    """Height of the object, in the world, at which it is let go."""
    lowering: float
    """How far below the object its target is while it is let down."""
    yaw_error: float
    """Inaccuracy of the final yaw, radians."""
    noise: float
    """Standard deviation of the noise added to the hand's action."""

    def scaled(self, noise: float) -> "DemonstrationVariation":
        """The manner with its detours, inaccuracy and tremor scaled: 0 for none."""
        return replace(self, sideways=noise * self.sideways, yaw_error=noise * self.yaw_error, noise=noise * self.noise)


class NoisyArmProgram(ArmProgram):
    """A body whose hand trembles slowly (an autoregressive noise on the first six numbers of the action).

    Args:
        env: the environment.
        horizon: steps until :class:`ocplanner.control.arm_program.HorizonReached`.
        noise: standard deviation of the noise, in units of the action.
        rng: its source.
        on_action: called before each control step with the action of all arms (7 arms,).
    """

    def __init__(
        self,
        env: ManipulationEnv,
        horizon: int,
        noise: float,
        rng: np.random.Generator,
        on_action: Callable[[np.ndarray], None],
    ) -> None:
        law = _core.DeltaPoseLaw(gain_position=_GAIN, gain_rotation=_GAIN)
        self.hands = ArmMultiplexer(env, law, env.task.object().name, on_action)
        super().__init__(self.hands, law, horizon)
        self._noise, self._rng = noise, rng
        self._tremor = np.zeros(6)
        self.steady = False

    def act(self, delta: np.ndarray, grip: float) -> Reading:
        """One control step, with noise unless :attr:`steady`."""
        self._tremor = 0.8 * self._tremor + 0.6 * self._rng.normal(0.0, self._noise, 6) * [1, 1, 1, 0.2, 0.2, 0.2]
        noisy = delta if self.steady else np.clip(delta + self._tremor, -1.0, 1.0)
        return super().act(noisy, grip)

    def return_hand(self, pose: Pose) -> None:
        """Move the open hand near a pose (2 cm, 0.15 rad), world.

        Raises:
            HorizonReached: it took too long.
        """
        now = self.read().eef
        while (
            np.linalg.norm(now.position - pose.position) > _NEAR
            or angle_between(now.rotation, pose.rotation) > _NEAR_ROTATION
        ):
            now = self.move_hand(pose, OPEN).eef


class Carrier:
    """One object in one hand, from the grasp to the release.

    Args:
        env: the robot before its task.
        body: its hands.
        manner: of the demonstration.
        name: the object; the task's main one if not given.
        arm: whose hand; of the object's first arm if not given.
    """

    def __init__(
        self,
        env: ManipulationEnv,
        body: NoisyArmProgram,
        manner: DemonstrationVariation,
        name: str | None = None,
        arm: int | None = None,
    ) -> None:
        self._env, self._body, self._manner = env, body, manner
        self._object = env.task.object(name)
        self._arm = self._object.arms[0] if arm is None else arm
        self._grip_point = np.zeros(3)
        self.turn_to()

    def turn_to(self) -> None:
        """Bring this hand and this object into play."""
        self._body.hands.activate(self._object.name, self._arm)

    def hand(self) -> Pose:
        """Where the hand is, world."""
        return self._body.read().eef

    def take(self, *grasps: str) -> Pose:
        """Take hold of the object; returns its pose in the hand, world.

        Args:
            *grasps: the ways to choose from, by that which turns the wrist least; all if not given.

        Raises:
            ObjectLostError: the hand missed it.
            HorizonReached: it took too long, here as in the other methods.
        """
        self._body.steady = True
        grip_point = take_hold(self._body, self._spec(grasps), self._env.robot, _GRASP)
        if grip_point is None:
            raise ObjectLostError
        self._body.steady = False
        self._grip_point = grip_point
        return self._body.read().object

    def take_from(self, giver: "Carrier", *grasps: str) -> Pose:
        """Take hold of the object that another hand holds still; that one lets go and withdraws.

        Args:
            giver: who holds it.
            *grasps: as for :meth:`take`.

        Returns:
            The object's pose, world.

        Raises:
            ObjectLostError: this hand missed it.
        """
        self.turn_to()
        self._body.steady = True
        close_around(self._body, replace(self._spec(grasps), hover=None), self._env.robot, _GRASP)
        self._grip_point = self._body.read().grip_point
        giver.turn_to()
        giver.let_go()
        self.turn_to()
        self._body.steady = False
        now = self._body.read()
        if not is_held(now, self._grip_point, _GRASP):
            raise ObjectLostError
        return now.object

    def carry(self, path: np.ndarray, rotation: np.ndarray, within: float = _ALIGNED) -> None:
        """Carry the object to the path's end, turning it on the way, until it rests there.

        Args:
            path: (N, 3) world, metres.
            rotation: (3, 3) at the end, object -> world.
            within: horizontal distance from the end that is near enough, metres.

        Raises:
            ObjectLostError: it slipped out of the hand.
        """
        start = self._body.read().object.rotation
        place = 0
        aligned = 0  # steps in a row
        while aligned < 2:
            here = self._body.read().object
            place = advance(path, place, here.position, self._manner.lookahead)
            share = place / (len(path) - 1)
            now = self._move(Pose(path[place], turned(start, rotation, min(1.0, 1.3 * share))))
            self._body.steady = share > _ARRIVING
            there = np.linalg.norm(now.object.position[:2] - path[-1, :2]) < within and share > _ARRIVING
            upright = angle_between(now.object.rotation, rotation) < _ALIGNED_ROTATION
            slow = np.linalg.norm(now.object.position - here.position) < _RESTING
            aligned = aligned + 1 if there and upright and slow else 0

    def hold(self, pose: Pose, steps: int) -> None:
        """Keep the object at a pose.

        Raises:
            ObjectLostError: it slipped out of the hand.
        """
        for _ in range(steps):
            self._move(pose)

    def lift(self, goal: np.ndarray) -> Pose:
        """Raise the object, turned as it is, until it is as high as the goal; returns its pose.

        Args:
            goal: (3,) world, metres: beside the goal's vertical the object goes toward it from the start.

        Raises:
            ObjectLostError: it slipped out of the hand.
        """
        now = self._body.read()
        rotation = now.object.rotation
        while now.object.position[2] < goal[2]:
            above = np.array([*goal[:2], now.object.position[2] + self._manner.lowering])
            now = self._move(Pose(above, rotation))
        return now.object

    def let_down(self, goal: Pose, height: float | None = None) -> None:
        """Let the object down over the goal.

        Args:
            goal: horizontal place and rotation.
            height: to which the object is let down, world; the manner's height of release if not given.

        Raises:
            ObjectLostError: it slipped out of the hand.
        """
        height = self._manner.release_height if height is None else height
        now = self._body.read()
        while now.object.position[2] > height:
            below = np.array([*goal.position[:2], now.object.position[2] - self._manner.lowering])
            now = self._move(Pose(below, goal.rotation))

    def let_go(self, way: np.ndarray = _UPWARD) -> None:
        """Open the hand and withdraw it along a way (3,), world, metres."""
        for _ in range(min(self._env.robot.stroke_steps, 10)):
            self._body.wait(OPEN)
        start = self._body.read().eef
        length = float(np.linalg.norm(way))
        hand = Pose(start.position + way, start.rotation)
        while (self._body.move_hand(hand, OPEN).eef.position - start.position) @ way / length < length - 0.02:
            pass

    def _spec(self, grasps: tuple[str, ...]) -> ObjectSpec:
        """The object as this hand takes it: upright, and with some of its grasps only if they are named."""
        upright = replace(self._object, lean=0.0)
        return replace(upright, grasps=tuple(map(self._object.grasp, grasps))) if grasps else upright

    def _move(self, target: Pose) -> Reading:
        now = self._body.move_object(target)
        if not is_held(now, self._grip_point, _GRASP):
            raise ObjectLostError
        return now


def carry_path(start: np.ndarray, goal: np.ndarray, manner: DemonstrationVariation) -> np.ndarray:
    """(80, 3) from the object's place up, over and along to above the goal, evenly spaced, metres."""
    way = goal - start
    left = np.array([-way[1], way[0], 0.0]) / max(1e-6, float(np.hypot(way[0], way[1])))
    up = np.array([0.0, 0.0, 1.0]) * (manner.carry_height - start[2])
    control = np.array(
        [start, start + 0.9 * up, start + 0.35 * way * [1, 1, 0] + up + 1.3 * manner.sideways * left, goal]
    )
    s = np.linspace(0.0, 1.0, 320)[:, None]
    curve = (
        (1 - s) ** 3 * control[0]
        + 3 * s * (1 - s) ** 2 * control[1]
        + 3 * s**2 * (1 - s) * control[2]
        + s**3 * control[3]
    )
    return evenly_spaced(curve, 80)


def evenly_spaced(curve: np.ndarray, points: int) -> np.ndarray:
    """(points, 3) along a finely drawn curve (N, 3)."""
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
    even = np.linspace(0.0, length[-1], points)
    return np.stack([np.interp(even, length, curve[:, axis]) for axis in range(3)], axis=1)


def advance(path: np.ndarray, place: int, position: np.ndarray, lookahead: float) -> int:
    """Index of the path's point to aim at: the farthest within the lookahead, never going back."""
    ahead = np.flatnonzero(np.linalg.norm(path[place:] - position, axis=1) < lookahead)
    return place + int(ahead[-1]) if len(ahead) else place


def turned(start: np.ndarray, goal: np.ndarray, share: float) -> np.ndarray:
    """Rotation part of the way along the shortest turn."""
    turn = Rotation.from_matrix(goal @ start.T).as_rotvec()
    return Rotation.from_rotvec(share * turn).as_matrix() @ start

"""What every scripted expert does: take an object, carry it along a path, lower it and let go, or hand it over."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from ocplanner.collection.arm_programs import NoisyArmProgram
from ocplanner.control.arm import OPEN, Reading
from ocplanner.control.grasp import close_around, is_held, take_hold
from ocplanner.control.settings import GraspSettings
from ocplanner.envs.environment import ManipulationEnv
from ocplanner.envs.tasks import ObjectSpec
from ocplanner.geometry.pose import Pose
from ocplanner.geometry.rotation import angle_between

_GRASP = GraspSettings(steep=np.inf)
_ALIGNED, _ALIGNED_ROTATION, _RESTING = 0.004, 0.12, 0.002  # m, rad, m a step
_UPWARD = np.array([0.0, 0.0, 0.14])  # m
_ARRIVING = 0.95  # share of the path beyond which the hand is steady and may have arrived


class ObjectLostError(Exception):
    """The hand missed the object, or lost it."""


@dataclass(frozen=True)
class DemonstrationVariation:
    """How one demonstration differs from the next. Lengths in metres, per-step noise in units of the action."""

    carry_height: float
    """Height of the object on its way, world."""
    sideways: float
    """Largest distance of the path from the straight line; positive to the left."""
    lookahead: float
    """How far ahead on the path the target is: the object's speed."""
    release_height: float
    """Height of the object at the release, world."""
    lowering: float
    """How far below the object the target is while it is lowered."""
    yaw_error: float
    """Error of the final yaw, radians."""
    noise: float
    """Standard deviation of the tremor added to the action."""

    def scaled(self, noise: float) -> "DemonstrationVariation":
        """The same with detour, yaw error and tremor scaled; 0 for none."""
        return replace(self, sideways=noise * self.sideways, yaw_error=noise * self.yaw_error, noise=noise * self.noise)


class Carrier:
    """One object and the hand that carries it, from the grasp to the release.

    Args:
        env: the robot and its task.
        program: moves its arms.
        variation: of the demonstration.
        name: the object; the task's main one if not given.
        arm: number of the arm; the object's first if not given.
    """

    def __init__(
        self,
        env: ManipulationEnv,
        program: NoisyArmProgram,
        variation: DemonstrationVariation,
        name: str | None = None,
        arm: int | None = None,
    ) -> None:
        self._env, self._program, self._variation = env, program, variation
        self._object = env.task.object(name)
        self._arm = self._object.arms[0] if arm is None else arm
        self._grip_point = np.zeros(3)
        self.activate()

    def activate(self) -> None:
        """Make this arm and this object the active ones."""
        self._program.arms.activate(self._object.name, self._arm)

    def hand(self) -> Pose:
        """Pose of the hand, world."""
        return self._program.read().eef

    def take(self, *grasps: str) -> Pose:
        """Grasp the object.

        Args:
            *grasps: names of the grasps to choose from; the one that turns the wrist least is taken. All if not given.

        Returns:
            The object's pose in the hand, world.

        Raises:
            ObjectLostError: the hand missed it.
            HorizonReached: the episode's steps are used up; every other method may raise it too.
        """
        self._program.steady = True
        grip_point = take_hold(self._program, self._spec(grasps), self._env.robot, _GRASP)
        if grip_point is None:
            raise ObjectLostError
        self._program.steady = False
        self._grip_point = grip_point
        return self._program.read().object

    def take_from(self, giver: "Carrier", *grasps: str) -> Pose:
        """Grasp the object while another hand holds it still; then that hand releases it and withdraws.

        Args:
            giver: the other hand.
            *grasps: as for :meth:`take`.

        Returns:
            The object's pose, world.

        Raises:
            ObjectLostError: this hand missed it.
        """
        self.activate()
        self._program.steady = True
        close_around(self._program, replace(self._spec(grasps), hover=None), self._env.robot, _GRASP)
        self._grip_point = self._program.read().grip_point
        giver.activate()
        giver.release()
        self.activate()
        self._program.steady = False
        now = self._program.read()
        if not is_held(now, self._grip_point, _GRASP):
            raise ObjectLostError
        return now.object

    def carry(self, path: np.ndarray, rotation: np.ndarray, within: float = _ALIGNED) -> None:
        """Carry the object along a path, turning it on the way, until it rests at the end.

        Args:
            path: (N, 3) world, metres.
            rotation: (3, 3) at the end, object -> world.
            within: horizontal distance from the end at which it has arrived, metres.

        Raises:
            ObjectLostError: it slipped out of the hand.
        """
        start = self._program.read().object.rotation
        place = 0
        aligned = 0  # steps in a row
        while aligned < 2:
            here = self._program.read().object
            place = advance(path, place, here.position, self._variation.lookahead)
            share = place / (len(path) - 1)
            now = self._move(Pose(path[place], turned(start, rotation, min(1.0, 1.3 * share))))
            self._program.steady = share > _ARRIVING
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
        """Raise the object to a height without turning it, moving toward the goal's vertical on the way.

        Args:
            goal: (3,) world, metres.

        Returns:
            The object's pose, world.

        Raises:
            ObjectLostError: it slipped out of the hand.
        """
        now = self._program.read()
        rotation = now.object.rotation
        while now.object.position[2] < goal[2]:
            above = np.array([*goal[:2], now.object.position[2] + self._variation.lowering])
            now = self._move(Pose(above, rotation))
        return now.object

    def lower(self, goal: Pose, height: float | None = None) -> None:
        """Lower the object over the goal.

        Args:
            goal: horizontal position and rotation, world.
            height: to lower it to, world, metres; the variation's release height if not given.

        Raises:
            ObjectLostError: it slipped out of the hand.
        """
        height = self._variation.release_height if height is None else height
        now = self._program.read()
        while now.object.position[2] > height:
            below = np.array([*goal.position[:2], now.object.position[2] - self._variation.lowering])
            now = self._move(Pose(below, goal.rotation))

    def release(self, way: np.ndarray = _UPWARD) -> None:
        """Open the hand and withdraw it by a displacement (3,), world, metres."""
        for _ in range(min(self._env.robot.stroke_steps, 10)):
            self._program.wait(OPEN)
        start = self._program.read().eef
        length = float(np.linalg.norm(way))
        hand = Pose(start.position + way, start.rotation)
        while (self._program.move_hand(hand, OPEN).eef.position - start.position) @ way / length < length - 0.02:
            pass

    def _spec(self, grasps: tuple[str, ...]) -> ObjectSpec:
        """The object for this hand: grasped without a lean, by the named grasps if there are any."""
        upright = replace(self._object, lean=0.0)
        return replace(upright, grasps=tuple(map(self._object.grasp, grasps))) if grasps else upright

    def _move(self, target: Pose) -> Reading:
        now = self._program.move_object(target)
        if not is_held(now, self._grip_point, _GRASP):
            raise ObjectLostError
        return now


def carry_path(start: np.ndarray, goal: np.ndarray, variation: DemonstrationVariation) -> np.ndarray:
    """(80, 3) evenly spaced points of a Bezier curve: from the object up, and along to the goal; world, metres."""
    way = goal - start
    left = np.array([-way[1], way[0], 0.0]) / max(1e-6, float(np.hypot(way[0], way[1])))
    up = np.array([0.0, 0.0, 1.0]) * (variation.carry_height - start[2])
    control = np.array(
        [start, start + 0.9 * up, start + 0.35 * way * [1, 1, 0] + up + 1.3 * variation.sideways * left, goal]
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
    """(points, 3) at equal distances along a densely sampled curve (N, 3)."""
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
    even = np.linspace(0.0, length[-1], points)
    return np.stack([np.interp(even, length, curve[:, axis]) for axis in range(3)], axis=1)


def advance(path: np.ndarray, place: int, position: np.ndarray, lookahead: float) -> int:
    """Index of the point of a path to aim at: the farthest within the lookahead, never before ``place``."""
    ahead = np.flatnonzero(np.linalg.norm(path[place:] - position, axis=1) < lookahead)
    return place + int(ahead[-1]) if len(ahead) else place


def turned(start: np.ndarray, goal: np.ndarray, share: float) -> np.ndarray:
    """The rotation at a share of the shortest turn from start to goal."""
    turn = Rotation.from_matrix(goal @ start.T).as_rotvec()
    return Rotation.from_rotvec(share * turn).as_matrix() @ start

"""A work cell without a simulator: hands that fly where they are told, objects that go with the hand around them."""

from types import SimpleNamespace

import numpy as np

from ocplanner.envs.robots import RobotSpec
from ocplanner.envs.tasks import ObjectSpec
from ocplanner.geometry.pose import Pose
from ocplanner.geometry.rotation import rotation_exp

DOWN = np.diag([1.0, -1.0, -1.0])
FLOOR, WIDE, WIDTH = 0.8, 0.08, 0.03  # m: where objects come to lie, the open fingers, and the objects between them
_RESPONSE, _STROKE, _GRASPED = 0.3, 0.01, 0.02  # share of a command, m a step, m from a grasp


class FloatingReach:
    """An arm that gets everywhere."""

    def __init__(self, base: np.ndarray) -> None:
        self.base = base

    def outward(self, position: np.ndarray) -> np.ndarray:
        way = (position - self.base) * [1, 1, 0]
        return way / np.linalg.norm(way)

    def reach_error(self, pose: Pose) -> float:
        return 0.0

    def wrist_room(self, pose: Pose, turn: float) -> float:
        return 1.0


class FloatingArm:
    """A hand that does about a third of what it is told in each step."""

    base_rotation = np.eye(3)

    def __init__(self, home: Pose) -> None:
        self.pose, self.gripper_opening = home, WIDE
        self.reach = FloatingReach(home.position + np.array([0.0, 0.6 * np.sign(home.position[1] or 1.0), -0.2]))

    def eef_pose(self) -> Pose:
        return self.pose

    def move(self, action: np.ndarray, narrowest: float) -> None:
        turn = rotation_exp(_RESPONSE * 0.5 * action[3:6])
        self.pose = Pose(self.pose.position + _RESPONSE * 0.05 * action[:3], turn @ self.pose.rotation)
        self.gripper_opening = float(np.clip(self.gripper_opening - _STROKE * action[6], narrowest, WIDE))


class FloatingCell:
    """Arms that hang from nothing before objects on a floor.

    Args:
        objects: what they are, and where they lie, by name.
        homes: where the hands are.
    """

    robot = RobotSpec("Panda")

    def __init__(self, objects: dict[str, tuple[ObjectSpec, Pose]], homes: list[Pose]) -> None:
        self.specs = {name: spec for name, (spec, _) in objects.items()}
        self.poses = {name: pose for name, (_, pose) in objects.items()}
        self.arms = [FloatingArm(home) for home in homes]
        self.holders: dict[str, list[FloatingArm]] = {name: [] for name in objects}

    def object_pose(self, name: str) -> Pose:
        return self.poses[name]

    def step(self, action: np.ndarray) -> None:
        before = {arm: arm.pose for arm in self.arms}
        for arm, part in zip(self.arms, np.split(action, len(self.arms)), strict=True):
            arm.move(part, WIDTH if any(self._between(arm, name) for name in self.poses) else 0.0)
        for name, holders in self.holders.items():
            holders[:] = [arm for arm in holders if arm.gripper_opening <= WIDTH]
            if holders:
                self.poses[name] = holders[0].pose @ before[holders[0]].inverse() @ self.poses[name]
            else:
                here = self.poses[name]
                self.poses[name] = here._replace(position=np.append(here.position[:2], FLOOR))
            for arm in self.arms:
                if arm not in holders and arm.gripper_opening == WIDTH and self._between(arm, name):
                    holders.append(arm)

    def _between(self, arm: FloatingArm, name: str) -> bool:
        grips = [(self.poses[name] @ grasp.pose_object_eef).position for grasp in self.specs[name].grasps]
        return min(float(np.linalg.norm(grip - arm.pose.position)) for grip in grips) < _GRASPED


class Toward:
    """Plans an object's way up, over and down to a place; straight to it where ``over`` is False."""

    def __init__(self, cell: FloatingCell, name: str, goal: np.ndarray, *, over: bool = True) -> None:
        self.cell, self.name, self.goal, self.over = cell, name, goal, over

    def plan(self, images: dict[str, np.ndarray]) -> SimpleNamespace:
        here = self.cell.object_pose(self.name).position
        points = [here, self.goal]
        if self.over and np.linalg.norm((here - self.goal)[:2]) > 0.03:
            up, over = (np.append(place[:2], FLOOR + 0.15) for place in (here, self.goal))
            points = [here, over] if here[2] > FLOOR + 0.1 else [here, up, over]
        share = np.linspace(0, len(points) - 1, 21)[1:]
        line = np.column_stack([np.interp(share, range(len(points)), np.array(points)[:, axis]) for axis in range(3)])
        return SimpleNamespace(position=line[None], rotation=None)

"""Observations and rewards of recordings that hold only states: read from the simulator that shows those states."""

from collections import OrderedDict
from typing import TYPE_CHECKING, Any

import numpy as np

from ocplanner.demos.layouts import Order
from ocplanner.demos.object_sensors import OBJECT_SENSORS
from ocplanner.envs.tasks import Task

if TYPE_CHECKING:
    from ocplanner.demos.demonstration import Demonstration
    from ocplanner.demos.recorded_world import RecordedWorld

DERIVED_ORDER: Order = "absolute-first"
"""The order of a derived ``object``."""
_REMEMBERED = 32


class DerivedObservations:
    """Of one file; the simulation starts when it is first needed, in each process anew.

    Args:
        task: the task.
        robot: the arm.
        grippers: the data set's ``gripper_types``.

    Attributes:
        keys: names of the observations.
    """

    def __init__(self, task: Task, robot: str, grippers: object) -> None:
        self._made_of = (task, robot, grippers)
        hands = [f"robot{number}_eef_pos" for number in range(task.arms)]
        poses = [f"{spec.name}_{part}" for spec in task.objects for part in ("pos", "quat")]
        vector = ["object"] if task.env_name in OBJECT_SENSORS else []
        self.keys = (*hands, "robot0_eef_quat", "robot0_gripper_qpos", *poses, *vector)
        self._forget()

    def __getstate__(self) -> dict[str, Any]:
        """What it is made of, never the simulation."""
        return {"_made_of": self._made_of, "keys": self.keys}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Start without a simulation."""
        self.__dict__.update(state)
        self._forget()

    def _forget(self) -> None:
        self._world: RecordedWorld | None = None
        self._found: OrderedDict[str, dict[str, np.ndarray]] = OrderedDict()

    def of(self, demo: "Demonstration") -> dict[str, np.ndarray]:
        """(T, n) float64 arrays by the names of ``obs``, and ``success`` (T,) bool of each state.

        Raises:
            DatasetError: the states are missing or have another model's size.
            MismatchError: another world was recorded.
        """
        if demo.name not in self._found:
            self._found[demo.name] = self._read(demo)
            while len(self._found) > _REMEMBERED:
                self._found.popitem(last=False)
        return self._found[demo.name]

    def compare(self, demo: "Demonstration") -> None:
        """Compare what was recorded with what is simulated; errors as for :meth:`of`."""
        self._open().open(demo)

    def close(self) -> None:
        """Free the simulation."""
        if self._world is not None:
            self._world.env.close()
        self._forget()

    def _read(self, demo: "Demonstration") -> dict[str, np.ndarray]:
        world = self._open()
        rows = []
        for state in world.open(demo):
            world.show(demo, state)
            rows.append(_observed(world))
        return {key: np.array([row[key] for row in rows]) for key in rows[0]}

    def _open(self) -> "RecordedWorld":
        if self._world is None:
            from ocplanner.demos.recorded_world import RecordedWorld
            from ocplanner.envs import make_env

            task, robot, grippers = self._made_of
            self._world = RecordedWorld(make_env(task, robot, cameras=()), grippers)
        return self._world


def _observed(world: "RecordedWorld") -> dict[str, np.ndarray]:
    from ocplanner.demos.recorded_observation import recorded_observation

    env = world.env
    found = recorded_observation(env, DERIVED_ORDER if env.task.env_name in OBJECT_SENSORS else None)
    for number, arm in enumerate(env.arms):
        found[f"robot{number}_eef_pos"] = arm.eef_pose().position
    for spec in env.task.objects:
        pose, body = env.object_pose(spec.name), env.model.jnt_bodyid[env.model.joint(spec.joint).id]
        found[f"{spec.name}_pos"] = pose.position
        found[f"{spec.name}_quat"] = np.roll(env.data.xquat[body], -1)
    return {**found, "success": np.array(env.success())}

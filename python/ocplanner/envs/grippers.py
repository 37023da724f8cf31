"""A gripper's fingers and opening, measured on the model rather than listed for each gripper."""

import copy
from functools import cached_property
from typing import Any

import numpy as np

from ocplanner.envs.robots import RobotSpec
from ocplanner.envs.simulator import mujoco

_LEVELS = 21
_SUBSTEPS = 60
_FARTHEST_M = 0.5
_NUDGE_M = 1e-6


class Gripper:
    """The gripper of a robosuite arm.

    Args:
        robot: robosuite's robot.
        model: the compiled model.
        data: its state.
        spec: the arm's peculiarities.
    """

    def __init__(self, robot: Any, model: Any, data: Any, spec: RobotSpec) -> None:
        arm = robot.arms[0]
        self._robot = robot
        self._gripper = robot.gripper[arm]
        self._model = model
        self._data = data
        self._qpos = np.array(robot._ref_gripper_joint_pos_indexes[arm])
        self._actuators = np.array(robot._ref_joint_gripper_actuator_indexes[arm])
        self._pinned_qpos = np.array(robot._ref_joint_pos_indexes)
        self._pinned_dofs = np.array(robot._ref_joint_vel_indexes)
        self.fingers = tuple(self._geoms(side, (f"{side}_finger", f"{side}_fingerpad")) for side in ("left", "right"))
        self._is_finger = [np.isin(np.arange(model.ngeom), side) for side in self.fingers]
        self.pads = tuple(self._geoms(side, (f"{side}_fingerpad",), spec.spare_finger) for side in ("left", "right"))

    @property
    def opening(self) -> float:
        """Gap between the finger pads, metres."""
        return self._gap(self._data)

    def set_opening(self, opening: float) -> None:
        """Set the finger joints to a gap between the pads, metres, or to the nearest possible gap."""
        openings, postures = self._stroke
        self._data.qpos[self._qpos] = [np.interp(opening, openings, joint) for joint in postures.T]

    def touches(self, geoms: np.ndarray) -> bool:
        """Whether both sides of the gripper are in contact with any of these geoms."""
        pairs = self._data.contact.geom
        is_object = np.zeros(self._model.ngeom, dtype=bool)
        is_object[geoms] = True
        first, second = is_object[pairs].T
        partners = np.concatenate([pairs[second, 0], pairs[first, 1]])
        return all(bool(self._is_finger[side][partners].any()) for side in range(2))

    @cached_property
    def _stroke(self) -> tuple[np.ndarray, np.ndarray]:
        """Openings in ascending order (levels,) and the finger joints at each (levels, joints), from one closing.

        The fingers close on nothing, with the arm in its home posture: whatever the environment shows when this is
        first read, the answer is the same.
        """
        model = _touching_nothing_else(self._model, self._gripper)
        data = mujoco.MjData(model)
        data.qpos[self._pinned_qpos] = arm = np.array(self._robot.init_qpos, dtype=np.float64)
        data.qpos[self._qpos] = self._gripper.init_qpos
        saved = self._gripper.current_action
        low, high = model.actuator_ctrlrange[self._actuators].T
        openings, postures = [], []
        try:
            for level in np.linspace(-1.0, 1.0, _LEVELS):
                command = self._command(level)
                data.ctrl[self._actuators] = (high + low) / 2 + (high - low) / 2 * command
                for _ in range(_SUBSTEPS * (5 if level == -1.0 else 1)):
                    mujoco.mj_step(model, data)
                    data.qpos[self._pinned_qpos] = arm
                    data.qvel[self._pinned_dofs] = 0.0
                mujoco.mj_kinematics(model, data)
                openings.append(self._gap(data))
                postures.append(data.qpos[self._qpos].copy())
        finally:
            self._gripper.current_action = saved
        ascending = np.maximum.accumulate(openings[::-1]) + 1e-9 * np.arange(_LEVELS)
        return ascending, np.array(postures[::-1])

    def _command(self, level: float) -> np.ndarray:
        """The gripper's actuator commands, each in [-1, 1], if its own integrator is at ``level``."""
        gripper = self._gripper
        gripper.current_action = np.zeros(gripper.dof)
        direction = np.array(gripper.format_action(np.full(gripper.dof, 1.0)), dtype=np.float64)
        return np.sign(direction) * level

    def _gap(self, data: Any) -> float:
        return max(0.0, min(self._distance(data, left, right) for left in self.pads[0] for right in self.pads[1]))

    def _distance(self, data: Any, left: int, right: int) -> float:
        """Distance between two geoms, metres.

        MuJoCo 3.7 reports 0 for some boxes that are centimetres apart, but not if one of them moves by a micrometre.
        """

        def distance() -> float:
            return float(mujoco.mj_geomDistance(self._model, data, left, right, _FARTHEST_M, None))

        found, position = distance(), data.geom_xpos[left].copy()
        if found != 0.0:
            return found
        try:
            for nudge in np.eye(3) * _NUDGE_M:
                data.geom_xpos[left] = position + nudge
                found = max(found, distance())
        finally:
            data.geom_xpos[left] = position
        return found

    def _geoms(self, side: str, groups: tuple[str, ...], without: str | None = None) -> np.ndarray:
        """Ids of one side's geoms: those that robosuite names, or else the colliding geoms of that side's bodies."""
        named = [name for group in groups for name in self._gripper.important_geoms.get(group, ())]
        if without is not None:
            named = [name for name in named if not name.startswith(self._gripper.naming_prefix + without)]
        ids = {mujoco.mj_name2id(self._model, mujoco.mjtObj.mjOBJ_GEOM, name) for name in named} - {-1}
        if not ids:
            prefix = f"{self._gripper.naming_prefix}{side}_finger"
            for geom in range(self._model.ngeom):
                body = mujoco.mj_id2name(self._model, mujoco.mjtObj.mjOBJ_BODY, self._model.geom_bodyid[geom])
                if body and body.startswith(prefix) and self._model.geom_contype[geom]:
                    ids.add(geom)
        return np.array(sorted(ids))


def _touching_nothing_else(model: Any, gripper: Any) -> Any:
    """A copy of a model in which only a gripper's own parts can touch each other."""
    alone = copy.copy(model)
    for geom in range(model.ngeom):
        body = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, model.geom_bodyid[geom]) or ""
        if not body.startswith(gripper.naming_prefix):
            alone.geom_contype[geom] = alone.geom_conaffinity[geom] = 0
    return alone

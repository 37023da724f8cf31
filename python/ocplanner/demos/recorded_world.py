"""A data set's states in the simulator, compared with everything else that the recording says about its world."""

from typing import TYPE_CHECKING

import numpy as np

from ocplanner.envs import ManipulationEnv
from ocplanner.envs.kinematics import home_posture
from ocplanner.envs.recorded_model import RecordedModels
from ocplanner.envs.robots import ROBOTS
from ocplanner.errors import DatasetError, MismatchError, ShapeError

if TYPE_CHECKING:
    from ocplanner.demos.demonstration import Demonstration

HAND_M = 0.01
"""How far the simulated hand may be from the recorded one in the median step, metres. robosuite 1.5 records it one step
late, which is a few millimetres; another arm or gripper is centimetres off."""
_BEYOND_RAD = 0.1
_COMPARED = 9
_SAME_POSTURE_RAD, _OTHER_POSTURE_RAD = 0.15, 0.5
"""robosuite starts within 0.06 rad of an arm's home posture; those of different arms are 1.5 rad apart or more."""


class RecordedWorld:
    """Shows demonstrations of one file in an environment, each with its own recorded model.

    Args:
        env: the task with the recorded arms.
        grippers: the data set's ``gripper_types``, None if it does not say.

    Raises:
        MismatchError: the recording has another gripper than the simulated arm.
    """

    def __init__(self, env: ManipulationEnv, grippers: object = None) -> None:
        self.env = env
        self._models = RecordedModels(env)
        self._check_grippers(grippers)

    def open(self, demo: "Demonstration") -> np.ndarray:
        """The (T, D) states of a demonstration that this world shows; :meth:`show` one after the other.

        Raises:
            DatasetError: the states are missing or have another model's size.
            MismatchError: another arm, gripper or scene was recorded.
        """
        states, env = demo.states, self.env
        try:
            self._models.take_over(demo.model_file)
        except (DatasetError, MismatchError) as error:
            raise type(error)(f"{demo!r}: {error}") from error
        self.show(demo, states[0])
        for arm in env.arms:
            joints = states[:, 1 + arm.joints.qpos]
            beyond = np.maximum(arm.joints.lower - joints, joints - arm.joints.upper).max()
            if beyond > _BEYOND_RAD:
                raise MismatchError(
                    f"{demo!r}: the states hold joints {beyond:.2f} rad beyond the limits of {env.robot.name}: "
                    "another arm was recorded; correct `robots` in env_args"
                )
            self._compare_start(demo, joints[0], arm.joints.home)
        self._compare_hands(demo, states)
        return states

    def show(self, demo: "Demonstration", state: np.ndarray) -> None:
        """Set the simulation to one of the states.

        Raises:
            DatasetError: it has another model's size.
        """
        try:
            self.env.set_state(state)
        except ShapeError as error:
            raise DatasetError(f"{demo!r}: {error}; record the demonstration again") from error

    def _check_grippers(self, grippers: object) -> None:
        robot = self.env.arms[0].robot
        simulated = type(robot.gripper[robot.arms[0]]).__name__
        named = grippers if isinstance(grippers, list | tuple) else [grippers]
        for name in named:
            if name is not None and str(name) not in ("default", simulated):
                raise MismatchError(
                    f"recorded with the gripper {name}, but {self.env.robot.name} is simulated with {simulated}; "
                    "record with that one, or correct `gripper_types` in env_args"
                )

    def _compare_start(self, demo: "Demonstration", start: np.ndarray, home: np.ndarray) -> None:
        """Refuse a recording that begins in the home posture of another arm than the simulated one."""
        if np.abs(start - home).max() < _OTHER_POSTURE_RAD:
            return
        for name in ROBOTS:
            other = home_posture(name)
            if other.shape == start.shape and np.abs(start - other).max() < _SAME_POSTURE_RAD:
                raise MismatchError(
                    f"{demo!r} begins in the home posture of {name}, not of {self.env.robot.name}; correct `robots` in "
                    "env_args"
                )

    def _compare_hands(self, demo: "Demonstration", states: np.ndarray) -> None:
        rows = np.unique(np.linspace(0, len(states) - 1, _COMPARED).astype(int))
        hands = {number: demo.stored_hand(number) for number in range(len(self.env.arms))}
        recorded = {number: places[rows] for number, places in hands.items() if places is not None}
        if not recorded:
            return
        off = {number: [] for number in recorded}
        for place, row in enumerate(rows):
            self.show(demo, states[row])
            for number, places in recorded.items():
                off[number].append(np.linalg.norm(self.env.arms[number].eef_pose().position - places[place]))
        for number, distances in off.items():
            median = float(np.median(distances))
            if median > HAND_M:
                raise MismatchError(
                    f"{demo!r}: the states put the hand of robot{number} {100 * median:.1f} cm from its recorded place "
                    f"(obs/robot{number}_eef_pos; at most {100 * HAND_M:g} cm): another arm or gripper than "
                    f"{self.env.robot.name}'s was recorded; correct `robots` in env_args, or record it again"
                )

"""The frame and scale in which a data set's actions move the end effector (OSC_POSE deltas)."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ocplanner.demos.dataset import Demonstrations
from ocplanner.demos.demonstration import Demonstration
from ocplanner.demos.layouts import is_from_1_5
from ocplanner.demos.origin import controllers, is_absolute
from ocplanner.envs import make_env
from ocplanner.errors import DatasetError, MismatchError
from ocplanner.files.records.labels import ActionScale, FrameName

if TYPE_CHECKING:
    from ocplanner.demos.recorded_world import RecordedWorld

_SCALE_M, _SCALE_RAD = 0.05, 0.5  # robosuite's defaults, for recordings that do not say
_COMPARED, _FEWEST_STEPS, _MOVES_M = 5, 8, 0.02
_ALIKE, _SLOPE = 0.9, 1.5


class ActionFrame:
    """Frame and scale of the end-effector deltas of one data set; a context manager.

    robosuite up to 1.4 interprets them in the world frame. From 1.5 on it uses the frame of the arm's base, which on
    some arms turns with the first joint, unless ``input_ref_frame`` is ``world``. The base's rotation is then read from
    a simulation that is set to the recorded states.

    Attributes:
        scale: of the actions.
        name: ``"world"`` or ``"base"``.

    Raises:
        MismatchError: the actions are not OSC_POSE deltas of one arm, or are other than env_args say.
    """

    def __init__(self, demos: Demonstrations) -> None:
        self._demos = demos
        controller = _osc_pose(demos)
        check_deltas(demos)
        self.scale = _scale(demos, controller)
        modern = "input_type" in controller or "input_ref_frame" in controller or is_from_1_5(demos.env_version)
        name = str(controller.get("input_ref_frame", "base")) if modern else "world"
        if name not in ("world", "base"):
            raise MismatchError(f"{demos.path}: actions in the frame {name!r}, expected world or base; record it again")
        self.name: FrameName = name
        self._world: RecordedWorld | None = None

    def rotations_world(self, demo: Demonstration, rows: np.ndarray) -> np.ndarray:
        """(n, 3, 3) rotations, frame of the actions -> world, at the given steps.

        Raises:
            DatasetError: the frame is the base's, but the states are missing or another model's.
            MismatchError: the frame is the base's, but another arm, gripper or scene was recorded.
        """
        if self.name == "world" or not len(rows):
            return np.tile(np.eye(3), (len(rows), 1, 1))
        if self._world is None:
            from ocplanner.demos.recorded_world import RecordedWorld

            env = make_env(self._demos.task(), self._demos.robots[0], cameras=())
            self._world = RecordedWorld(env, self._demos.grippers)
        world, found = self._world, []
        states = world.open(demo)
        for row in rows:
            world.show(demo, states[row])
            found.append(world.env.base_rotation)
        return np.stack(found)

    def close(self) -> None:
        """Free the simulation."""
        if self._world is not None:
            self._world.env.close()
            self._world = None

    def __enter__(self) -> "ActionFrame":
        """The simulation starts when it is first needed."""
        return self

    def __exit__(self, *_: object) -> None:
        """Free the simulation."""
        self.close()


def check_deltas(demos: Demonstrations) -> None:
    """Check that actions which env_args call deltas of OSC_POSE do not follow the hand's position.

    Raises:
        MismatchError: they do: they are absolute.
    """
    looked_at = demos[:_COMPARED]
    try:
        _osc_pose(demos)
        absolute = [are_absolute(demo.recorded_actions, demo.eef_positions) for demo in looked_at]
    except (DatasetError, MismatchError):  # nothing says that they are deltas, or there is nothing to compare them with
        return
    if sum(absolute) > len(looked_at) / 2:
        raise MismatchError(
            f"{demos.path}: env_args say that the actions are deltas, but they follow the hand's position "
            f"(obs/robot0_eef_pos) in {sum(absolute)} of {len(looked_at)} demonstrations, as absolute actions do; set "
            "control_delta to false in the controller of env_args, or give the data set with delta actions"
        )


def are_absolute(actions: np.ndarray, positions: np.ndarray) -> bool:
    """Whether actions are places that the hand goes to, rather than how far it goes.

    Places go up and down with the hand's own, metre by metre, along each axis in which it moves. Deltas are at their
    largest on the way, not at its end, and are not in metres.

    Args:
        actions: (T, 3 or more), position first.
        positions: (T, 3) of the hand before each action, metres.
    """
    if len(actions) < _FEWEST_STEPS:
        return False
    asked, reached = actions[:-1, :3], positions[1:]
    moving = np.flatnonzero(np.ptp(reached, axis=0) > _MOVES_M)
    if not len(moving) or np.any(np.ptp(asked[:, moving], axis=0) == 0):
        return False
    for axis in moving:
        slope = np.polyfit(reached[:, axis], asked[:, axis], 1)[0]
        alike = np.corrcoef(reached[:, axis], asked[:, axis])[0, 1]
        if alike < _ALIKE or not 1 / _SLOPE < slope < _SLOPE:
            return False
    return True


def _osc_pose(demos: Demonstrations) -> Mapping[str, Any]:
    found = list(controllers(demos.env_kwargs.get("controller_configs")))
    arms = [controller for controller in found if controller["type"] == "OSC_POSE"]
    if len(demos.robots) != 1 or len(arms) != 1:
        types = ", ".join(sorted({str(controller["type"]) for controller in found})) or "nothing"
        raise MismatchError(
            f"{demos.path}: controllers {types} of {', '.join(demos.robots) or 'no robot'} in env_args, but hints "
            "and evaluation need one arm under OSC_POSE; record with that controller, or label rewards only "
            "(--no-hints)"
        )
    if is_absolute(arms[0]):
        raise MismatchError(
            f"{demos.path}: absolute actions, but hints and evaluation need deltas; use the data set with delta "
            "actions, or label rewards only (--no-hints)"
        )
    return arms[0]


def _scale(demos: Demonstrations, controller: Mapping[str, Any]) -> ActionScale:
    default = [_SCALE_M] * 3 + [_SCALE_RAD] * 3
    try:
        most = np.broadcast_to(np.asarray(controller.get("output_max", default), dtype=np.float64), 6)
        least = np.broadcast_to(np.asarray(controller.get("output_min", -most), dtype=np.float64), 6)
        range_in = (float(controller.get("input_min", -1)), float(controller.get("input_max", 1)))
    except (TypeError, ValueError) as error:
        raise MismatchError(
            f"{demos.path}: the controller's scale in env_args cannot be read: {error}; correct env_args"
        ) from error
    uniform = np.all(most[:3] == most[0]) and np.all(most[3:] == most[3]) and np.array_equal(least, -most)
    if not uniform or np.any(most <= 0) or range_in != (-1.0, 1.0):
        raise MismatchError(
            f"{demos.path}: actions in {range_in} become {least.tolist()} to {most.tolist()}, but hints and evaluation "
            "need actions in [-1, 1] and one symmetric scale each for position and rotation; label rewards only "
            "(--no-hints)"
        )
    return ActionScale(float(most[0]), float(most[3]))

"""The arrays that labelling adds to one demonstration: hints and plans to read, rewards to learn from."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ocplanner.control.grasp_detection import held_steps
from ocplanner.demos.action_frame import ActionFrame
from ocplanner.demos.control_frequency import control_frequency
from ocplanner.demos.dataset import Demonstrations
from ocplanner.demos.demonstration import Demonstration
from ocplanner.demos.recorded_task import carriers
from ocplanner.demos.soundness import HARDLY_HELD
from ocplanner.envs import CONTROL_HZ
from ocplanner.errors import DatasetError, MismatchError
from ocplanner.files.records.labels import LabelledBy, LabelRecord
from ocplanner.guidance.hints import HINT_WIDTH, action_law, check_horizon_steps, plan_hints, plan_rows
from ocplanner.guidance.rewards import plan_reward
from ocplanner.guidance.settings import LabelSettings
from ocplanner.planner.compatibility import check_fit
from ocplanner.planner.planner import Plan, Planner
from ocplanner.settings import to_dict
from ocplanner.versions import installed

_NOT_OBSERVED = ("_empty", "_mask", "_silhouettes")  # a camera's arrays for augmentation, which no policy sees


def _check_frequency(demos: Demonstrations) -> None:
    found = control_frequency(demos, demos.names[0])
    if found != CONTROL_HZ:
        raise MismatchError(
            f"{demos.path} was recorded at {found:g} Hz, but how far an action moves the hand, which hints need, was "
            f"measured at {CONTROL_HZ:g} Hz; label rewards only (--no-hints)"
        )


class Labeller:
    """Labels demonstrations of one data set; a context manager.

    Args:
        planner: the planner.
        demos: the data set.
        settings: what is written.
        pictures: the same demonstrations with the planner's images; the data set itself if not given.

    Raises:
        DatasetError: the planner's images are missing, or the data set is labelled already.
        InvalidValueError: a horizon step is beyond the plan.
        MismatchError: planner and data set do not fit together, or the actions are no end-effector deltas.
    """

    def __init__(
        self,
        planner: Planner,
        demos: Demonstrations,
        settings: LabelSettings,
        pictures: Demonstrations | None = None,
    ) -> None:
        if demos.label_record is not None:
            raise DatasetError(f"{demos.path} is labelled already; label the data set that it was made from")
        self._demos, self._pictures = demos, demos if pictures is None else pictures
        check_fit(planner, self._pictures)
        header = planner.header
        check_horizon_steps(settings.horizon_steps, header.horizon, settings.hint_from)
        self._planner, self._settings, self._object = planner, settings, header.object
        self._arms = carriers(demos.env_name, header.object)
        self._steps = header.horizon if settings.hints else 1
        if settings.hints:
            _check_frequency(demos)
        self._frame = ActionFrame(demos) if settings.hints else None

    def record(self) -> LabelRecord:
        """What is stored with the data set."""
        about = self._planner.header
        settings = {name: value for name, value in to_dict(self._settings).items() if name != "threads"}
        record = LabelRecord(
            planner_sha256=self._planner.sha256,
            settings=settings,
            planner=LabelledBy(about.task, about.object, about.outputs, about.horizon, about.observe, about.cameras),
            versions=installed(),
        )
        if self._frame is None:
            return record
        steps = [f"k={k}: {part}" for k in self._settings.horizon_steps for part in ("x y z", "rx ry rz")]
        return replace(
            record,
            action_frame=self._frame.name,
            action_scale=self._frame.scale,
            ocp_hint=(*steps, "held"),
            ocp_plan=("x y z",) if about.outputs == "position" else ("x y z", "rot6d"),
        )

    def label(self, demo: Demonstration) -> dict[str, np.ndarray]:
        """The arrays to add to a demonstration of T steps, or to replace its own with, by path.

        Raises:
            DatasetError: an array is missing, or an image in which the object is held was not rendered.
            MismatchError: the pictures are of another demonstration.
        """
        poses = demo.object_poses(self._object)
        held = self._held(demo, poses)
        plan = self._plan(self._drawn(demo), np.flatnonzero(held))
        arrays: dict[str, np.ndarray] = {}
        if self._frame is not None:
            arrays |= self._hints(self._frame, demo, poses, held, plan)
        if self._settings.reward != "off":
            arrays |= self._rewards(demo, poses, held, plan)
        return arrays | self._next_observations(demo, arrays)

    def digest(self, demo: Demonstration) -> str:
        """What a demonstration's labels are made from: its digest, and that of its pictures if they are elsewhere."""
        return demo.digest() if self._pictures is self._demos else f"{demo.digest()}+{self._drawn(demo).digest()}"

    def needed(self, demo: Demonstration) -> None:
        """Read what the labels of a demonstration need, without its pictures.

        Raises:
            DatasetError: something is missing or damaged.
        """
        self._held(demo, demo.object_poses(self._object))
        self._drawn(demo)
        if self._frame is not None:
            self._frame.rotations_world(demo, np.array([0]))
        if self._settings.reward != "off":
            _ = demo.rewards, demo.dones

    def check_held(self, demos: Sequence[Demonstration], say: Callable[[str], None] | None = None) -> None:
        """Check that the robot holds the object now and then: labels are zero wherever it does not.

        Raises:
            DatasetError: it hardly ever does, though the object is carried or the gripper closes.
        """
        held = sum(int(self._held(demo, demo.object_poses(self._object)).sum()) for demo in demos)
        steps = sum(demo.length for demo in demos)
        if held < HARDLY_HELD * steps:
            raise DatasetError(
                f"{self._pictures.path}: {self._object} is held in {held} of {steps} steps, so that labels would be "
                "zero nearly everywhere: positive gripper actions must close the gripper (turn them round with "
                "`ocplanner convert --flip-gripper`), and obs/robot0_eef_pos must be the hand that carries the object"
            )
        if say is not None:
            say(f"{self._object} is held in {held} of {steps} steps ({held / steps:.0%})")

    def close(self) -> None:
        """Free the simulation that tells the base's frame."""
        if self._frame is not None:
            self._frame.close()

    def __enter__(self) -> "Labeller":
        """Nothing to do."""
        return self

    def __exit__(self, *_: object) -> None:
        """Free the simulation."""
        self.close()

    def _held(self, demo: Demonstration, poses: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
        """(T,) bool: one of the arms that carry the object holds it, by its own hand and gripper."""
        arms = [held_steps(*poses, demo.hand_positions(arm), demo.gripper_actions((arm,))[:, 0]) for arm in self._arms]
        return np.any(arms, axis=0)

    def _drawn(self, demo: Demonstration) -> Demonstration:
        """The same demonstration in the file with the planner's images."""
        drawn = self._pictures[demo.name]
        if drawn.length != demo.length or not np.array_equal(drawn.actions, demo.actions):
            raise MismatchError(
                f"{drawn!r} is another recording than {demo!r}: the actions differ; draw the images from the same data "
                "set with `ocplanner render`"
            )
        return drawn

    def _plan(self, demo: Demonstration, rows: np.ndarray) -> Plan:
        """Plans at the given steps, a batch of images at a time."""
        size, plans = self._settings.batch, []
        for start in range(0, max(len(rows), 1), size):  # an empty batch still gives arrays of the right shape
            images = self._images(demo, rows[start : start + size])
            plans.append(self._planner.plan(images, self._settings.threads, self._steps))
        position, rotation, probability = zip(*plans)
        turned = None if rotation[0] is None else np.concatenate(rotation)
        return Plan(np.concatenate(position), turned, np.concatenate(probability))

    def _images(self, demo: Demonstration, rows: np.ndarray) -> Mapping[str, np.ndarray]:
        images = {camera: demo.images(camera, rows) for camera in self._planner.header.cameras}
        for camera, pictures in images.items():
            black = rows[~pictures.any(axis=(1, 2, 3))]
            if len(black):
                raise DatasetError(
                    f"{demo!r}: the image of {camera} at step {black[0]}, where the object is held, is black: it was "
                    "not drawn; render the data set again with `ocplanner render --frames all`"
                )
        return images

    def _hints(
        self,
        frame: ActionFrame,
        demo: Demonstration,
        poses: tuple[np.ndarray, np.ndarray],
        held: np.ndarray,
        plan: Plan,
    ) -> dict[str, np.ndarray]:
        rows, steps = np.flatnonzero(held), self._settings.horizon_steps
        hint = np.zeros((len(held), HINT_WIDTH * len(steps) + 1), np.float32)
        bases = frame.rotations_world(demo, rows)
        here = (poses[0][rows], poses[1][rows])
        hint[rows, :-1] = plan_hints(
            plan,
            here,
            demo.eef_positions[rows],
            bases,
            steps,
            action_law(frame.scale),
            self._settings.hint_from,
        )
        hint[:, -1] = held
        planned = plan_rows(plan)
        whole = np.zeros((len(held), *planned.shape[1:]), np.float32)
        whole[rows] = planned
        return {"obs/ocp_hint": hint, "obs/ocp_plan": whole}

    def _rewards(
        self, demo: Demonstration, poses: tuple[np.ndarray, np.ndarray], held: np.ndarray, plan: Plan
    ) -> dict[str, np.ndarray]:
        rows = np.flatnonzero(held)
        # Where nothing is held the terms are zero whatever the plan, so the pose itself stands in for it.
        achieved = tuple(np.concatenate([pose[1:], pose[-1:]]) for pose in poses)
        position, rotation = achieved[0].copy(), achieved[1].copy()
        position[rows] = plan.position[:, 0]
        if plan.rotation is not None:
            rotation[rows] = plan.rotation[:, 0]
        planned = (position, None if plan.rotation is None else rotation)
        sparse = demo.rewards
        terms = plan_reward(
            planned, (achieved[0], achieved[1]), held, self._settings.reward_config, terminal=bool(demo.dones[-1])
        )
        reward = terms.reward + sparse if self._settings.reward == "augment" else terms.reward
        return {"rewards": reward, "rewards_sparse": sparse, **terms.terms}

    def _next_observations(self, demo: Demonstration, arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """``next_obs`` of what was added and, where rewards are written, of every observation that lacks it."""
        there = demo.next_observation_keys
        added = [path.removeprefix("obs/") for path in arrays if path.startswith("obs/")]
        wanted = added if there else []
        if self._settings.reward != "off":
            own = [key for key in demo.observation_keys if not key.endswith(_NOT_OBSERVED) and key not in there]
            wanted = [*own, *added]
        found = {}
        for key in wanted:
            values = arrays[f"obs/{key}"] if key in added else demo.observation(key)
            found[f"next_obs/{key}"] = np.concatenate([values[1:], values[-1:]])
        return found

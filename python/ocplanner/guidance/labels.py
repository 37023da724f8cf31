"""The arrays that labelling adds to one demonstration: hints and plans to read, rewards to learn from."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, get_args

import numpy as np

from ocplanner.control.grasp_detection import held_steps
from ocplanner.demos.action_frame import ActionFrame
from ocplanner.demos.dataset import Demonstrations
from ocplanner.demos.demonstration import Demonstration
from ocplanner.errors import DatasetError, InvalidValueError, MismatchError, UnknownNameError
from ocplanner.guidance.hints import (
    HINT_WIDTH,
    ORIGINS,
    Origin,
    action_law,
    check_horizon_steps,
    plan_hints,
    plan_rows,
)
from ocplanner.guidance.rewards import plan_reward
from ocplanner.guidance.settings import RewardConfig, RewardMode
from ocplanner.planner.compatibility import check_fit
from ocplanner.planner.planner import Plan, Planner
from ocplanner.versions import installed

REWARD_MODES: tuple[str, ...] = get_args(RewardMode)

_NOT_OBSERVED = ("_empty", "_mask", "_silhouettes")  # of a camera: for augmentation, no policy sees them


@dataclass(frozen=True)
class LabelSettings:
    """What is written.

    Attributes:
        hints: write ``obs/ocp_hint`` and ``obs/ocp_plan``.
        horizon_steps: the planned steps that hints point to; 1, the paper's, is the next.
        hint_from: where hints start: ``"object"``, its real pose, or ``"plan"``, the plan's first step.
        reward: ``"augment"`` adds the plan's reward to the recorded one, ``"only"`` puts it in its place, ``"off"``
            leaves rewards alone.
        reward_config: weights and form of the plan's reward.
        batch: images planned at a time.

    Raises:
        InvalidValueError: nothing to write, or a number is out of range.
        UnknownNameError: no such mode or origin.
    """

    hints: bool = True
    horizon_steps: tuple[int, ...] = (1,)
    hint_from: Origin = "object"
    reward: RewardMode = "off"
    reward_config: RewardConfig = field(default_factory=RewardConfig)
    batch: int = 64

    def __post_init__(self) -> None:
        if self.reward not in REWARD_MODES:
            raise UnknownNameError("reward mode", self.reward, REWARD_MODES)
        if self.hint_from not in ORIGINS:
            raise UnknownNameError("origin of hints", self.hint_from, ORIGINS)
        if not self.hints and self.reward == "off":
            raise InvalidValueError("neither hints nor rewards: nothing to write; choose --reward augment or only")
        if not self.horizon_steps or len(set(self.horizon_steps)) != len(self.horizon_steps):
            raise InvalidValueError(f"horizon steps {self.horizon_steps}: name each planned step once, 1 for the next")
        if self.batch < 1:
            raise InvalidValueError(f"batch must be at least 1, not {self.batch}")


class Labeller:
    """Labels demonstrations of one data set; a context manager.

    Args:
        planner: the planner.
        demos: the data set.
        settings: what is written.
        threads: threads of the planner.
        pictures: the same demonstrations drawn as the planner was trained; the data set itself if not given.

    Raises:
        DatasetError: the planner's images are not there, or the data set is labelled already.
        InvalidValueError: a horizon step is beyond the plan.
        MismatchError: planner and data set do not fit together, or the actions are no end-effector deltas.
    """

    def __init__(
        self,
        planner: Planner,
        demos: Demonstrations,
        settings: LabelSettings,
        threads: int = 1,
        pictures: Demonstrations | None = None,
    ) -> None:
        if demos.label_settings is not None:
            raise DatasetError(f"{demos.path} is labelled already; label the data set that it was made from")
        self._pictures = demos if pictures is None else pictures
        check_fit(planner, self._pictures)
        horizon = int(planner.config["horizon"])
        check_horizon_steps(settings.horizon_steps, horizon, settings.hint_from)
        self._planner, self._settings, self._threads = planner, settings, threads
        self._object = str(planner.config["object"])
        self._steps = horizon if settings.hints else 1
        self._frame = ActionFrame(demos) if settings.hints else None

    def record(self) -> dict[str, Any]:
        """What is stored with the data set, JSON-ready."""
        config, settings = self._planner.config, asdict(self._settings)
        record: dict[str, Any] = {
            "planner_sha256": self._planner.sha256,
            "planner": {key: config[key] for key in ("task", "object", "outputs", "horizon", "observe", "cameras")},
            "settings": {**settings, "horizon_steps": list(self._settings.horizon_steps)},
            "versions": installed(),
        }
        if self._frame is not None:
            record["action_frame"], record["action_scale"] = self._frame.name, self._frame.scale._asdict()
            record["ocp_hint"] = [
                *(f"k={k}: {part}" for k in self._settings.horizon_steps for part in ("x y z", "rx ry rz")),
                "held",
            ]
            record["ocp_plan"] = ["x y z"] if config["outputs"] == "position" else ["x y z", "rot6d"]
        return record

    def label(self, demo: Demonstration) -> dict[str, np.ndarray]:
        """The arrays to add to a demonstration of T steps, or to put in place of its own, by path.

        Raises:
            DatasetError: an array is missing, or an image in which the object is held was not drawn.
            MismatchError: the pictures are of another demonstration.
        """
        poses, actions = demo.object_poses(self._object), demo.actions
        held = held_steps(*poses, demo.eef_positions, actions[:, -1])
        plan = self._plan(self._drawn(demo, actions), np.flatnonzero(held))
        arrays: dict[str, np.ndarray] = {}
        if self._frame is not None:
            arrays |= self._hints(self._frame, demo, poses, held, plan)
        if self._settings.reward != "off":
            arrays |= self._rewards(demo, poses, held, plan)
        return arrays | self._next_observations(demo, arrays)

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

    def _drawn(self, demo: Demonstration, actions: np.ndarray) -> Demonstration:
        """The same demonstration among the pictures."""
        drawn = self._pictures[demo.name]
        if drawn.length != demo.length or not np.array_equal(drawn.actions, actions):
            raise MismatchError(
                f"{drawn!r} is another recording than {demo!r}: the actions differ; draw the images from the same data "
                "set with `ocplanner render`"
            )
        return drawn

    def _plan(self, demo: Demonstration, rows: np.ndarray) -> Plan:
        """Plans of the given steps, some images at a time."""
        size, plans = self._settings.batch, []
        for start in range(0, max(len(rows), 1), size):  # an empty batch still gives arrays of the right shape
            images = self._images(demo, rows[start : start + size])
            plans.append(self._planner.plan(images, self._threads, self._steps))
        position, rotation, probability = zip(*plans)
        turned = None if rotation[0] is None else np.concatenate(rotation)
        return Plan(np.concatenate(position), turned, np.concatenate(probability))

    def _images(self, demo: Demonstration, rows: np.ndarray) -> Mapping[str, np.ndarray]:
        images = {camera: demo.images(camera, rows) for camera in self._planner.config["cameras"]}
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
            plan, here, demo.eef_positions[rows], bases, steps, action_law(*frame.scale), self._settings.hint_from
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
        # Where nothing is held, the terms are zero whatever was planned: there the plan may be the pose itself.
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
        arrays = {
            "rewards": terms.reward + sparse if self._settings.reward == "augment" else terms.reward,
            "rewards_sparse": sparse,
            "ocp_reward_position": terms.position,
        }
        return arrays if terms.rotation is None else {**arrays, "ocp_reward_rotation": terms.rotation}

    def _next_observations(self, demo: Demonstration, arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """``next_obs`` of what was added and, for learning from rewards, of every observation that lacks one."""
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

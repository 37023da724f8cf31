"""Demonstrations in memory, and the batches that policies learn from."""

import zlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from ocplanner.demos.dataset import Demonstrations
from ocplanner.demos.demonstration import Demonstration
from ocplanner.errors import DatasetError, MismatchError
from ocplanner.guidance.hints import HINT_WIDTH
from ocplanner.guidance.settings import LabelSettings
from ocplanner.policies.action_range import ActionRange, range_of, scaled
from ocplanner.policies.algorithms import find_algorithm
from ocplanner.policies.config import HINT_KEY, PolicyTraining
from ocplanner.policies.observation import Observation, cropped, low_dim_row
from ocplanner.policies.transitions import TransitionBatch, Transitions


@dataclass(frozen=True)
class Samples:
    """N recorded steps, the demonstrations one after the other.

    Attributes:
        names: the demonstrations.
        demonstration: (N,) index into ``names``.
        last: (N,) row of the last step of each row's demonstration.
        low_dim: (N, D) float32.
        images: camera -> (N, h, w, 3) uint8.
        hint: (N, 6 K + 1) float32, or None.
        actions: (N, A) float32.
        transitions: what follows each step, for algorithms that learn from rewards, else None.
    """

    names: tuple[str, ...]
    demonstration: np.ndarray
    last: np.ndarray
    low_dim: Tensor
    images: dict[str, np.ndarray]
    hint: Tensor | None
    actions: Tensor
    transitions: Transitions | None = None

    def __len__(self) -> int:
        """Number of steps."""
        return len(self.actions)

    def batch(
        self, rows: np.ndarray, config: PolicyTraining, device: torch.device, rng: np.random.Generator | None
    ) -> tuple[Observation, Tensor]:
        """Observations and actions: (B, ...) for BC, (T, B, ...) for BC-RNN.

        A sequence begins at its row; one that runs over its demonstration's end repeats the last step, as robomimic
        pads.

        Args:
            rows: (B,) row numbers.
            config: algorithm, sequence length and crop.
            device: where the tensors go.
            rng: places the crops; None: central.
        """
        if config.sequence is not None:
            steps = np.arange(config.sequence)[:, None]
            rows = np.minimum(rows + steps, self.last[rows])
        index = torch.from_numpy(rows)
        images = {
            name: cropped(pictures[rows], config.observation.crop, rng).to(device)
            for name, pictures in self.images.items()
        }
        hint = None if self.hint is None else self.hint[index].to(device)
        return Observation(self.low_dim[index].to(device), images, hint), self.actions[index].to(device)

    @property
    def following(self) -> Transitions:
        """What follows each step.

        Raises:
            DatasetError: it has not been read.
        """
        if self.transitions is None:
            raise DatasetError("these samples were read without what follows them")
        return self.transitions

    def transition_batch(
        self, rows: np.ndarray, config: PolicyTraining, device: torch.device, rng: np.random.Generator | None
    ) -> TransitionBatch:
        """The steps and what follows them; arguments as for :meth:`batch`.

        Raises:
            DatasetError: the transitions have not been read.
        """
        after = self.following
        observation, actions = self.batch(rows, config, device, rng)
        index = torch.from_numpy(rows)
        images = {name: cropped(self._after(name, rows, after), config.observation.crop, None) for name in self.images}
        following = Observation(
            after.next_low_dim[index].to(device), {name: image.to(device) for name, image in images.items()}, None
        )
        return TransitionBatch(
            observation, actions, after.rewards[index].to(device), after.dones[index].to(device), following
        )

    def _after(self, camera: str, rows: np.ndarray, after: Transitions) -> np.ndarray:
        """(B, h, w, 3) pictures after the steps."""
        pictures = self.images[camera][np.minimum(rows + 1, self.last[rows])]
        ends = rows == self.last[rows]
        pictures[ends] = after.last_images[camera][self.demonstration[rows[ends]]]
        return pictures

    def named(self, rows: np.ndarray, most: int = 4) -> str:
        """Which steps these are, for people."""
        shown = [f"{self.names[demo]} step {row - self._first(row)}" for row, demo in self._pairs(rows[:most])]
        return ", ".join(shown) + (f" and {len(rows) - most} more" if len(rows) > most else "")

    def _pairs(self, rows: np.ndarray) -> list[tuple[int, int]]:
        return [(int(row), int(self.demonstration[row])) for row in rows]

    def _first(self, row: int) -> int:
        return int(np.searchsorted(self.demonstration, self.demonstration[row]))

    def digest(self) -> str:
        """Changes when a number that is trained on changes."""
        arrays = [self.low_dim.numpy(), self.actions.numpy(), *self.images.values()]
        arrays += [] if self.hint is None else [self.hint.numpy()]
        arrays += [] if self.transitions is None else self.transitions.arrays()
        value = zlib.crc32(" ".join(self.names).encode())
        for array in arrays:
            value = zlib.crc32(np.ascontiguousarray(array).data, value)
        return f"{len(self)} steps, crc32 {value:08x}"


def load_samples(
    demos: Demonstrations, names: Sequence[str], config: PolicyTraining, ranges: ActionRange | None = None
) -> Samples:
    """Read the named demonstrations whole into memory.

    Args:
        demos: the data set.
        names: which demonstrations.
        config: what is observed.
        ranges: of the actions, if they are learned scaled to [-1, 1].

    Raises:
        DatasetError: an observation is missing, not finite or of another size, pictures are black, or actions outside
            [-1, 1] are not scaled.
    """
    if not names:
        raise DatasetError(f"{demos.path}: no demonstration to learn from; name a mask that is not empty")
    _require_every_picture(demos, config.observation.cameras)
    chosen = [demos[name] for name in names]
    lengths = np.array([demo.length for demo in chosen])
    seen = config.observation
    hint = None
    if config.network.hint is not None:
        hint = np.concatenate([_hint(demos, demo, config.network.hint.width) for demo in chosen])
    low_dim = [low_dim_row({key: _numbers(demos, demo, key) for key in seen.low_dim}, seen.low_dim) for demo in chosen]
    return Samples(
        names=tuple(names),
        demonstration=np.repeat(np.arange(len(names)), lengths),
        last=np.repeat(lengths.cumsum() - 1, lengths),
        low_dim=torch.from_numpy(np.concatenate(low_dim)),
        images={
            camera: np.concatenate([_pictures(demos, demo, camera, seen.image_size) for demo in chosen])
            for camera in seen.cameras
        },
        hint=None if hint is None else torch.from_numpy(hint),
        actions=torch.from_numpy(np.concatenate([_actions(demos, demo, ranges) for demo in chosen])),
    )


def check_demonstration(demo: Demonstration, demos: Demonstrations, config: PolicyTraining) -> None:
    """Read what a policy learns from a demonstration, without its pictures.

    Raises:
        DatasetError: a number is missing or not finite.
    """
    _ = demo.actions
    for key in config.observation.low_dim:
        _numbers(demos, demo, key)
    if find_algorithm(config.algorithm).rewards:
        _ = demo.rewards, demo.dones


def _require_every_picture(demos: Demonstrations, cameras: Sequence[str]) -> None:
    rendered = demos.render_record
    if rendered is not None and rendered.frames == "manipulation" and set(cameras) & set(rendered.cameras):
        raise DatasetError(
            f"{demos.path} was rendered with --frames manipulation: its pictures are black before the grasp and after "
            "the release, where a policy acts too; render the data set again with `ocplanner render --frames all`"
        )


def hint_horizons(demos: Demonstrations, horizons: tuple[int, ...], setting: str = "horizons") -> tuple[int, ...]:
    """The horizons of a data set's hints, control steps.

    Args:
        demos: the data set.
        horizons: those that the policy is to read; empty: those that the data set was labelled with.
        setting: where the user gave them.

    Raises:
        MismatchError: the data set was labelled with others, or nobody says with which.
    """
    labels = demos.label_record
    if labels is None and HINT_KEY not in demos[0].observation_keys:
        raise _no_hints(demos, demos.names[0])
    if labels is None and not horizons:
        raise MismatchError(
            f"{demos.path} does not say which horizons its hints have, since `ocplanner label` did not make them; "
            "name them in HintConfig(horizons), or in algo.ocp_hint.horizons of --config"
        )
    labelled = horizons if labels is None else LabelSettings.of(labels).horizon_steps
    if horizons not in ((), labelled):
        raise MismatchError(
            f"{demos.path} is labelled with hints {labelled} steps ahead, the policy reads {horizons}; "
            f"give {setting} {' '.join(map(str, labelled))}, or label the data set again"
        )
    return labelled


def _numbers(demos: Demonstrations, demo: Demonstration, key: str) -> np.ndarray:
    array = demo.observation(key).astype(np.float32)
    if array.ndim != 2:
        raise DatasetError(
            f"{demos.path}: {demo.name}/obs/{key}: shape {array.shape}, expected (steps, numbers); leave it out of the "
            f"low-dimensional observations ({HINT_KEY} has {HINT_WIDTH} numbers for each horizon step of a plan)"
        )
    if not np.isfinite(array).all():
        step = int(np.argwhere(~np.isfinite(array))[0, 0])
        raise DatasetError(
            f"{demos.path}: {demo.name}/obs/{key}: not finite at step {step}; "
            "leave the demonstration out (--skip-bad) or record it again"
        )
    return array


def _no_hints(demos: Demonstrations, name: str) -> DatasetError:
    return DatasetError(
        f"{demos.path}: {name}/obs/{HINT_KEY}: no hints in this data set; make a copy that has them with "
        "`ocplanner label`"
    )


def _hint(demos: Demonstrations, demo: Demonstration, width: int) -> np.ndarray:
    if HINT_KEY not in demo.observation_keys:
        raise _no_hints(demos, demo.name)
    hint = _numbers(demos, demo, HINT_KEY)
    if hint.shape[1] != width:
        raise DatasetError(
            f"{demos.path}: {demo.name}/obs/{HINT_KEY}: {hint.shape[1]} numbers a step, expected {width} "
            "(six for each horizon and a flag); name the horizons that the data set was labelled with"
        )
    return hint


def _pictures(demos: Demonstrations, demo: Demonstration, camera: str, size: int) -> np.ndarray:
    images = demo.images(camera)
    if images.shape[1:3] != (size, size):
        raise DatasetError(
            f"{demos.path}: {demo.name}/obs/{camera}_image: pictures of {images.shape[1]}x{images.shape[2]}, expected "
            f"{size}x{size}; render the data set at that size with `ocplanner render`"
        )
    black = np.flatnonzero(~images.any(axis=(1, 2, 3)))
    if len(black):
        raise DatasetError(
            f"{demos.path}: {demo.name}/obs/{camera}_image: {len(black)} of {len(images)} pictures are black, from "
            f"step {black[0]} on: they were not drawn; render the data set again with `ocplanner render --frames all`"
        )
    return images


def _actions(demos: Demonstrations, demo: Demonstration, ranges: ActionRange | None) -> np.ndarray:
    actions = demo.actions
    if ranges is None and range_of([actions]) is not None:
        largest = float(np.abs(actions).max())
        raise DatasetError(
            f"{demos.path}: {demo.name}/actions: {largest:.4g} lies outside [-1, 1], unlike those of the other "
            "demonstrations; leave it out of the mask, or record it again"
        )
    return scaled(actions, ranges)

"""Training frames in memory: images, masks and future object poses of every kept step of a rendered data set."""

import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from ocplanner.demos.control_frequency import control_frequency
from ocplanner.demos.dataset import Demonstrations
from ocplanner.demos.demonstration import Demonstration
from ocplanner.demos.layouts import TASK_OBJECTS
from ocplanner.demos.recorded_task import recorded_task
from ocplanner.demos.soundness import sound_names
from ocplanner.envs.tasks import tasks
from ocplanner.errors import DatasetError, MismatchError, UnknownNameError
from ocplanner.files.records.render import RenderRecord
from ocplanner.planner.config import PlannerTraining
from ocplanner.settings import require

VALID_SHARE = 0.1
"""Share of demonstrations held out when the data set has no mask/train and mask/valid."""


@dataclass(frozen=True)
class CameraFrames:
    """One camera's images of N frames.

    Attributes:
        scene: (N, h, w, 3) uint8; with a mask the scene without the robot, else the image as it is.
        mask: (N, h, w) bool, the source robot's pixels; None unless the robot is to be painted over.
        silhouettes: (N, K, h, w) bool, other arms' pixels with their end effector where the source's is, all False
            where out of reach; or None.
    """

    scene: np.ndarray
    mask: np.ndarray | None = None
    silhouettes: np.ndarray | None = None

    def take(self, rows: np.ndarray) -> "CameraFrames":
        """Only the given frames."""
        return CameraFrames(*(None if array is None else array[rows] for array in self))  # type: ignore[arg-type]

    def __iter__(self) -> Iterator[np.ndarray | None]:
        """The three arrays."""
        return iter((self.scene, self.mask, self.silhouettes))


@dataclass(frozen=True)
class Frames:
    """N kept frames.

    Attributes:
        cameras: images by camera name.
        positions: (N, H, 3) float32 world positions of the object at t+1 ... t+H, metres.
        rotations: (N, H, 3, 3) float32, object -> world.
        demonstration: (N,) int32, which demonstration a frame comes from.
        remaining: (N,) int32, steps until its kept segment ends; 1 for the last frame.
        names: the demonstrations' names, indexed by ``demonstration``.
    """

    cameras: dict[str, CameraFrames]
    positions: np.ndarray
    rotations: np.ndarray
    demonstration: np.ndarray
    remaining: np.ndarray
    names: tuple[str, ...] = field(default=())

    def __len__(self) -> int:
        """Number of frames."""
        return len(self.positions)

    def take(self, rows: np.ndarray) -> "Frames":
        """Only the given frames."""
        cameras = {name: frames.take(rows) for name, frames in self.cameras.items()}
        parts = (self.positions, self.rotations, self.demonstration, self.remaining)
        return Frames(cameras, *(part[rows] for part in parts), names=self.names)

    def replace_masks(self, arm: int) -> "Frames":
        """The frames as they would look with another arm: silhouette ``arm`` instead of the source robot's mask.

        Frames that the arm cannot reach are left out.
        """
        reached = np.ones(len(self), bool)
        cameras = {}
        for name, frames in self.cameras.items():
            if frames.silhouettes is None or arm >= frames.silhouettes.shape[1]:
                raise DatasetError(
                    f"camera {name!r} has no silhouette {arm}; render with --observe masked and more --silhouettes"
                )
            cameras[name] = replace(frames, mask=frames.silhouettes[:, arm])
            reached &= frames.silhouettes[:, arm].any(axis=(1, 2))
        return replace(self, cameras=cameras).take(np.flatnonzero(reached))

    def digest(self) -> str:
        """A checksum of everything that training reads."""
        value = 0
        arrays = [self.positions, self.rotations, self.demonstration]
        for name in sorted(self.cameras):
            arrays += [array for array in self.cameras[name] if array is not None]
        for array in arrays:
            value = zlib.crc32(np.ascontiguousarray(array).tobytes(), value)
        return f"{value:08x}"


class Future(NamedTuple):
    """Poses after each of n frames: positions (n, H, 3) in metres, rotations (n, H, 3, 3)."""

    positions: np.ndarray
    rotations: np.ndarray


def future(positions: np.ndarray, rotations: np.ndarray, rows: np.ndarray, horizon: int) -> Future:
    """Poses of the next H kept steps of each kept step, padded with the last one's pose.

    Args:
        positions: (T, 3) of a whole demonstration, metres.
        rotations: (T, 3, 3).
        rows: (n,) the kept steps, ascending.
        horizon: H.
    """
    following = np.arange(len(rows))[:, None] + np.arange(1, horizon + 1)[None, :]
    steps = rows[np.minimum(following, len(rows) - 1)]
    return Future(positions[steps].astype(np.float32), rotations[steps].astype(np.float32))


class DataSettings(NamedTuple):
    """What a planner takes over from its data set."""

    task: str
    object_name: str
    source_robot: str
    visual: str | None
    mask_rgb: tuple[int, int, int] | None
    silhouettes: tuple[str, ...]
    control_freq: float = 20.0


def data_settings(demos: Demonstrations, config: PlannerTraining) -> DataSettings:
    """Check that a data set fits a configuration, and read what the planner file takes over from it.

    Raises:
        DatasetError: its task is unknown, it has no images, or lacks a camera that the configuration names.
        MismatchError: it was rendered in another observe mode or size.
        UnknownNameError: the task has no object of the configuration's name.
    """
    longest, horizon = _longest(demos), config.network.horizon
    require(
        longest == 0 or horizon <= longest,
        f"horizon is {horizon}, but the longest demonstration of {demos.path} has {longest} steps: plan no more",
    )
    render = demos.render_record or RenderRecord()
    observe = config.observe
    wanted = config.network.image_size
    remedy = (
        f"`ocplanner render SOURCE TARGET --observe {observe} --cameras {' '.join(config.cameras)} --size {wanted}`"
    )
    task = recorded_task(demos.env_name)
    demos.require_task_named()
    if task is None:
        known = ", ".join(sorted({*TASK_OBJECTS, *(task.env_name for task in tasks().values())}))
        raise DatasetError(f"{demos.path}: environment {demos.env_name!r} is none of {known}")
    if config.object is not None and config.object not in task.parts:
        raise UnknownNameError(f"object of {task.name}", config.object, task.parts)
    if not demos.cameras:
        raise DatasetError(f"{demos.path}: no images in it; add them with {remedy}")
    missing = [camera for camera in config.cameras if camera not in demos.cameras]
    if missing:
        raise DatasetError(
            f"{demos.path}: no images of camera {', '.join(missing)} (there are: {', '.join(demos.cameras)}); "
            f"add them with {remedy}, or choose with --cameras"
        )
    if render.observe != observe:
        raise MismatchError(
            f"{demos.path} shows observe={render.observe}, the training needs observe={observe}; "
            f"render again with {remedy}, or train with --observe {render.observe}"
        )
    size = demos[0].images(config.cameras[0], slice(0, 1)).shape[1:3]
    if size != (wanted, wanted):
        raise MismatchError(
            f"{demos.path}: images are {size[1]}x{size[0]}, the planner reads {wanted}x{wanted}; use {remedy}, or "
            f"train with --image-size {size[0]} --crop {max(1, size[0] - 8)}"
        )
    if observe == "masked" and render.mask_rgb is None:
        raise DatasetError(f"{demos.path}: the data set does not say its mask colour; render again with {remedy}")
    return DataSettings(
        task=task.name,
        object_name=config.object or task.parts[0],
        source_robot="+".join(demos.robots),
        visual=render.visual,
        mask_rgb=render.mask_rgb if observe == "masked" else None,
        silhouettes=render.silhouettes,
        control_freq=control_frequency(demos, demos.names[0]),
    )


def _longest(demos: Demonstrations) -> int:
    """Steps of the longest demonstration that can be read; 0 if none can."""
    longest = 0
    for demo in demos:
        with suppress(DatasetError):  # it will be left out or refused by name
            longest = max(longest, demo.length)
    return longest


class Split(NamedTuple):
    """Names of the training and of the held-out demonstrations, and where the split comes from."""

    train: list[str]
    valid: list[str]
    source: str


def split(demos: Demonstrations, seed: int) -> Split:
    """``mask/train`` and ``mask/valid``, or a seeded split when the data set has no such masks.

    A single demonstration is both: nothing is held out.

    Raises:
        DatasetError: the masks overlap or are empty.
    """
    if {"train", "valid"} <= set(demos.mask_names):
        train, valid = demos.mask("train"), demos.mask("valid")
        both = sorted(set(train) & set(valid))
        if both or not train or not valid:
            fault = f"share {', '.join(both[:3])}" if both else "must both name demonstrations"
            raise DatasetError(f"{demos.path}: mask/train and mask/valid {fault}; mend the masks")
        return Split(train, valid, "mask/train and mask/valid")
    if len(demos) == 1:
        only = list(demos.names)
        return Split(only, only, "the same one: a single demonstration leaves none to hold out")
    order = np.random.default_rng([seed, len(demos)]).permutation(len(demos))
    held = max(1, round(VALID_SHARE * len(demos)))
    names = [demos.names[i] for i in order]
    return Split(
        sorted(names[held:]), sorted(names[:held]), f"at random with seed {seed}: no mask/train and mask/valid"
    )


def load_frames(
    demos: Demonstrations,
    names: Sequence[str],
    config: PlannerTraining,
    object_name: str,
    say: Callable[[str], None] = lambda _: None,
) -> Frames:
    """Read the kept frames of the named demonstrations, images as uint8 in memory.

    Args:
        demos: the data set.
        names: which demonstrations.
        config: cameras, observation and horizon.
        object_name: the object, or an arm's part in carrying it, whose future is planned.
        say: called with a line for each demonstration that is left out.

    Raises:
        DatasetError: an array is missing, frames were not rendered, the object is never manipulated in some
            demonstrations, or none is left.
    """
    kept = []
    for name in sound_names(demos, names, lambda demo: demo.manipulation(object_name), say):
        positions, rotations = demos[name].object_poses(object_name)
        rows = np.array(demos[name].manipulation(object_name).rows)
        poses = future(positions, rotations, rows, config.network.horizon)
        kept.append((name, poses, _pictures(demos[name], rows, config)))
    cameras = {}
    for camera in config.cameras:
        scene, mask, silhouettes = (_join(arrays) for arrays in zip(*(pictures[camera] for _, _, pictures in kept)))
        if scene is not None:
            cameras[camera] = CameraFrames(scene, mask, silhouettes)
    counts = [len(poses.positions) for _, poses, _ in kept]
    return Frames(
        cameras=cameras,
        positions=np.concatenate([poses.positions for _, poses, _ in kept]),
        rotations=np.concatenate([poses.rotations for _, poses, _ in kept]),
        demonstration=np.repeat(np.arange(len(kept), dtype=np.int32), counts),
        remaining=np.concatenate([np.arange(count, 0, -1, dtype=np.int32) for count in counts]),
        names=tuple(name for name, _, _ in kept),
    )


def _pictures(demo: Demonstration, kept: np.ndarray, config: PlannerTraining) -> dict[str, CameraFrames]:
    pictures = {camera: _camera_pictures(demo, camera, kept, config.observe) for camera in config.cameras}
    for camera, frames in pictures.items():
        black = int((~frames.scene.any(axis=(1, 2, 3))).sum())
        if black:
            raise DatasetError(
                f"{demo.name}: {black} of the kept frames of camera {camera!r} are black: they were not rendered; "
                "render again with `ocplanner render --frames manipulation` or `--frames all`"
            )
    return pictures


def _camera_pictures(demo: Demonstration, camera: str, kept: np.ndarray, observe: str) -> CameraFrames:
    if observe != "masked":
        return CameraFrames(demo.images(camera, kept))
    keys = demo.observation_keys
    silhouettes = f"{camera}_silhouettes"
    return CameraFrames(
        scene=demo.observation(f"{camera}_empty", kept),
        mask=demo.observation(f"{camera}_mask", kept).astype(bool),
        silhouettes=demo.observation(silhouettes, kept).astype(bool) if silhouettes in keys else None,
    )


def _join(arrays: Sequence[np.ndarray | None]) -> np.ndarray | None:
    present = [array for array in arrays if array is not None]
    return np.concatenate(present) if len(present) == len(arrays) and present else None

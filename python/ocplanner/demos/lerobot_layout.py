"""Which array of a demonstration is which feature of a LeRobot data set.

What goes where (HDF5 path, LeRobot feature):

- ``actions``: ``action``, float32.
- ``obs/<key>``, low-dimensional: ``observation.state``, float32; its ``names`` are ``<key>.0``, ``<key>.1``, ... What
  says where objects are goes to ``observation.environment_state``, so that a policy sees it only if it is meant to.
- ``obs/<camera>_image``: ``observation.images.<camera>``, video or, lossless, png.
- ``rewards``, ``dones``: ``next.reward``, float32; ``next.done``.
- Anything else of at most three dimensions that is no picture, such as ``states``: ``hdf5.<path>`` in its own type.
  Policies of LeRobot read features named ``observation`` and ``action``, so they do not see these.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from ocplanner.demos.demonstration import Demonstration
from ocplanner.errors import DatasetError, MismatchError

Pictures = Literal["video", "png"]

NEXT = "next_obs/"
"""Observations after the action, which have no feature: they can be made again."""

_STATE, _ENVIRONMENT, _IMAGES = "observation.state", "observation.environment_state", "observation.images."
REWARD, _ACTION, _DONE = "next.reward", "action", "next.done"
_EXTRA = "hdf5."
_FRAME_NAMES = ["height", "width", "channels"]
_COLOURS, _MOST_DIMS = 3, 3
_PICTURES = ("_image", "_depth", "_empty", "_mask", "_silhouettes")


@dataclass(frozen=True)
class LeRobotLayout:
    """Where the arrays of a source go.

    Attributes:
        features: LeRobot's description of them.
        paths: path of each array that has a place -> its feature.
        vectors: feature of a vector -> the arrays that it is put together from, each with its width.
        flat: paths of arrays of one dimension.
    """

    features: Mapping[str, dict[str, Any]]
    paths: Mapping[str, str]
    vectors: Mapping[str, Sequence[tuple[str, int]]]
    flat: Sequence[str]

    @classmethod
    def of(cls, demo: Demonstration, arrays: Mapping[str, np.ndarray], images: Pictures) -> "LeRobotLayout":
        """The layout of a data set whose first demonstration has these arrays.

        Raises:
            MismatchError: a picture's size does not fit a video.
        """
        features: dict[str, dict[str, Any]] = {}
        paths: dict[str, str] = {}
        vectors: dict[str, list[tuple[str, int]]] = {}
        for path in sorted(arrays):
            array, key = arrays[path], path.removeprefix("obs/")
            if path.startswith(NEXT):  # --next-obs makes them again on the way back
                continue
            if path == "actions":
                paths[path] = _ACTION
                features[_ACTION] = _feature(array, "float32", _action_names(array.shape[1]))
            elif path == "rewards":
                paths[path] = REWARD
                features[REWARD] = _feature(array, "float32")
            elif path == "dones":
                paths[path] = _DONE
                features[_DONE] = _feature(array, "bool")
            elif key != path and key.endswith("_image") and _is_coloured(array):
                paths[path] = feature = _IMAGES + key.removesuffix("_image")
                if images == "video" and (array.shape[1] % 2 or array.shape[2] % 2):
                    size = f"{array.shape[2]} x {array.shape[1]}"
                    raise MismatchError(f"{demo!r}: videos have even sides, but {path} is {size}; use --images png")
                features[feature] = {
                    "dtype": "image" if images == "png" else "video",
                    "shape": array.shape[1:],
                    "names": _FRAME_NAMES,
                }
            elif key != path and array.ndim < _MOST_DIMS and not key.startswith("ocp_"):
                environment = key == "object" or key.startswith(tuple(f"{name}_" for name in demo.object_names))
                paths[path] = feature = _ENVIRONMENT if environment else _STATE
                vectors.setdefault(feature, []).append((path, 1 if array.ndim == 1 else array.shape[1]))
            elif array.ndim <= _MOST_DIMS and not key.endswith(_PICTURES):
                paths[path] = feature = _EXTRA + path.replace("/", ".")
                features[feature] = _feature(array, str(array.dtype))
        for feature, parts in vectors.items():
            names = [f"{path.removeprefix('obs/')}.{i}" for path, width in parts for i in range(width)]
            features[feature] = {"dtype": "float32", "shape": (len(names),), "names": names}
        return cls(features, paths, vectors, [path for path in paths if arrays[path].ndim == 1])

    def pack(self, demo: Demonstration, arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """The arrays of one demonstration by feature.

        Raises:
            DatasetError: they are not those of the first demonstration.
        """
        packed: dict[str, np.ndarray] = {}
        for path, feature in self.paths.items():
            if path not in arrays:
                raise DatasetError(f"{demo!r}: no {path}, which others have; leave the demonstration out")
            if feature not in self.vectors:
                packed[feature] = _with_width(arrays[path]).astype(_stored_as(self.features[feature]), copy=False)
        for feature, parts in self.vectors.items():
            packed[feature] = np.concatenate([_with_width(arrays[path]) for path, _ in parts], 1).astype(np.float32)
        for feature, array in packed.items():
            wanted = tuple(self.features[feature]["shape"])
            if array.shape[1:] != wanted:
                raise DatasetError(f"{demo!r}: {feature} has shape {array.shape[1:]}, others {wanted}; leave it out")
        return packed


def _is_coloured(array: np.ndarray) -> bool:
    return array.dtype == np.uint8 and array.ndim == 1 + _MOST_DIMS and array.shape[-1] == _COLOURS


def _feature(array: np.ndarray, dtype: str, names: Sequence[str] | None = None) -> dict[str, Any]:
    return {"dtype": dtype, "shape": _with_width(array).shape[1:], "names": names}


def _stored_as(feature: Mapping[str, Any]) -> str:
    return "uint8" if feature["dtype"] in ("image", "video") else feature["dtype"]


def _with_width(array: np.ndarray) -> np.ndarray:
    """(T, 1) for (T,): LeRobot's features have a shape."""
    return array[:, None] if array.ndim == 1 else array


def _action_names(width: int) -> list[str]:
    each = ("x", "y", "z", "rotation_x", "rotation_y", "rotation_z", "gripper")
    if width % len(each):
        return [f"action.{i}" for i in range(width)]
    return [f"robot{arm}.{name}" for arm in range(width // len(each)) for name in each]


def paths_of(features: Mapping[str, dict[str, Any]], ours: Mapping[str, str]) -> dict[str, str]:
    """The HDF5 path of each feature that has one; vectors are taken apart later.

    Args:
        features: of a data set.
        ours: the paths of features that came from HDF5.

    Raises:
        DatasetError: there are no actions.
    """
    known = {_ACTION: "actions", REWARD: "rewards", _DONE: "dones"}
    paths = {}
    for key, feature in features.items():
        plain, shape = key.replace(".", "_").replace("/", "_"), feature["shape"]
        if feature["dtype"] in ("image", "video"):
            if _COLOURS in (shape[0], shape[-1]):
                paths[key] = f"obs/{plain.removeprefix('observation_').removeprefix('images_')}_image"
        elif not _is_number(feature["dtype"]) or len(shape) > _MOST_DIMS:
            continue
        elif key in known:
            paths[key] = known[key]
        elif key.startswith("observation."):
            paths[key] = f"obs/{plain.removeprefix('observation_')}"
        else:
            paths[key] = ours.get(key, plain)
    if _ACTION not in paths:
        raise DatasetError(f"no feature {_ACTION!r} among {', '.join(features) or 'none'}; rename the actions' to that")
    return paths


def _is_number(dtype: str) -> bool:
    try:
        return np.dtype(dtype).kind in "fiub"
    except TypeError:
        return False


def unpack(
    file: Mapping[str, np.ndarray],
    features: Mapping[str, dict[str, Any]],
    paths: Mapping[str, str],
    flat: Sequence[str],
) -> dict[str, np.ndarray]:
    """The arrays of an episode by HDF5 path; without a feature for the end, it ends with its last step.

    Args:
        file: arrays by feature.
        features: the data set's.
        paths: feature -> path, as :func:`paths_of` gives them.
        flat: paths of arrays of one dimension.
    """
    arrays: dict[str, np.ndarray] = {}
    for key, path in paths.items():
        parts = _parts(features[key]["names"]) if key in (_STATE, _ENVIRONMENT) else None
        if parts is None:
            arrays[path] = file[key]
        else:
            arrays |= {f"obs/{part}": file[key][:, columns] for part, columns in parts.items()}
    arrays |= {path: array[:, 0] for path, array in arrays.items() if path in flat}
    steps = len(arrays["actions"])
    dones = arrays["dones"] if "dones" in arrays else np.arange(steps) == steps - 1
    return {**arrays, "dones": dones.astype(np.int64)}


def _parts(names: Any) -> dict[str, list[int]] | None:
    """The columns of each key in a vector with names ``<key>.0``, ``<key>.1``, ...; None if it has others."""
    if not isinstance(names, list) or not names:
        return None
    parts: dict[str, list[int]] = {}
    for column, name in enumerate(names):
        key, dot, number = str(name).rpartition(".")
        if not dot or number != str(len(parts.get(key, ()))) or "/" in key:
            return None
        parts.setdefault(key, []).append(column)
    return parts

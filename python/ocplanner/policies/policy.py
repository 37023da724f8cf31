"""A trained policy: one ``.safetensors`` file with its whole configuration, and acting with it step by step."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors import SafetensorError
from safetensors.torch import load as load_tensors
from safetensors.torch import save
from torch import Tensor

from ocplanner.errors import InvalidValueError, MismatchError, ModelFileError, ShapeError
from ocplanner.files.hdf5 import HDF5_MAGIC
from ocplanner.files.records.policy import PolicyHeader
from ocplanner.files.storage import atomic_write
from ocplanner.policies.action_range import unscaled
from ocplanner.policies.config import HINT_KEY, POLICY_FILE, PolicyTraining, training_from_dict
from ocplanner.policies.network import PolicyNetwork, make_network
from ocplanner.policies.observation import Observation, cropped, low_dim_row
from ocplanner.settings import require_seed


def save_policy(network: PolicyNetwork, header: PolicyHeader, path: Path) -> None:
    """Write a policy file atomically.

    Raises:
        OutputError: it cannot be written.
    """
    tensors = {name: tensor.detach().cpu().contiguous() for name, tensor in network.state_dict().items()}
    with atomic_write(path) as temporary:
        temporary.write_bytes(save(tensors, metadata=header.metadata()))


class Policy:
    """A policy file, loaded on the CPU. One instance acts in one batch of environments at a time.

    Attributes:
        path: the file.
        sha256: its hash.
        header: what the file says about itself.
        training: the settings that it was trained with.
        observation_keys: what :meth:`act` needs, by the names under ``obs``.
        network: the network.
    """

    def __init__(self, path: Path, data: bytes) -> None:
        """Use :meth:`load`."""
        self.path, self.sha256 = path, hashlib.sha256(data).hexdigest()
        size = int.from_bytes(data[:8], "little")
        self.header = PolicyHeader.from_metadata(json.loads(data[8 : 8 + size])["__metadata__"])
        self.training = training_from_dict(self.header.training)
        tensors = load_tensors(data)
        _check_sizes(self.training, self.header, tensors)
        self.network = make_network(self.training, self.header.low_dim, self.header.actions)
        self.network.load_state_dict(tensors)
        self.network.eval()
        seen = self.training.observation
        hint = (HINT_KEY,) if self.training.reads_hints else ()
        keys = (*seen.low_dim, *(f"{name}_image" for name in seen.cameras), *hint)
        self.observation_keys: tuple[str, ...] = tuple(dict.fromkeys(keys))
        self.reset(0)

    @classmethod
    def load(cls, path: str | Path) -> "Policy":
        """Read a policy file made by ``ocplanner train-policy``. Nothing in it is unpickled.

        Args:
            path: the ``.safetensors`` file, or the finished run folder.

        Raises:
            ModelFileError: the file is missing, damaged, or no policy.
        """
        path = Path(path)
        path = path / POLICY_FILE if path.is_dir() else path
        try:
            return cls(path, path.read_bytes())
        except OSError as error:
            raise ModelFileError(
                f"{path}: cannot be read: {error.strerror}; give a policy file, or the run folder of a training"
            ) from error
        except (ModelFileError, SafetensorError, KeyError, TypeError, ValueError, RuntimeError) as error:
            raise ModelFileError(
                f"{path} is no policy file ({_found(path, error)}); write one with `ocplanner train-policy`"
            ) from error

    def reset(self, seed: int) -> None:
        """Begin an episode: forget what was seen, and draw actions from this seed.

        Raises:
            InvalidValueError: the seed is negative, larger than 2**63 - 1 or no whole number.
        """
        self._memory: Any = None
        self._generator = torch.Generator().manual_seed(require_seed(seed))

    def act(self, observation: Mapping[str, np.ndarray]) -> np.ndarray:
        """Draw actions, clipped to [-1, 1], or to the range of the recorded ones where those are in other units.

        Args:
            observation: for each of ``observation_keys`` an array (B, d), or (B, h, w, 3) uint8 for a camera.

        Returns:
            (B, A) float32.

        Raises:
            MismatchError: an observation is missing.
            ShapeError: an array has the wrong shape.
            InvalidValueError: a number is NaN or infinite.
        """
        seen = self._tensors(observation)
        with torch.inference_mode():
            actions, self._memory = self.network.act(seen, self._memory, self._generator)
        return unscaled(actions.clamp(-1, 1).numpy(), self.header.action_range)

    def _tensors(self, observation: Mapping[str, np.ndarray]) -> Observation:
        missing = [key for key in self.observation_keys if key not in observation]
        if missing:
            raise MismatchError(
                f"the policy needs {', '.join(self.observation_keys)}; missing: {', '.join(missing)}; "
                f"given: {', '.join(observation) or 'nothing'}"
            )
        seen = self.training.observation
        low_dim = low_dim_row(observation, seen.low_dim)
        if low_dim.ndim != 2 or low_dim.shape[1] != self.header.low_dim:
            raise ShapeError(f"observations {seen.low_dim}: {low_dim.shape}, expected (B, {self.header.low_dim})")
        for key in seen.low_dim:
            _check_finite(key, np.asarray(observation[key]))
        images: dict[str, Tensor] = {}
        for name in seen.cameras:
            image = np.asarray(observation[f"{name}_image"])
            if image.dtype != np.uint8 or image.shape[1:] != (seen.image_size, seen.image_size, 3):
                size = seen.image_size
                raise ShapeError(f"{name}_image: {image.dtype} {image.shape}, expected uint8 (B, {size}, {size}, 3)")
            images[name] = cropped(image, seen.crop, None)
        hint = observation.get(HINT_KEY) if self.training.network.hint is not None else None
        if hint is not None:
            _check_finite(HINT_KEY, np.asarray(hint))
        tensor = None if hint is None else torch.from_numpy(np.asarray(hint, dtype=np.float32))
        return Observation(torch.from_numpy(low_dim), images, tensor)

    def __repr__(self) -> str:
        """Name and algorithm."""
        return f"Policy({str(self.path)!r}, algorithm={self.training.algorithm!r})"


def _check_sizes(training: PolicyTraining, header: PolicyHeader, tensors: Mapping[str, Tensor]) -> None:
    """Compare the network with the file's tensors before memory is taken for it.

    Raises:
        ValueError: their sizes differ.
    """
    if max(len(training.network.hidden), training.network.lstm_layers) > len(tensors):
        raise ValueError(f"its configuration has more layers than the {len(tensors)} tensors in it")
    with torch.device("meta"):
        wanted = make_network(training, header.low_dim, header.actions).state_dict()
    for name in sorted({*wanted, *tensors}):
        sizes = [tuple(found[name].shape) if name in found else None for found in (wanted, tensors)]
        if sizes[0] != sizes[1]:
            raise ValueError(f"{name} is {sizes[1]} in it, but {sizes[0]} by its configuration")
        if not torch.isfinite(tensors[name]).all():
            raise ValueError(f"{name} holds NaN or infinity: its training went wrong, or the file is damaged")


def _check_finite(key: str, values: np.ndarray) -> None:
    if not np.isfinite(values).all():
        row = int(np.argwhere(~np.isfinite(values))[0][0])
        raise InvalidValueError(f"observation {key} holds NaN or infinity in row {row}: check the sensor, then act")


def _found(path: Path, error: Exception) -> str:
    with path.open("rb") as file:
        start = file.read(len(HDF5_MAGIC))
    return "it is an HDF5 file, perhaps a data set" if start == HDF5_MAGIC else str(error)

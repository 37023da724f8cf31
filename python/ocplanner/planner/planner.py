"""The trained planner: images in, future poses of the object out. The forward pass runs in Rust, without torch."""

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ocplanner import _core
from ocplanner.errors import MismatchError, ModelFileError
from ocplanner.files.records.planner import PlannerHeader

FILE_NAME = "planner.safetensors"
"""The planner in its run folder."""

Images = Mapping[str, NDArray[np.uint8]]


class Plan(NamedTuple):
    """Future poses of the object in the world frame; step k of the H steps is m'_{t+k+1}.

    Attributes:
        position: (B, H, 3) float64, metres; (B, M, H, 3) from :meth:`Planner.plan_modes`.
        rotation: (B, H, 3, 3) float64, object -> world, or (B, M, H, 3, 3); None if the planner plans positions only.
        probability: (B,) or (B, M) float64, the planner's belief in each plan.
    """

    position: np.ndarray
    rotation: np.ndarray | None
    probability: np.ndarray


class Planner:
    """A loaded planner file. Threads may share it: calls release the GIL and run at the same time.

    Attributes:
        path: the file.
        sha256: its hash.
        engine: the native planner.
        header: what the file says about itself.
    """

    def __init__(self, path: Path, data: bytes, storage: Literal["f32", "bf16"]) -> None:
        """Use :meth:`load`."""
        self.path = path
        self.sha256 = hashlib.sha256(data).hexdigest()
        self.engine = _core.PlannerEngine(data, storage)
        self.header = PlannerHeader.from_json(self.engine.config_json)

    @classmethod
    def load(cls, path: str | Path, storage: Literal["f32", "bf16"] = "f32") -> "Planner":
        """Read a planner file.

        Args:
            path: a ``.safetensors`` file written by ``ocplanner train-planner``, or its finished run folder.
            storage: ``f32`` keeps the weights as in the file. ``bf16`` rounds those of layers of 1 MiB and more
                (the late convolutions of ResNet18, large LSTMs); this saves memory traffic and moves a plan by
                fractions of a millimetre. Small planners stay as they are. The arithmetic is float32 either way.

        Raises:
            ModelFileError: the file is missing, damaged, or not a planner.
        """
        path = Path(path)
        path = path / FILE_NAME if path.is_dir() else path
        try:
            return cls(path, path.read_bytes(), storage)
        except OSError as error:
            raise ModelFileError(
                f"{path}: cannot be read: {error.strerror}; give the {FILE_NAME} of a run folder"
            ) from error
        except ModelFileError as error:
            raise ModelFileError(f"{path}: {error}") from None

    def plan(self, images: Images, threads: int = 1, steps: int | None = None) -> Plan:
        """Plan with the most probable mode of each image.

        Args:
            images: camera name -> (B, h, w, 3) uint8 RGB, upright, C-contiguous; cameras that the planner does not
                use are ignored.
            threads: how many threads share a batch; the plans depend on it only by rounding.
            steps: decode only the first so many of the H steps, which costs less.

        Raises:
            InvalidValueError: ``steps`` is zero or more than H.
            MismatchError: a camera is missing.
            ShapeError: an array has the wrong shape, dtype or memory order.
        """
        return Plan(*self.engine.plan(self.arrays(images), threads=threads, steps=steps))

    def plan_modes(self, images: Images, threads: int = 1) -> Plan:
        """Plan with every mode, in the network's order: arrays have a second axis M. Otherwise like :meth:`plan`."""
        return Plan(*self.engine.plan(self.arrays(images), all_modes=True, threads=threads))

    def encode(self, images: Images, threads: int = 1) -> NDArray[np.float32]:
        """Latent means (B, latent) of the most probable mode of each image. Raises like :meth:`plan`."""
        return self.engine.encode(self.arrays(images), threads)

    def arrays(self, images: Images) -> list[NDArray[np.uint8]]:
        """The images of the planner's cameras in the engine's order.

        Raises:
            MismatchError: a camera is missing, or ``images`` is no dictionary.
        """
        if not isinstance(images, Mapping):
            raise MismatchError(
                f"images is a {type(images).__name__}, expected a dictionary of cameras: "
                f"{{{self.header.cameras[0]!r}: array of shape (B, h, w, 3) uint8}}"
            )
        missing = [camera for camera in self.header.cameras if camera not in images]
        if missing:
            raise MismatchError(
                f"the planner reads images of {', '.join(self.header.cameras)}; missing: {', '.join(missing)}; "
                f"given: {', '.join(images) or 'none'}"
            )
        return [images[camera] for camera in self.header.cameras]

    def __repr__(self) -> str:
        """File, horizon and outputs."""
        return f"Planner({str(self.path)!r}, horizon={self.header.horizon}, outputs={self.header.outputs!r})"

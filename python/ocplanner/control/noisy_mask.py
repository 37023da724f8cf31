"""Robot masks that are a few pixels off, as a calibration error of the camera would make them."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from ocplanner.envs.visuals import MASK_RGB
from ocplanner.errors import MismatchError
from ocplanner.settings import require

KINDS = ("shift", "dilate", "erode")


class MaskedView(Protocol):
    """What draws the robot's mask into its pictures, such as :class:`ocplanner.envs.ManipulationEnv`."""

    @property
    def observe_mode(self) -> str: ...  # noqa: D102
    @property
    def image_size(self) -> int: ...  # noqa: D102
    @property
    def cameras(self) -> Sequence[str]: ...  # noqa: D102
    def observe(self) -> dict[str, np.ndarray]: ...  # noqa: D102
    def robot_mask(self, camera: str, width: int, height: int) -> np.ndarray: ...  # noqa: D102
    def render(self, camera: str, width: int, height: int, observe: str) -> np.ndarray: ...  # noqa: D102


class NoisyMask:
    """Pictures whose robot mask is wrong in one way for a whole episode.

    Where the mask is too small, the robot shows; where it is too large, the scene is painted over.

    Args:
        pixels: size of the error, 0 for none.
        seed: of the episode; it decides between a shift (in a random direction), a dilation and an erosion.

    Raises:
        InvalidValueError: ``pixels`` is negative.
    """

    def __init__(self, pixels: int, seed: int) -> None:
        require(pixels >= 0, f"mask error is {pixels} pixels, but cannot be negative")
        rng = np.random.default_rng([pixels, seed])
        self.pixels = pixels
        self.kind = str(rng.choice(KINDS))
        angle = rng.uniform(0, 2 * np.pi)
        self.shift = (round(pixels * np.sin(angle)), round(pixels * np.cos(angle)))

    def observe(self, env: MaskedView) -> dict[str, np.ndarray]:
        """Pictures (h, w, 3) uint8 by camera.

        Raises:
            MismatchError: the environment does not paint a mask.
        """
        if self.pixels == 0:
            return env.observe()
        if env.observe_mode != "masked":
            raise MismatchError(f"a mask error needs observe=masked, but the environment shows {env.observe_mode}")
        return {camera: self._picture(env, camera) for camera in env.cameras}

    def _picture(self, env: MaskedView, camera: str) -> np.ndarray:
        size = env.image_size
        right = env.robot_mask(camera, size, size)
        wrong = self.distort(right)
        return np.where(wrong[..., None], np.array(MASK_RGB, dtype=np.uint8), env.render(camera, size, size, "full"))

    def distort(self, mask: np.ndarray) -> np.ndarray:
        """The wrong mask (h, w) bool of a right one."""
        if self.kind == "shift":
            return _shifted(mask, *self.shift)
        grown = mask if self.kind == "dilate" else ~mask
        for _ in range(self.pixels):
            near = [_shifted(grown, dy, dx) for dy, dx in ((0, 1), (0, -1), (1, 0), (-1, 0))]
            grown = np.logical_or.reduce([grown, *near])
        return grown if self.kind == "dilate" else ~grown


def _shifted(mask: np.ndarray, down: int, right: int) -> np.ndarray:
    """Moved, the border repeated."""
    h, w = mask.shape
    rows = np.clip(np.arange(h) - down, 0, h - 1)
    columns = np.clip(np.arange(w) - right, 0, w - 1)
    return mask[np.ix_(rows, columns)]

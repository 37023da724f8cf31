"""The cameras of one environment and their images."""

import re
from numbers import Integral
from typing import Any

import numpy as np

from ocplanner.envs.rendering import Renderer
from ocplanner.envs.simulator import mujoco
from ocplanner.envs.visuals import MASK_RGB, OBSERVE_MODES, VisualPreset
from ocplanner.errors import UnknownNameError
from ocplanner.settings import require

_VISUAL_GROUP = 1
_ROBOT = re.compile(r"(robot|gripper)\d+_")


MOST_PIXELS = 2048
"""The longest side of a picture."""


def require_size(name: str, size: int) -> int:
    """Check a picture's side.

    Raises:
        InvalidValueError: it is no whole number of pixels that can be drawn.
    """
    drawable = isinstance(size, Integral) and 1 <= size <= MOST_PIXELS
    require(drawable, f"{name} is {size!r}, but must be 1 to {MOST_PIXELS} pixels")
    return int(size)


class Cameras:
    """All cameras of a model; each image size gets an OpenGL context when it is first drawn.

    Args:
        model: the compiled model.
        data: its state, read for each image.
        preset: how much to draw.
    """

    def __init__(self, model: Any, data: Any, preset: VisualPreset) -> None:
        self._model = model
        self._data = data
        self._preset = preset
        self._ids = {model.camera(camera).name: camera for camera in range(model.ncam)}
        self._renderers: dict[tuple[int, int], Renderer] = {}

    def number(self, name: str) -> int:
        """Id of a camera.

        Raises:
            UnknownNameError: no camera has this name.
        """
        if name not in self._ids:
            raise UnknownNameError("camera", name, self._ids)
        return self._ids[name]

    def render(self, camera: str, width: int, height: int, observe: str) -> np.ndarray:
        """(h, w, 3) uint8, upright.

        Raises:
            UnknownNameError: no such camera or observation.
            RenderingError: no working headless OpenGL.
        """
        number, renderer = self.number(camera), self._renderer(width, height)
        if observe == "full":
            return renderer.full(number)
        if observe == "no-robot":
            return renderer.without_robot(number)
        if observe != "masked":
            raise UnknownNameError("observation", observe, OBSERVE_MODES)
        if self._preset.local:
            return renderer.flat_robot(number)
        mask = renderer.robot_mask(number)
        return np.where(mask[..., None], np.array(MASK_RGB, dtype=np.uint8), renderer.without_robot(number))

    def robot_mask(self, camera: str, width: int, height: int) -> np.ndarray:
        """(h, w) bool, upright: the pixels in which the robot is visible."""
        number = self.number(camera)
        return self._renderer(width, height).robot_mask(number)

    def project(self, camera: str, points: np.ndarray, width: int, height: int) -> np.ndarray:
        """(N, 2) pixels, x right and y down, of (N, 3) world points in metres; NaN for those behind the camera."""
        number = self.number(camera)
        rotation = self._data.cam_xmat[number].reshape(3, 3)
        local = (np.asarray(points, dtype=np.float64) - self._data.cam_xpos[number]) @ rotation
        focal = 0.5 * height / np.tan(np.deg2rad(self._model.cam_fovy[number]) / 2)
        depth = np.where(local[:, 2] < 0, -local[:, 2], np.nan)
        return np.stack([width / 2 + focal * local[:, 0] / depth, height / 2 - focal * local[:, 1] / depth], axis=1)

    def close(self) -> None:
        """Free the OpenGL contexts."""
        for renderer in self._renderers.values():
            renderer.close()
        self._renderers.clear()

    def _renderer(self, width: int, height: int) -> Renderer:
        size = (require_size("width", width), require_size("height", height))
        if size not in self._renderers:
            geoms = robot_geoms(self._model)
            self._renderers[size] = Renderer(self._model, self._data, width, height, self._preset, geoms)
        return self._renderers[size]


def robot_geoms(model: Any) -> np.ndarray:
    """Ids of the visual geoms of the arms and their grippers, without the pedestals."""
    names = (mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, body) or "" for body in range(model.nbody))
    of_robot = np.array([_ROBOT.match(name) is not None for name in names])
    return np.flatnonzero(of_robot[model.geom_bodyid] & (model.geom_group == _VISUAL_GROUP))

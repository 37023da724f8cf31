"""Drawing a MuJoCo scene into an array, off-screen."""

import atexit
import os
import sys
import weakref
from typing import Any

import numpy as np

from ocplanner.envs.simulator import gl_context, mujoco, rendering_error
from ocplanner.envs.visuals import MASK_MATERIAL, VisualPreset

_HIDDEN_GROUP = 5
_VISUAL_GROUP = 1

_open: "weakref.WeakSet[Renderer]" = weakref.WeakSet()
"""The renderers of this process whose OpenGL contexts are not freed yet."""


def _close_all() -> None:
    for renderer in list(_open):
        renderer.close()


def _leave_to_parent() -> None:
    """In a forked process: mujoco would end a display whose threads were not forked with it, and wait for them."""
    egl = sys.modules.get("mujoco.egl")
    if egl is not None:
        atexit.unregister(egl.EGL.eglTerminate)


class Renderer:
    """Draws one model at one size, with its own OpenGL context.

    Args:
        model: the compiled model.
        data: its state, read for each image.
        width: pixels.
        height: pixels.
        preset: how much to draw.
        robot_geoms: ids of the robot's visual geoms.

    Raises:
        RenderingError: there is no working headless OpenGL.
    """

    def __init__(
        self,
        model: Any,
        data: Any,
        width: int,
        height: int,
        preset: VisualPreset,
        robot_geoms: np.ndarray,
    ) -> None:
        self._gl: Any = None
        self._context: Any = None
        self._owner = os.getpid()
        self.width = width
        self.height = height
        self._model = model
        self._data = data
        self._preset = preset
        self._robot_geoms = robot_geoms
        self._mask_material = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_MATERIAL, MASK_MATERIAL)
        model.vis.global_.offwidth = width
        model.vis.global_.offheight = height
        model.vis.quality.offsamples = preset.multisamples
        if not preset.shadows:
            model.vis.quality.shadowsize = 0
        try:
            self._gl = gl_context(width, height)
            self._gl.make_current()
            self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
        except Exception as error:  # each OpenGL backend raises its own classes
            self.close()
            raise rendering_error(error) from error
        if not _open:
            # Registered after mujoco's own exit handler, so that this one runs first.
            atexit.register(_close_all)
            os.register_at_fork(after_in_child=_leave_to_parent)
        _open.add(self)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)
        self._scene = mujoco.MjvScene(model, maxgeom=model.ngeom + model.nsite + 200)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = preset.shadows
        self._scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = preset.reflections
        self._camera = mujoco.MjvCamera()
        self._camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
        self._perturbation = mujoco.MjvPerturb()
        self._viewport = mujoco.MjrRect(0, 0, width, height)
        self._options = mujoco.MjvOption()
        self._options.geomgroup[:] = [0, 1, 1, 0, 0, 0]
        self._plain_options = mujoco.MjvOption()
        self._plain_options.geomgroup[:] = [0, 1, 1, 0, 0, 0]
        self._plain_options.sitegroup[:] = 0
        if not preset.markers:
            self._options = self._plain_options

    def full(self, camera: int) -> np.ndarray:
        """(h, w, 3) uint8 image of everything, upright."""
        return self._draw(camera, self._options)

    def without_robot(self, camera: int) -> np.ndarray:
        """(h, w, 3) uint8 image without the robot, upright."""
        groups = self._model.geom_group
        groups[self._robot_geoms] = _HIDDEN_GROUP
        try:
            return self._draw(camera, self._plain_options)
        finally:
            groups[self._robot_geoms] = _VISUAL_GROUP

    def flat_robot(self, camera: int) -> np.ndarray:
        """(h, w, 3) uint8 image with the robot in one colour, upright.

        With a preset whose pixels are local, it differs from :meth:`without_robot` only where the robot is visible.
        """
        model, geoms = self._model, self._robot_geoms
        materials, colours = model.geom_matid[geoms].copy(), model.geom_rgba[geoms].copy()
        model.geom_matid[geoms] = self._mask_material
        model.geom_rgba[geoms] = model.mat_rgba[self._mask_material]
        try:
            return self._draw(camera, self._plain_options)
        finally:
            model.geom_matid[geoms] = materials
            model.geom_rgba[geoms] = colours

    def robot_mask(self, camera: int) -> np.ndarray:
        """(h, w) bool, upright: the pixels in which the robot is visible."""
        flags = self._scene.flags
        flags[mujoco.mjtRndFlag.mjRND_SEGMENT] = 1
        flags[mujoco.mjtRndFlag.mjRND_IDCOLOR] = 1
        try:
            colours = self._draw(camera, self._plain_options).astype(np.int32)
        finally:
            flags[mujoco.mjtRndFlag.mjRND_SEGMENT] = 0
            flags[mujoco.mjtRndFlag.mjRND_IDCOLOR] = 0
        drawn = colours[..., 0] + (colours[..., 1] << 8) + (colours[..., 2] << 16)
        return self._robot_segments()[drawn]

    def close(self) -> None:
        """Free the OpenGL context, in the process that made it."""
        if self._gl is not None:
            gl, self._gl = self._gl, None
            _open.discard(self)
            if self._owner != os.getpid():  # after a fork: the context is the parent's, and its threads are not here
                return
            if self._context is not None:
                gl.make_current()
                self._context.free()
            gl.free()

    def __del__(self) -> None:
        """Free the context while it is current; mujoco's destructor would free another context's objects."""
        if not sys.is_finalizing():
            self.close()

    def _draw(self, camera: int, options: Any) -> np.ndarray:
        self._gl.make_current()
        self._camera.fixedcamid = camera
        mujoco.mjv_updateScene(
            self._model,
            self._data,
            options,
            self._perturbation,
            self._camera,
            mujoco.mjtCatBit.mjCAT_ALL,
            self._scene,
        )
        mujoco.mjr_render(self._viewport, self._scene, self._context)
        picture = np.empty((self.height, self.width, 3), dtype=np.uint8)
        mujoco.mjr_readPixels(picture, None, self._viewport, self._context)
        return np.ascontiguousarray(picture[::-1])

    def _robot_segments(self) -> np.ndarray:
        """Whether each segmentation id plus one is the robot's (index 0 is the background), bool."""
        robot: set[int] = set(self._robot_geoms.tolist())
        table = np.zeros(self._scene.ngeom + 1, dtype=bool)
        for geom in self._scene.geoms[: self._scene.ngeom]:
            if geom.segid >= 0 and geom.objtype == mujoco.mjtObj.mjOBJ_GEOM:
                table[geom.segid + 1] = geom.objid in robot
        return table

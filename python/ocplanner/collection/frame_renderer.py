"""The images of one demonstration, drawn from its states."""

from collections.abc import Mapping

import numpy as np

from ocplanner.collection.settings import RenderSettings
from ocplanner.collection.silhouettes import Hand, SilhouetteArm
from ocplanner.demos.demonstration import Demonstration
from ocplanner.demos.recorded_world import RecordedWorld
from ocplanner.demos.segments import Segment
from ocplanner.envs import make_env
from ocplanner.envs.tasks import task as task_of_name
from ocplanner.envs.visuals import MASK_RGB
from ocplanner.errors import DatasetError

_POSE_TOLERANCE_M = 1e-3


class FrameRenderer:
    """Draws demonstrations of one task that were recorded with one arm.

    Args:
        task_name: the task.
        robot: the recorded arm.
        settings: what is drawn.
        grippers: ``gripper_types`` of the data set.

    Raises:
        MismatchError: another gripper was recorded than the arm is simulated with.
        UnknownNameError: the task has no such camera, or a name is not known.
        RenderingError: no working headless OpenGL.
    """

    def __init__(self, task_name: str, robot: str, settings: RenderSettings, grippers: object = None) -> None:
        self._settings = settings
        self._task = task_of_name(task_name)
        size, visual = settings.size, settings.visual
        self._env = make_env(self._task, robot, cameras=settings.cameras, image_size=size, visual=visual)
        self._world = RecordedWorld(self._env, grippers)
        self._arms = [SilhouetteArm(self._task, robot, name, settings) for name in settings.silhouette_arms]

    def render(self, demo: Demonstration) -> dict[str, np.ndarray]:
        """The arrays to add to a demonstration of T steps, by path; frames that are not drawn are zero.

        ``obs/<camera>_image`` (T, h, w, 3) uint8; with ``masked`` also ``_empty`` (T, h, w, 3) uint8, ``_mask``
        (T, h, w) bool and, with K silhouettes, ``_silhouettes`` (T, K, h, w) bool.

        Raises:
            DatasetError: the states do not belong to this task and arm.
            MismatchError: another arm, gripper or scene was recorded.
        """
        settings, states = self._settings, self._world.open(demo)
        poses = {spec.name: demo.object_poses(spec.name) for spec in self._task.objects}
        segments = self._segments(demo)
        kept = [row for segment in segments for row in range(segment.start, segment.stop)]
        rows = sorted(set(kept)) if settings.frames == "manipulation" else range(demo.length)
        stride = settings.silhouette_stride
        outlined = {row for segment in segments for row in range(segment.start, segment.stop, stride)}
        arrays = self._allocate(demo.length)
        for arm in self._arms:
            arm.start(demo.model_file)
        for row in rows:
            self._set_state(demo, row, states[row], {name: places[row] for name, (places, _) in poses.items()})
            self._draw(arrays, row)
            if row in outlined:
                self._draw_silhouettes(arrays, row)
        return arrays

    def close(self) -> None:
        """Free the environments."""
        self._env.close()
        for arm in self._arms:
            arm.close()

    def _segments(self, demo: Demonstration) -> list[Segment]:
        """The kept steps of each of the task's objects."""
        if self._settings.frames == "all" and not self._arms:
            return []
        return [demo.manipulation(spec.name) for spec in self._task.objects]

    def _allocate(self, length: int) -> dict[str, np.ndarray]:
        settings, arrays = self._settings, {}
        shape = (length, settings.size, settings.size)
        for camera in settings.cameras:
            arrays[f"obs/{camera}_image"] = np.zeros((*shape, 3), np.uint8)
            if settings.observe == "masked":
                arrays[f"obs/{camera}_empty"] = np.zeros((*shape, 3), np.uint8)
                arrays[f"obs/{camera}_mask"] = np.zeros(shape, bool)
            if self._arms:
                arrays[f"obs/{camera}_silhouettes"] = np.zeros((length, len(self._arms), *shape[1:]), bool)
        return arrays

    def _set_state(self, demo: Demonstration, row: int, state: np.ndarray, recorded: Mapping[str, np.ndarray]) -> None:
        self._world.show(demo, state)
        for name, position in recorded.items():
            off = float(np.abs(self._env.object_pose(name).position - position).max())
            if off > _POSE_TOLERANCE_M:
                raise DatasetError(
                    f"{demo!r}: the state of step {row} puts the object {1e3 * off:.1f} mm from its recorded pose; "
                    "the states were recorded with another model: record the demonstration again"
                )

    def _draw(self, arrays: dict[str, np.ndarray], row: int) -> None:
        size = self._settings.size
        for camera in self._settings.cameras:
            if self._settings.observe != "masked":
                arrays[f"obs/{camera}_image"][row] = self._env.render(camera, size, size, self._settings.observe)
                continue
            empty = self._env.render(camera, size, size, "no-robot")
            mask = self._env.robot_mask(camera)
            arrays[f"obs/{camera}_empty"][row] = empty
            arrays[f"obs/{camera}_mask"][row] = mask
            arrays[f"obs/{camera}_image"][row] = np.where(mask[..., None], np.array(MASK_RGB, np.uint8), empty)

    def _draw_silhouettes(self, arrays: dict[str, np.ndarray], row: int) -> None:
        poses = {spec.name: self._env.object_pose(spec.name) for spec in self._task.objects}
        hands = [Hand(arm.eef_pose(), arm.gripper_opening) for arm in self._env.arms]
        for number, arm in enumerate(self._arms):
            for camera, mask in arm.masks(poses, hands).items():
                arrays[f"obs/{camera}_silhouettes"][row, number] = mask

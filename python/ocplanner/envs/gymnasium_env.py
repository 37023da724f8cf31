"""An environment with Gymnasium's interface.

>>> import gymnasium, ocplanner                                                         # doctest: +SKIP
>>> env = gymnasium.make("ocplanner/Square-v0", robot="UR5e", render_mode="rgb_array")   # doctest: +SKIP
"""

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from ocplanner.envs.environment import make_env
from ocplanner.errors import UnknownNameError
from ocplanner.geometry.rotation import rotation_to_6d
from ocplanner.settings import require_seed

_FARTHEST_M = 20.0
_WIDEST_M = 0.5
_RENDER_SIZE = (480, 360)


class GymnasiumEnv(gymnasium.Env[dict[str, np.ndarray], np.ndarray]):
    """One task with as many arms as it needs.

    The action is Box(-1, 1, (7 arms,), float32), see :meth:`ocplanner.envs.ManipulationEnv.step`. The observation is a
    dictionary:

    ===================  =================  =========================================================================
    ``<camera>_image``   (h, w, 3) uint8    the image of each camera in the chosen observation mode, upright
    ``object_position``  (3,) float32       of the task's main object, world frame, metres
    ``object_rot6d``     (6,) float32       the first two columns of its rotation matrix
    ``eef_position``     (3,) float32       of the end-effector site, world frame, metres
    ``eef_rot6d``        (6,) float32       the first two columns of its rotation matrix
    ``gripper_opening``  (1,) float32       gap between the finger pads, metres
    ===================  =================  =========================================================================

    Further arms add ``eef1_position``, ``eef1_rot6d``, ``gripper1_opening``, and so on.

    The reward is 1 in the step in which the task succeeds, which terminates the episode, and 0 otherwise. The episode
    is truncated at the horizon. ``info["success"]`` is whether the task succeeded.

    Args:
        task: task name.
        robot: arm name.
        render_mode: ``"rgb_array"`` or None.
        render_camera: camera of :meth:`render`; if not given, the first of ``cameras``, or else of the task's.
        **options: as for :func:`ocplanner.envs.make_env`.

    Raises:
        UnknownNameError: a name is not known.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 20}  # noqa: RUF012 - Gymnasium's own type

    def __init__(
        self,
        task: str,
        robot: str = "Panda",
        render_mode: str | None = None,
        render_camera: str | None = None,
        **options: Any,
    ) -> None:
        if render_mode not in (None, "rgb_array"):
            raise UnknownNameError("render mode", str(render_mode), ("rgb_array",))
        self.render_mode = render_mode
        self.env = make_env(task, robot, **options)
        self._render_camera = render_camera or (*self.env.cameras, *self.env.task.cameras)[0]
        self._numbers = ("", *range(1, len(self.env.arms)))
        size = self.env.image_size
        picture = spaces.Box(0, 255, (size, size, 3), np.uint8)
        position = spaces.Box(-_FARTHEST_M, _FARTHEST_M, (3,), np.float32)
        rot6d = spaces.Box(-1.0, 1.0, (6,), np.float32)
        self.action_space = spaces.Box(-1.0, 1.0, (self.env.action_dim,), np.float32)
        self.observation_space: Any = spaces.Dict(
            {
                **{f"{camera}_image": picture for camera in self.env.cameras},
                "object_position": position,
                "object_rot6d": rot6d,
                **{f"eef{number}_position": position for number in self._numbers},
                **{f"eef{number}_rot6d": rot6d for number in self._numbers},
                **{
                    f"gripper{number}_opening": spaces.Box(0.0, _WIDEST_M, (1,), np.float32) for number in self._numbers
                },
            }
        )

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Start an episode; a seed determines it and the following ones without a seed."""
        seed = None if seed is None else require_seed(seed)
        super().reset(seed=seed, options=options)
        self.env.reset(int(self.np_random.integers(2**31)) if seed is None else seed)
        return self._observation(), {"success": False}

    def step(self, action: np.ndarray) -> tuple[dict[str, np.ndarray], float, bool, bool, dict[str, Any]]:
        """Advance 0.05 s."""
        self.env.step(action)
        success = self.env.success()
        truncated = self.env.steps >= self.env.horizon and not success
        return self._observation(), float(success), success, truncated, {"success": success}

    def render(self) -> np.ndarray | None:  # pyright: ignore[reportIncompatibleMethodOverride]
        """(360, 480, 3) uint8 image of everything in any observation mode; None without a render mode."""
        if self.render_mode is None:
            return None
        return self.env.render(self._render_camera, *_RENDER_SIZE)

    def close(self) -> None:
        """Free the OpenGL contexts and the simulation."""
        self.env.close()

    def _observation(self) -> dict[str, np.ndarray]:
        found = {f"{camera}_image": picture for camera, picture in self.env.observe().items()}
        poses = {f"eef{number}": arm.eef_pose() for number, arm in zip(self._numbers, self.env.arms)}
        for name, pose in {"object": self.env.object_pose(), **poses}.items():
            found[f"{name}_position"] = np.clip(pose.position, -_FARTHEST_M, _FARTHEST_M).astype(np.float32)
            found[f"{name}_rot6d"] = np.clip(rotation_to_6d(pose.rotation), -1.0, 1.0).astype(np.float32)
        for number, arm in zip(self._numbers, self.env.arms):
            found[f"gripper{number}_opening"] = np.clip([arm.gripper_opening], 0.0, _WIDEST_M).astype(np.float32)
        return found

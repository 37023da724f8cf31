"""The simulated environment: one task with its arms."""

from typing import Any

import numpy as np

from ocplanner.envs import CONTROL_HZ, CONTROL_RANGE_HZ, ControlLoop
from ocplanner.envs.arms import RobotArm
from ocplanner.envs.cameras import Cameras, require_size
from ocplanner.envs.kinematics import reach
from ocplanner.envs.native_control import attach
from ocplanner.envs.patches import check_patches
from ocplanner.envs.robots import RobotSpec
from ocplanner.envs.robots import robot as robot_spec
from ocplanner.envs.scene import build_robosuite_env
from ocplanner.envs.simulator import mujoco
from ocplanner.envs.tasks import Task
from ocplanner.envs.tasks import task as task_of_name
from ocplanner.envs.visuals import Observe, visual_preset
from ocplanner.errors import ShapeError
from ocplanner.geometry.pose import Pose
from ocplanner.settings import require, require_choice, require_finite, require_names, require_seed

_RESTARTS = 6


class ManipulationEnv:
    """One task, controlled by normalised end-effector deltas (OSC_POSE).

    A task for several arms has several of the same kind in :attr:`arms`; the methods about one arm are about the first.

    All poses are in robosuite's world frame, metres; images are upright (h, w, 3) uint8. Use it as a context manager,
    or call :meth:`close`.

    Args:
        task: a task or its name.
        robot: an arm or its name.
        cameras: cameras that :meth:`observe` draws; the task's own if not given.
        image_size: width and height of those images, pixels.
        visual: visual preset, ``"fast"`` or ``"stock"``.
        observe: what the images show: ``"full"``, ``"masked"`` (the robot painted flat) or ``"no-robot"``.
        patches: corrections of the model; the arm's own if not given, none for ``()``.
        control: the control loop: ``"native"``, or ``"stock"`` for robosuite's, which is several times slower. Both
            give the same torques. If ``"native"`` does not support the robot, it warns and uses ``"stock"``.
        seed: seed of the first episode.
        horizon: control steps of an episode; the task's own if not given. The environment does not stop there itself.
        control_freq: control steps a second.

    Attributes (and the other arguments, resolved, under their own names):
        observe_mode: what the images show.
        arms: the arms, in robosuite's order.
        steps: control steps since the last reset.

    Raises:
        UnknownNameError: a name is not known; the message lists the known ones.
        InvalidValueError: a number is out of range, or one text is given in place of several names.
    """

    def __init__(
        self,
        task: str | Task,
        robot: str | RobotSpec = "Panda",
        *,
        cameras: tuple[str, ...] | None = None,
        image_size: int = 84,
        visual: str = "fast",
        observe: str = "full",
        patches: tuple[str, ...] | None = None,
        control: str = "native",
        seed: int = 0,
        horizon: int | None = None,
        control_freq: float = CONTROL_HZ,
    ) -> None:
        slowest, fastest = CONTROL_RANGE_HZ
        in_range = slowest <= control_freq <= fastest
        require(in_range, f"control_freq is {control_freq:g} Hz, but must be {slowest:g} to {fastest:g}")
        require_choice("observation", observe, Observe)
        require_choice("control loop", control, ControlLoop)
        self.task = task = task_of_name(task) if isinstance(task, str) else task
        self.robot = robot = robot_spec(robot) if isinstance(robot, str) else robot
        self.cameras = task.cameras if cameras is None else require_names("cameras", cameras)
        self.image_size = require_size("image_size", image_size)
        self.visual = visual_preset(visual)
        self.observe_mode = observe
        self.patches = robot.patches if patches is None else require_names("patches", patches)
        self.horizon = task.horizon if horizon is None else horizon
        self.control_freq = control_freq
        require(self.horizon >= 1, f"horizon is {self.horizon}, but must be at least 1")
        require_seed(seed)
        self.steps = 0
        check_patches(self.patches)
        self._env = build_robosuite_env(task, robot, self.visual, self.patches, seed, control_freq)
        self._control = attach(self._env) if control == "native" else None
        self.control = "stock" if self._control is None else "native"
        self._find_references()
        self.reset(seed)

    def _find_references(self) -> None:
        model = self.model
        self.arms = tuple(RobotArm(robot, model, self.data, self.robot) for robot in self._env.robots)
        self._objects = {}
        for spec in self.task.objects:
            joint = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, spec.joint)
            self._objects[spec.name] = (int(model.jnt_bodyid[joint]), int(model.jnt_qposadr[joint]), joint)
        self._pictures = Cameras(model, self.data, self.visual)
        for camera in self.cameras:
            self._pictures.number(camera)

    @property
    def sim(self) -> Any:
        """robosuite's simulation object."""
        return self._env.sim

    @property
    def robosuite_env(self) -> Any:
        """robosuite's environment."""
        return self._env

    @property
    def model(self) -> Any:
        """The compiled ``mujoco.MjModel``."""
        return self._env.sim.model._model

    @property
    def data(self) -> Any:
        """The ``mujoco.MjData``."""
        return self._env.sim.data._data

    @property
    def action_dim(self) -> int:
        """Length of an action: for each arm 3 numbers of position, 3 of rotation and 1 of the gripper."""
        return self._env.action_dim

    def reset(self, seed: int) -> None:
        """Start the episode of a seed; it is always the same for the same seed.

        Raises:
            InvalidValueError: the seed is negative, larger than 2**63 - 1 or no whole number.
        """
        seed = require_seed(seed)
        self._env.rng.bit_generator.state = np.random.default_rng(seed).bit_generator.state
        self._env.reset()
        self.steps = 0

    def step(self, action: np.ndarray) -> None:
        """Advance one control step (0.05 s at 20 Hz).

        Args:
            action: (7,) in [-1, 1]: position delta (times 0.05 m), rotation vector delta (times 0.5 rad), both in the
                frame of :attr:`base_rotation`, and the gripper (-1 opens, 1 closes). Several arms: (7 arms,), one after
                the other.

        Raises:
            ShapeError: the action has another shape.
            InvalidValueError: a number is NaN or infinite; nothing has moved.
        """
        action = np.asarray(action, dtype=np.float64)
        if action.shape != (self.action_dim,):
            raise ShapeError(f"an action of {self.task.name} has shape {action.shape}, expected ({self.action_dim},)")
        require_finite("an action", action)
        if self._control is None:
            self._env.step(action)
        else:
            self._control.advance(action)
        self.steps += 1

    def object_pose(self, name: str | None = None) -> Pose:
        """Pose of an object; of the task's main one if no name is given."""
        body = self._objects[self.task.object(name).name][0]
        return Pose(self.data.xpos[body].copy(), self.data.xmat[body].reshape(3, 3).copy())

    def eef_pose(self) -> Pose:
        """Pose of the end-effector site, midway between the finger tips."""
        return self.arms[0].eef_pose()

    @property
    def base_rotation(self) -> np.ndarray:
        """(3, 3) rotation, frame of the action's deltas -> world; see :attr:`RobotArm.base_rotation`."""
        return self.arms[0].base_rotation

    @property
    def gripper_opening(self) -> float:
        """Gap between the finger pads, metres."""
        return self.arms[0].gripper_opening

    def success(self) -> bool:
        """Whether the task is solved, as robosuite judges it."""
        return bool(self._env._check_success())

    def in_contact(self, object_name: str | None = None, arm: int = 0) -> bool:
        """Whether both sides of the gripper touch an object. Privileged: for classifying failures, not for control."""
        body = self._objects[self.task.object(object_name).name][0]
        return self.arms[arm].gripper.touches(np.flatnonzero(self.model.geom_bodyid == body))

    def observe(self) -> dict[str, np.ndarray]:
        """Images of the chosen cameras in the chosen mode, (h, w, 3) uint8, by camera name."""
        size = self.image_size
        return {camera: self.render(camera, size, size, self.observe_mode) for camera in self.cameras}

    def render(self, camera: str, width: int, height: int, observe: str = "full") -> np.ndarray:
        """One (h, w, 3) uint8 image of any camera.

        Raises:
            UnknownNameError: no such camera or observation.
            RenderingError: no working headless OpenGL.
        """
        return self._pictures.render(camera, width, height, observe)

    def robot_mask(self, camera: str, width: int | None = None, height: int | None = None) -> np.ndarray:
        """(h, w) bool, the pixels in which the robot is visible."""
        return self._pictures.robot_mask(camera, width or self.image_size, height or self.image_size)

    def project(self, camera: str, points: np.ndarray, width: int, height: int) -> np.ndarray:
        """Project points into a camera's image.

        Args:
            camera: camera name.
            points: (N, 3) world frame, metres.
            width: of the image, pixels.
            height: of the image, pixels.

        Returns:
            (N, 2) float64, pixels, x right and y down; NaN for points behind the camera.
        """
        return self._pictures.project(camera, points, width, height)

    def set_state(self, state: np.ndarray) -> None:
        """Set the simulation to a row of a data set's ``states``: time, qpos and qvel of this model.

        Raises:
            ShapeError: the row belongs to another arm or task.
            InvalidValueError: a number is NaN or infinite; nothing has moved.
        """
        state = np.asarray(state, dtype=np.float64)
        length = 1 + self.model.nq + self.model.nv
        if state.shape != (length,):
            raise ShapeError(
                f"a state of {self.task.name} with {self.robot.name} has shape {state.shape}, expected ({length},)"
            )
        require_finite("a state", state)
        self.sim.set_state_from_flattened(state)
        self._forward()

    def place_object(self, pose: Pose, name: str | None = None) -> None:
        """Place an object at a pose, at rest.

        Raises:
            InvalidValueError: a number is NaN or infinite; nothing has moved.
        """
        require_finite("a pose", np.append(pose.position, pose.rotation))
        _, address, joint = self._objects[self.task.object(name).name]
        quat = np.empty(4)
        mujoco.mju_mat2Quat(quat, np.asarray(pose.rotation, dtype=np.float64).flatten())
        self.data.qpos[address : address + 7] = np.concatenate([pose.position, quat])
        first = self.model.jnt_dofadr[joint]
        self.data.qvel[first : first + 6] = 0.0
        self._forward()

    def place_eef(
        self,
        pose: Pose,
        opening: float | None = None,
        *,
        arm: int = 0,
        tolerance: float = 1e-3,
        restarts: int = _RESTARTS,
    ) -> float:
        """Place an arm's end-effector site at a pose, at rest, by inverse kinematics.

        The search starts from the present posture, so that a trajectory placed step by step has no jumps, then from the
        home posture and from seeded variations of it.

        Args:
            pose: of the site, world frame.
            opening: gap between the finger pads, metres; unchanged if not given.
            arm: its number.
            tolerance: error below which no further start is tried, metres.
            restarts: number of variations of the home posture to try.

        Returns:
            The remaining error in metres, a radian counted as 0.1 m.
        """
        require_finite("a pose", np.append(pose.position, pose.rotation))
        joints = self.arms[arm].joints
        noise = np.random.default_rng(0).normal(0.0, 0.5, (restarts, len(joints.home)))
        starts = [self.data.qpos[joints.qpos].copy(), joints.home, *(joints.home + noise)]
        error = reach(self.model, self.data, joints, pose, starts, tolerance)
        if opening is not None:
            self.arms[arm].gripper.set_opening(opening)
        self.data.qvel[joints.dofs] = 0.0
        self._forward()
        return error

    def _forward(self) -> None:
        """Update everything after a state was set, controllers included: else they start from the last reset's pose."""
        self.sim.forward()
        for arm in self.arms:
            arm.robot.part_controllers[arm.robot.arms[0]].new_update = True

    def close(self) -> None:
        """Free the OpenGL contexts and the simulation."""
        self._pictures.close()
        self._env.close()

    def __enter__(self) -> "ManipulationEnv":
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


make_env = ManipulationEnv
"""Makes an environment: the class under the name of what calling it does."""

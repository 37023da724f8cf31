"""robosuite's control step run natively: one call into :mod:`ocplanner._core` instead of 25 Python substeps.

:func:`attach` replaces an environment's ``step`` by one with the same results. The operational-space torques and
MuJoCo's substeps run in Rust. What robosuite does once in a control step (scaling the action, the gripper's hidden
state, the robot's histories, the reward) is still robosuite's or is repeated here. An unsupported environment keeps
robosuite's own loop, after one warning.
"""

import warnings
from typing import Any

import numpy as np
from robosuite.controllers.composite.composite_controller import CompositeController
from robosuite.controllers.parts.arm.osc import OperationalSpaceController
from robosuite.controllers.parts.gripper.simple_grip import SimpleGripController
from robosuite.environments.base import MujocoEnv
from robosuite.environments.robot_env import RobotEnv
from robosuite.robots import FixedBaseRobot
from robosuite.utils import transform_utils

from ocplanner import _core
from ocplanner.envs.sampling import advance_observables
from ocplanner.envs.simulator import mujoco
from ocplanner.errors import OcplannerError, ShapeError

_CALLBACKS = ("act_bias", "act_dyn", "act_gain", "contactfilter", "control", "passive", "sensor", "time")


def attach(env: MujocoEnv) -> "NativeControl | None":
    """Make ``env.step`` run natively, with the same results as robosuite's own.

    Args:
        env: a robosuite environment, not wrapped, with one-armed robots under ``OSC_POSE`` in the ``BASIC`` composite
            controller.

    Returns:
        The control loop; None, after a warning with the reason, if ``env`` keeps robosuite's own.
    """
    if isinstance(attached := vars(env).get("step"), _Step):
        return attached.control
    control = NativeControl(env)
    if control.bind() is None:
        return None
    env.step = _Step(control)
    return control


class NativeControl:
    """The native control loop of one environment; it works across soft and hard resets."""

    def __init__(self, env: MujocoEnv) -> None:
        """The loop is bound in the first step."""
        self.env: Any = env
        self._bound: _Binding | None = None
        self._refused: Any = None
        self._warned = False

    def bind(self) -> "_Binding | None":
        """Bind to the present simulation and controllers; None, after one warning, if they are not supported."""
        env, bound = self.env, self._bound
        if bound is not None and bound.holds(env):
            return bound
        composite = env.robots[0].composite_controller
        if composite is not None and self._refused is composite:
            return None
        reason = _unsupported(env)
        if reason is None:
            try:
                self._bound = _Binding(env, bound)
                return self._bound
            except (OcplannerError, AttributeError) as error:
                reason = str(error)
        self._bound, self._refused = None, composite
        if not self._warned:
            message = f"robosuite's own control loop is used: the native one does not support {reason}"
            warnings.warn(message, RuntimeWarning, stacklevel=4)
            self._warned = True
        return None

    def step(self, action: np.ndarray) -> tuple[dict[str, np.ndarray], float, bool, dict[str, Any]]:
        """As ``env.step``, for training loops of others: robosuite's observations and rewards, several times faster.

        Args:
            action: (action_dim,) numbers.

        Returns:
            Observations, reward, done and an empty dictionary.

        Raises:
            ValueError: after the episode's end.
            ShapeError: if the action has another length.
            InvalidValueError: if the action is not finite.
        """
        env, bound = self.env, self.bind()
        if bound is None:
            return type(env).step(env, action)
        self._begin(bound, action)
        advance_observables(env, bound.advance, bound.substeps)
        bound.settle()
        env.cur_time += env.control_timestep
        reward, done, info = env._post_action(action)
        return env._get_observations(), reward, done, info

    def advance(self, action: np.ndarray) -> None:
        """One control step without observations and without a reward.

        Physics, clock, step count and ``env.done`` are as after :meth:`step`. Observables keep their old values until
        ``env._get_observations(force_update=True)``.

        Args:
            action: (action_dim,) numbers.

        Raises:
            ValueError: after the episode's end.
            ShapeError: if the action has another length.
            InvalidValueError: if the action is not finite.
        """
        env, bound = self.env, self.bind()
        if bound is None:
            type(env).step(env, action)
            return
        self._begin(bound, action)
        bound.advance(bound.substeps)
        bound.settle()
        env.cur_time += env.control_timestep
        env.done = env.timestep >= env.horizon and not env.ignore_done

    def _begin(self, bound: "_Binding", action: np.ndarray) -> None:
        env = self.env
        if env.done:
            raise ValueError("executing action in terminated episode")
        action = np.asarray(action, dtype=np.float64)
        if action.shape != (env.action_dim,):
            raise ShapeError(f"action: shape is {action.shape}, expected ({env.action_dim},)")
        bound.begin(action)
        env.timestep += 1


class _Step:
    """``env.step`` once attached."""

    def __init__(self, control: NativeControl) -> None:
        self.control = control

    def __call__(self, action: np.ndarray) -> tuple[dict[str, np.ndarray], float, bool, dict[str, Any]]:
        return self.control.step(action)


class _Binding:
    """The loops over one simulation and the controllers that a reset made; the first arm's loop runs the physics."""

    def __init__(self, env: Any, before: "_Binding | None") -> None:
        self.data = env.sim.data._data
        kept = [] if before is None or before.data is not self.data else [arm.loop for arm in before.arms]
        loops = kept or [None] * len(env.robots)
        self.substeps = int(env.control_timestep / env.model_timestep)
        self.arms = [_ArmBinding(env, robot, loop) for robot, loop in zip(env.robots, loops, strict=True)]
        self.advance = self.arms[0].loop.advance
        if not kept:
            for arm in self.arms[1:]:
                self.arms[0].loop.add(arm.loop)

    def holds(self, env: Any) -> bool:
        """Whether the robots still have the bound controllers."""
        for arm, robot in zip(self.arms, env.robots):
            if arm.composite is not robot.composite_controller or arm.enabled is not robot._enabled_parts:
                return False
        return True

    def begin(self, action: np.ndarray) -> None:
        """The first substep up to the actuators' commands, for each arm's share of the action in turn."""
        start = 0
        for arm in self.arms:
            arm.begin(action[start : start + arm.width])
            start += arm.width

    def settle(self) -> None:
        """Write into robosuite's controllers what they would have measured and computed last."""
        for arm in self.arms:
            arm.settle()


class _ArmBinding:
    """The loop of one arm."""

    def __init__(self, env: Any, robot: Any, loop: "_core.ControlLoop | None") -> None:
        self.robot, self.composite, self.enabled = robot, robot.composite_controller, robot._enabled_parts
        self.data, self.width = env.sim.data._data, robot.action_dim
        self.arm: Any = self.composite.part_controllers["right"]
        self.gripper: Any = self.composite.part_controllers["right_gripper"]
        self.arm_slice = slice(*self.composite._action_split_indexes["right"])
        self.gripper_slice = slice(*self.composite._action_split_indexes["right_gripper"])
        self.wrench = [_sensor(env.sim.model, name) for name in robot.gripper["right"].important_sensors.values()]
        site = env.sim.model.site_name2id
        self.loop = loop or _core.ControlLoop(
            env.sim.model._model,
            self.data,
            eef_site=site(self.arm.ref_name),
            base_site=site(f"{self.arm.naming_prefix}{self.arm.part_name}_center"),
            joint_qpos=[int(index) for index in self.arm.qpos_index],
            joint_qvel=[int(index) for index in self.arm.qvel_index],
            arm_actuators=robot._ref_actuators_indexes_dict["right"],
            gripper_actuators=robot._ref_actuators_indexes_dict["right_gripper"],
            world_frame=self.arm.input_ref_frame == "world",
            uncouple=self.arm.uncoupling,
            lite_physics=env.lite_physics,
        )

    def begin(self, action: np.ndarray) -> None:
        """The first substep up to the actuators' commands, with what robosuite records at that moment."""
        arm, loop = self.arm, self.loop
        command = self._gripper_command(action[self.gripper_slice])
        if not arm.new_update:
            # robosuite's controller has already measured at the reset, and does not measure again.
            velocity, inertia = (
                np.concatenate((arm.ref_pos_vel, arm.ref_ori_vel)),
                np.ascontiguousarray(arm.mass_matrix),
            )
            loop.remember(arm.ref_pos, arm.ref_ori_mat, velocity, arm.J_full, inertia, arm.joint_pos, arm.joint_vel)
        loop.begin(arm.scale_action(action[self.arm_slice]), command, arm.kp, arm.kd, arm.initial_joint)
        arm.goal_pos, arm.goal_ori = loop.goal_position, loop.goal_rotation
        self.settle()
        self._record(action)

    def _gripper_command(self, action: np.ndarray) -> np.ndarray:
        """The command of ``SimpleGripController`` for the control step; advances the gripper's hidden state."""
        gripper = self.gripper
        goal = self.robot.gripper["right"].format_action(action)
        if not gripper.use_action_scaling:
            gripper.goal_qvel = gripper.vels = np.array(goal, dtype=np.float64)
        else:
            gripper.goal_qvel = gripper.scale_action(goal)
            low, high = gripper.actuator_min, gripper.actuator_max
            gripper.vels = 0.5 * (high + low) + 0.5 * (high - low) * gripper.goal_qvel
        gripper.new_update = True
        return gripper.vels

    def settle(self) -> None:
        """Write into robosuite's controller what it would have measured and computed last."""
        arm = self.arm
        position, rotation, velocity, jacobian, inertia, joint_pos, joint_vel = self.loop.measured()
        arm.ref_pos[:], arm.ref_ori_mat[:] = position, rotation
        arm.ref_pos_vel[:], arm.ref_ori_vel[:] = velocity[:3], velocity[3:]
        arm.J_full[:], arm.J_pos[:], arm.J_ori[:] = jacobian, jacobian[:3], jacobian[3:]
        arm.mass_matrix, arm.joint_pos, arm.joint_vel = inertia, joint_pos, joint_vel
        arm.torques, arm.new_update = self.loop.torques, True

    def _record(self, action: np.ndarray) -> None:
        """The robot's histories, as ``FixedBaseRobot.control`` keeps them."""
        robot, arm = self.robot, self.arm
        robot.recent_qpos.push(robot._joint_positions)
        robot.recent_actions.push(action)
        robot.recent_torques.push(robot.torques)
        readings = self.data.sensordata
        robot.recent_ee_forcetorques["right"].push(np.concatenate([readings[sensor] for sensor in self.wrench]))
        quat_xyzw = transform_utils.mat2quat(arm.ref_ori_mat)
        robot.recent_ee_pose["right"].push(np.concatenate((arm.ref_pos, quat_xyzw)))
        velocity = np.concatenate((arm.ref_pos_vel, arm.ref_ori_vel))
        robot.recent_ee_vel["right"].push(velocity)
        history, acceleration = robot.recent_ee_vel_buffer["right"], robot.recent_ee_acc["right"]
        history.push(velocity)
        # The mean of the last acceleration and of nine differences, whose sum is the difference of the ends.
        rise = robot.control_freq * (history.buf[-1] - history.buf[0])
        acceleration.push((acceleration.current + rise) / history.length)


def _sensor(model: Any, name: str) -> slice:
    """The place of a sensor's reading in ``sensordata``."""
    index = model.sensor_name2id(name)
    start = int(np.sum(model.sensor_dim[:index]))
    return slice(start, start + int(model.sensor_dim[index]))


def _unsupported(env: Any) -> str | None:
    """What about ``env`` the native loop does not support, or None."""
    kind = type(env)
    if kind.step is not MujocoEnv.step or kind._pre_action is not RobotEnv._pre_action:
        return f"the control loop of {kind.__name__}"
    if kind._update_observables is not MujocoEnv._update_observables:
        return f"the observables of {kind.__name__}"
    if env.has_renderer or env.viewer is not None:
        return "an on-screen viewer"
    if len(env.robots) > 1 and not env.lite_physics:
        return "several arms with full physics"
    for robot in env.robots:
        if (reason := _unsupported_robot(robot)) is not None:
            return reason
    if any(getattr(mujoco, f"get_mjcb_{name}")() is not None for name in _CALLBACKS):
        return "MuJoCo callbacks"
    return None


def _unsupported_robot(robot: Any) -> str | None:
    """What about a robot the native loop does not support, or None."""
    if type(robot) is not FixedBaseRobot or robot.arms != ["right"]:
        return "anything but fixed robots of one arm"
    composite = robot.composite_controller
    parts = composite.part_controllers
    if type(composite) is not CompositeController or list(parts) != ["right", "right_gripper"]:
        return f"the composite controller {composite.name} with the parts {', '.join(parts)}"
    if not all(robot._enabled_parts.get(part, False) for part in parts):
        return "disabled parts of the robot"
    arm, gripper = parts["right"], parts["right_gripper"]
    if type(arm) is not OperationalSpaceController or not arm.use_ori:
        return f"the arm's controller {arm.name}"
    if arm.impedance_mode != "fixed" or arm.input_type != "delta" or arm._goal_update_mode != "achieved":
        return f"{arm.impedance_mode} impedance with {arm.input_type} actions added to the {arm._goal_update_mode} pose"
    if arm.interpolator_pos is not None or arm.interpolator_ori is not None:
        return "interpolated goals"
    if arm.position_limits is not None or np.any(np.array(arm.orientation_limits, dtype=bool)):
        return "limits on the goal"
    if type(gripper) is not SimpleGripController or gripper.interpolator is not None:
        return f"the gripper's controller {type(gripper).__name__}"
    return None

"""One arm of an environment: its joints, its hand, and the frame of its actions."""

from typing import Any

import numpy as np

from ocplanner.envs.grippers import Gripper
from ocplanner.envs.kinematics import ArmJoints, Reach, site_pose
from ocplanner.envs.robots import RobotSpec
from ocplanner.geometry.pose import Pose


class RobotArm:
    """An arm of an environment, for sensing.

    Args:
        robot: robosuite's robot.
        model: the compiled model.
        data: its state.
        spec: the arm's peculiarities.

    Attributes:
        robot: robosuite's robot.
        joints: the arm's joints.
        reach: where it gets to.
        gripper: its gripper.
    """

    def __init__(self, robot: Any, model: Any, data: Any, spec: RobotSpec) -> None:
        self.robot = robot
        self.joints = ArmJoints.of(robot, model)
        self.gripper = Gripper(robot, model, data, spec)
        self.reach = Reach(model, data, self.joints)
        self._data = data
        self._base_site = model.site(f"{robot.robot_model.naming_prefix}{robot.arms[0]}_center").id

    def eef_pose(self) -> Pose:
        """Pose of the end-effector site, midway between the finger tips."""
        return site_pose(self._data, self.joints.site)

    @property
    def base_rotation(self) -> np.ndarray:
        """(3, 3) rotation, frame of the action's deltas -> world.

        On some arms robosuite attaches this frame to the first moving link, so that it turns with the arm: read it in
        each step.
        """
        return self._data.site_xmat[self._base_site].reshape(3, 3).copy()

    @property
    def gripper_opening(self) -> float:
        """Gap between the finger pads, metres."""
        return self.gripper.opening

"""Square: fit the square nut over the square peg."""

from math import pi

from ocplanner.envs.tasks.task import ObjectSpec, Task, top_grasp

# The middle of the handle, where people hold it; it points along the nut's x axis.
_HANDLE = (0.062, 0.0, 0.0035)

TASK = Task(
    name="Square",
    env_name="NutAssemblySquare",
    objects=(
        ObjectSpec(
            name="SquareNut",
            joint="SquareNut_joint0",
            grasps=(top_grasp("handle", _HANDLE, pi / 2, 0.032), top_grasp("handle-turned", _HANDLE, -pi / 2, 0.032)),
            yaw_fold=4,
        ),
    ),
)

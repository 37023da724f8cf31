"""Stack: put the red cube onto the green one."""

from math import pi

from ocplanner.envs.tasks.task import ObjectSpec, Task, top_grasp

TASK = Task(
    name="Stack",
    env_name="Stack",
    objects=(
        ObjectSpec(
            name="cubeA",
            joint="cubeA_joint0",
            grasps=tuple(
                top_grasp(f"sides-{quarter}", (0.0, 0.0, 0.0), quarter * pi / 2, 0.04) for quarter in range(4)
            ),
            yaw_fold=0,
        ),
    ),
)

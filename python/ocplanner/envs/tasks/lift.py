"""Lift: pick up the cube."""

from math import pi

from ocplanner.envs.tasks.task import ObjectSpec, Task, top_grasp

TASK = Task(
    name="Lift",
    env_name="Lift",
    objects=(
        ObjectSpec(
            name="cube",
            joint="cube_joint0",
            grasps=tuple(
                top_grasp(f"sides-{quarter}", (0.0, 0.0, 0.0), quarter * pi / 2, 0.042) for quarter in range(4)
            ),
            yaw_fold=0,
            let_go=False,
        ),
    ),
)

"""Can: move the can from one bin into its compartment of the other."""

from math import pi

from ocplanner.envs.tasks.task import ObjectSpec, Task, top_grasp

TASK = Task(
    name="Can",
    env_name="PickPlaceCan",
    objects=(
        ObjectSpec(
            name="Can",
            joint="Can_joint0",
            grasps=tuple(top_grasp(f"around-{eighth}", (0.0, 0.0, 0.02), eighth * pi / 4, 0.05) for eighth in range(8)),
            yaw_fold=0,
            round=True,
        ),
    ),
)

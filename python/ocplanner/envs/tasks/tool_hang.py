"""Tool Hang: put the hook frame into its stand, then hang the tool on it."""

from math import pi

import numpy as np

from ocplanner.envs.tasks.task import GraspFrame, ObjectSpec, Task, top_grasp
from ocplanner.geometry.pose import Pose

# The frame lies on its side with its y pointing down, and is held by the grip on its vertical bar.
_GRIP = np.array([0.04375, 0.0, 0.0525])
# Both objects lie to the right of the stand; the hand that inserts the frame is to its left.
_LEFT_OF_THE_STAND, _OVER_THE_OBJECTS = (-0.17, 0.2, 1.07), (-0.2, -0.2, 1.07)


def _grip(name: str, closing: float) -> GraspFrame:
    rotation = np.column_stack([[closing, 0.0, 0.0], [0.0, 0.0, -closing], [0.0, 1.0, 0.0]])
    return GraspFrame(name, Pose(_GRIP, rotation))


TASK = Task(
    name="ToolHang",
    env_name="ToolHang",
    objects=(
        ObjectSpec(
            name="frame",
            joint="frame_joint0",
            grasps=(_grip("grip", 1.0), _grip("grip-turned", -1.0)),
            placing="insert",
            tolerance=(0.003, 0.05),
            lean=0.26,
            withdraw="back",
            way=(_OVER_THE_OBJECTS,),
        ),
        ObjectSpec(
            name="tool",
            joint="tool_joint0",
            grasps=tuple(top_grasp(f"grip-{side}", (0.0, 0.0, 0.0), side * pi / 2) for side in (1, -1)),
            way=(_LEFT_OF_THE_STAND, _OVER_THE_OBJECTS),
            placing="trace",
            tolerance=(0.003, 0.06),
        ),
    ),
    horizon=700,
)

"""Transport: one arm uncovers a hammer and hands it over to the other, which has cleared a bin for it."""

from math import pi

import numpy as np

from ocplanner.envs.tasks.task import GraspFrame, ObjectSpec, Task, top_grasp
from ocplanner.geometry.pose import Pose

_HANDLE = 0.005  # height of the handle's middle above the lid's, m
_GRIPS = (
    ("head", 0.07),
    ("neck", 0.05),
    ("upper", 0.03),
    ("lower", -0.035),
    ("heel", -0.06),
    ("foot", -0.08),
)  # along the hammer, from the middle of its handle, m
_ROOMY = (0.02, 0.3)  # m, rad: bins and table have room
_FAST = 0.03  # m: three objects must be carried in 700 steps
_OVER_THE_BINS = (0.02, -0.37, 1.07)  # of the first hand, world, m: some arms start beside a bin
_OVER_THE_WALLS = 0.19  # m; the bins' walls are 0.15 m high


def _handle(name: str, along: float, up: float, closing: float) -> GraspFrame:
    """A grasp of the hammer, whose z points along the handle to the head and whose y or -y points up."""
    rotation = np.column_stack([[closing, 0.0, 0.0], [0.0, 0.0, up * closing], [0.0, -up, 0.0]])
    return GraspFrame(name, Pose(np.array([0.0, 0.0, along]), rotation))


TASK = Task(
    name="Transport",
    env_name="TwoArmTransport",
    objects=(
        ObjectSpec(
            name="lid",
            joint="transport_start_bin_lid_joint0",
            grasps=tuple(top_grasp(f"handle-{half}", (0.0, 0.0, _HANDLE), half * pi) for half in range(2)),
            yaw_fold=0,
            tolerance=_ROOMY,
            descent=0.02,
            placing="insert",
            way=(_OVER_THE_BINS,),
        ),
        ObjectSpec(
            name="trash",
            joint="trash_joint0",
            grasps=tuple(top_grasp(f"sides-{quarter}", (0.0, 0.0, 0.0), quarter * pi / 2) for quarter in range(4)),
            yaw_fold=0,
            tolerance=_ROOMY,
            descent=_FAST,
            hover=_OVER_THE_WALLS,
            arms=(1,),
        ),
        ObjectSpec(
            name="payload",
            joint="payload_joint0",
            grasps=tuple(
                _handle(f"{end}-{side}-{half}", along, up, closing)
                for end, along in _GRIPS
                for side, up in (("above", 1.0), ("below", -1.0))
                for half, closing in enumerate((1.0, -1.0))
            ),
            yaw_fold=0,
            tolerance=_ROOMY,
            descent=_FAST,
            hover=_OVER_THE_WALLS,
            arms=(0, 1),
            lift=(0.14, -0.02),
            ends=(("heel", "head"), ("neck", "foot")),
        ),
    ),
    horizon=700,
)

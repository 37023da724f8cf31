"""One caller per function or class of ``ocplanner._core``, each with arguments that are mostly right."""

import functools
import json
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
from choices import Choices
from hostile_arguments import NOT_ARRAYS, array, integer, number
from hostile_files import hostile_file

from ocplanner import _core

_MOST_IMAGE_BYTES = 1 << 22


class ViolationError(Exception):
    """A call returned something that it must never return."""


def _require_finite(what: str, *values: np.ndarray | None) -> None:
    for value in values:
        if value is not None and not np.isfinite(value).all():
            raise ViolationError(f"{what} returned numbers that are not finite")


def _rows(
    function: Callable[..., np.ndarray], trailing: tuple[int, ...], *, count: int = 1, copies: bool = False
) -> Callable[[Choices], None]:
    """A caller of a function over rows. A function that only copies numbers may return ones that are not finite."""

    def call(choices: Choices) -> None:
        leading = choices.pick(((), (1,), (4,), (0,), (2, 3)))
        good = np.full((*leading, *trailing), 0.5)
        good[...] = np.eye(3) if trailing == (3, 3) else np.arange(1, 1 + trailing[-1])
        found = function(*(array(choices, good) for _ in range(count)))
        if not copies:
            _require_finite(function.__name__, found)

    return call


def _pose(choices: Choices, leading: tuple[int, ...] = ()) -> Any:
    position = array(choices, np.full((*leading, 3), 0.1))
    rotation = array(choices, np.broadcast_to(np.eye(3), (*leading, 3, 3)).copy())
    if choices.chance(24):
        return choices.pick((None, (position,), [position, rotation], (position, rotation, rotation), "pose", ()))
    return position, rotation


def _law(choices: Choices) -> Any:
    if choices.index(3) < 2:
        return None
    if choices.chance(8):
        return choices.pick(NOT_ARRAYS)
    names = ("gain_position", "gain_rotation", "limit_horizontal", "limit_vertical", "limit_rotation")
    given = {name: number(choices, 0.04) for name in names if choices.chance(3)}
    scales = {name: number(choices, 0.5) for name in ("scale_position", "scale_rotation") if choices.chance(3)}
    return _core.DeltaPoseLaw(**given, **scales)


def _check_action(action: np.ndarray) -> None:
    if not (np.abs(action) <= 1).all():
        raise ViolationError(f"an action is outside [-1, 1]: {action}")


def _delta_pose_action(choices: Choices) -> None:
    leading = choices.pick(((), (2,), (1,), (0,), (2, 3)))
    poses = [_pose(choices, leading) for _ in range(3)]
    base = array(choices, np.broadcast_to(np.eye(3), (*leading, 3, 3)).copy())
    _check_action(_core.delta_pose_action(*poses, base, _law(choices)))


def _delta_pose_controller(choices: Choices) -> None:
    follow = choices.pick(("gated", "time", "open-loop", "", "\ud800", None))
    gates = {name: number(choices, 0.1) for name in ("gate_position", "gate_rotation") if choices.chance(2)}
    controller = _core.DeltaPoseController(follow, **gates)
    for turn in range(choices.index(4)):
        if turn == 0 or choices.chance(3):
            steps = choices.pick((3, 1, 0))
            rotations: Any = np.broadcast_to(np.eye(3), (steps, 3, 3)).copy()
            rotations = None if choices.chance(3) else array(choices, rotations)
            controller.set_plan(array(choices, np.full((steps, 3), 0.2)), rotations, _pose(choices))
        _require_finite("target", *controller.target(_pose(choices)))
        _ = (controller.index, controller.at_end)


def _delta_pose_batch(choices: Choices) -> None:
    count = choices.pick((2, 1, 0))
    follow = choices.pick(("gated", "time", "open-loop", "", "\ud800", None))
    environments: Any = choices.pick((-1, 1 << 40, 1 << 70, None, "2")) if choices.chance(8) else count
    batch = _core.DeltaPoseBatch(environments, follow)
    for turn in range(choices.index(4)):
        if turn == 0 or choices.chance(3):
            steps = choices.pick((3, 1, 0))
            rotations: Any = np.broadcast_to(np.eye(3), (count, steps, 3, 3)).copy()
            rotations = None if choices.chance(3) else array(choices, rotations)
            chosen: Any = None if choices.chance(2) else array(choices, np.ones(count, bool))
            plans = array(choices, np.full((count, steps, 3), 0.2))
            batch.set_plans(plans, rotations, _pose(choices, (count,)), chosen)
        target = batch.targets(_pose(choices, (count,)))
        _require_finite("targets", *target)
        _ = (batch.index, batch.at_end)


@functools.cache
def _engine(variant: int) -> _core.PlannerEngine:
    return _core.PlannerEngine(hostile_file(Choices(bytes([variant]))))


def _images(choices: Choices, engine: _core.PlannerEngine) -> Any:
    config = json.loads(engine.config_json)
    size = config["image_size"]
    batch = choices.pick((1, 2, 0, 17, 40)) if size * size * 3 * 40 < _MOST_IMAGE_BYTES else choices.index(2)
    images = [np.full((batch, size, size, 3), 7, np.uint8) for _ in config["cameras"]]
    if choices.index(3) < 2:
        return images
    hostile: list[Any] = [array(choices, image) for image in images]
    if choices.chance(8):
        return choices.pick((hostile[:-1], [*hostile, *hostile], tuple(hostile), None, hostile[0], {}, "images"))
    return hostile


def _plan(choices: Choices, engine: _core.PlannerEngine) -> None:
    images, threads = _images(choices, engine), integer(choices, 1)
    if choices.chance(4):
        engine.encode(images, threads)
    else:
        steps = integer(choices, 1) if choices.chance(4) else None
        _require_finite("plan", *engine.plan(images, all_modes=choices.chance(2), threads=threads, steps=steps))


def _planner_images(choices: Choices) -> None:
    _plan(choices, _engine(choices.index(4)))


def _planner_file(choices: Choices) -> None:
    storage = choices.pick(("f32", "bf16", "f32", "f16", "", None))
    data: Any = hostile_file(choices)
    if choices.chance(32):
        data = choices.pick((None, "text", bytearray(data), memoryview(data), np.frombuffer(data, np.uint8)))
    _plan(choices, _core.PlannerEngine(data, storage))


def _reward_law(choices: Choices) -> Any:
    if choices.index(3) < 2:
        return _core.RewardLaw()
    names = ("weight_position", "weight_rotation", "scale", "gamma")
    numbers = {name: number(choices, 0.5) for name in names if choices.chance(3)}
    return _core.RewardLaw(choices.pick(("penalty", "literal", "exp", "potential", "", "\ud800", None)), **numbers)


def _object_poses(choices: Choices, steps: int) -> Any:
    poses = _pose(choices, (steps,))
    return (poses[0], None) if isinstance(poses, tuple) and len(poses) == 2 and choices.chance(6) else poses


def _rewards(choices: Choices) -> None:
    steps = choices.pick((3, 1, 0, 20))
    planned, achieved = _object_poses(choices, steps), _object_poses(choices, steps)
    flags = array(choices, np.arange(steps) % 3 > 0)
    _require_finite("rewards", *_reward_law(choices).rewards(planned, achieved, flags, terminal=choices.chance(2)))


_ARM = """
<mujoco><worldbody><site name="base"/>
<body><joint name="first" axis="0 0 1"/><geom size="0.05 0.1" type="capsule"/>
<body pos="0.3 0 0"><joint name="second" axis="0 1 0"/><geom size="0.05 0.1" type="capsule"/>
<site name="eef" pos="0.2 0 0"/></body></body></worldbody>
<actuator><motor joint="first" ctrlrange="-9 9"/><motor joint="second" ctrlrange="-9 9"/></actuator></mujoco>
"""


@functools.cache
def _model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(_ARM)


def _control_loop(choices: Choices) -> None:
    model = _model()
    data = mujoco.MjData(model)
    joints = [0, 1]

    def indices() -> Any:
        if choices.index(12) < 11:
            return joints
        return choices.pick(([0], [], [0, 0], [0, 9], [1 << 60, 0], [-1, 0], [0] * 9, [None], None, "ab", [0.5, 1]))

    if choices.chance(24):
        model, data = choices.pick(((data, model), (None, data), (model, None), (model, "data")))
    loop = _core.ControlLoop(
        model,
        data,
        eef_site=integer(choices, 1) if choices.chance(8) else 1,
        base_site=integer(choices, 0) if choices.chance(8) else 0,
        joint_qpos=indices(),
        joint_qvel=indices(),
        arm_actuators=indices(),
        gripper_actuators=choices.pick(([], [1], [0] * 16, [0] * 17, [2], None)),
        world_frame=choices.chance(2),
        uncouple=choices.chance(2),
        lite_physics=choices.chance(2),
    )
    _ = (loop.goal_position, loop.goal_rotation, loop.torques)
    for _ in range(choices.index(4)):
        match choices.index(4):
            case 0:
                gripper = np.zeros(choices.pick((0, 1, 16)))
                six = [array(choices, np.full(6, value)) for value in (0.01, 150.0, 24.0)]
                loop.begin(six[0], array(choices, gripper), six[1], six[2], array(choices, np.zeros(2)))
            case 1:
                steps = integer(choices, 5)
                loop.advance(min(steps, 20) if type(steps) is int else steps)  # many steps take long, by right
            case 2:
                loop.add(choices.pick((loop, None)))
            case _:
                loop.remember(*(array(choices, value) for value in loop.measured()))
        loop.measured()


def _simd_level(choices: Choices) -> None:
    _core.simd_level()


TARGETS: dict[str, tuple[Callable[[Choices], None], ...]] = {
    "PlannerEngine": (_planner_file, _planner_images),
    "ControlLoop": (_control_loop,),
    "RewardLaw": (_rewards,),
    "DeltaPoseBatch": (_delta_pose_batch,),
    "DeltaPoseController": (_delta_pose_controller,),
    "DeltaPoseLaw": (_law,),
    "delta_pose_action": (_delta_pose_action,),
    "geodesic_angle": (_rows(_core.geodesic_angle, (3, 3), count=2),),
    "quat_wxyz_from_rotation": (_rows(_core.quat_wxyz_from_rotation, (3, 3)),),
    "quat_xyzw_from_rotation": (_rows(_core.quat_xyzw_from_rotation, (3, 3)),),
    "rotation_exp": (_rows(_core.rotation_exp, (3,)),),
    "rotation_from_6d": (_rows(_core.rotation_from_6d, (6,)),),
    "rotation_from_quat_wxyz": (_rows(_core.rotation_from_quat_wxyz, (4,)),),
    "rotation_from_quat_xyzw": (_rows(_core.rotation_from_quat_xyzw, (4,)),),
    "rotation_log": (_rows(_core.rotation_log, (3, 3)),),
    "rotation_to_6d": (_rows(_core.rotation_to_6d, (3, 3), copies=True),),
    "simd_level": (_simd_level,),
}
"""Public name -> its callers. A test checks that no name is missing."""

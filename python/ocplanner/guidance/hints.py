"""From plans to hints: the action that would take the held object where the plan wants it (the paper's section 5)."""

from typing import Literal, get_args

import numpy as np

from ocplanner import _core
from ocplanner.errors import InvalidValueError, UnknownNameError
from ocplanner.planner.planner import Plan

Origin = Literal["object", "plan"]
"""Where a hint starts: at the object's real pose, or at the plan's first step."""
ORIGINS: tuple[str, ...] = get_args(Origin)

HINT_WIDTH = 6
"""Numbers for each planned step: position part (3), rotation part (3)."""


def plan_hints(
    plan: Plan,
    pose_object: tuple[np.ndarray, np.ndarray],
    eef_positions: np.ndarray,
    rotations_world_action: np.ndarray,
    horizon_steps: tuple[int, ...] = (1,),
    law: _core.DeltaPoseLaw | None = None,
    origin: Origin = "object",
) -> np.ndarray:
    """(B, 6 K) float64: for each of K planned steps the normalised delta command from the object's pose to it.

    With the weights x, y and the residual A of a = (x, y) * hint + A, the hint itself is x = y = 1, A = 0: exactly
    :func:`ocplanner._core.delta_pose_action`, gripper apart. The first three of its six numbers move the end effector
    (x weighs them), the other three turn it (y).

    From the ``plan`` it is the command from the plan's first step to k steps after it: what the plan does, without how
    far the object is from where it should be.

    Args:
        plan: made at the same moment, (B, H, ...); without rotations the object keeps its own.
        pose_object: present positions (B, 3) in m and rotations (B, 3, 3), world.
        eef_positions: (B, 3) present positions of the end-effector site, world, metres.
        rotations_world_action: (B, 3, 3), frame of the actions -> world.
        horizon_steps: which planned steps, 1 for the next.
        law: limits and scales; the core's own if not given.
        origin: ``"object"``, the paper's text, or ``"plan"``, its equation read as printed.

    Raises:
        InvalidValueError: a step is beyond the plan, a number is not finite, or a matrix is no rotation.
        ShapeError: wrong shape or dtype.
        UnknownNameError: no such origin.
    """
    check_horizon_steps(horizon_steps, plan.position.shape[1], origin)
    position, rotation = pose_object
    first = 0 if origin == "object" else 1
    if origin == "plan":
        # The hand holds the planned object as it holds the real one.
        grip = np.einsum("bji,bj->bi", rotation, eef_positions - position)
        position, rotation = _step(plan, 0, rotation)
        eef_positions = position + np.einsum("bij,bj->bi", rotation, grip)
    pose_eef = (eef_positions, rotation)  # the law does not ask how the hand is turned
    parts = []
    for k in horizon_steps:
        target = _step(plan, first + k - 1, rotation)
        parts.append(_core.delta_pose_action((position, rotation), target, pose_eef, rotations_world_action, law))
    return np.concatenate(parts, axis=1)


def check_horizon_steps(horizon_steps: tuple[int, ...], horizon: int, origin: Origin) -> None:
    """Check that a plan of ``horizon`` steps reaches so far.

    Raises:
        InvalidValueError: a step is beyond it.
        UnknownNameError: no such origin.
    """
    if origin not in ORIGINS:
        raise UnknownNameError("origin of hints", origin, ORIGINS)
    last = horizon if origin == "object" else horizon - 1
    for k in horizon_steps:
        if not 1 <= k <= last:
            raise InvalidValueError(f"horizon step {k} is outside the plan; choose from 1 to {last}")


def action_law(scale_position: float, scale_rotation: float) -> _core.DeltaPoseLaw:
    """The core's law for actions of which 1 asks for so many metres and radians, with its limits as far as they go."""
    return _core.DeltaPoseLaw(
        limit_horizontal=min(0.05, scale_position),
        limit_vertical=min(0.05, scale_position),
        limit_rotation=min(0.2, scale_rotation),
        scale_position=scale_position,
        scale_rotation=scale_rotation,
    )


def plan_rows(plan: Plan) -> np.ndarray:
    """(B, H, 9) float64, or (B, H, 3) for positions only: position in m, then the rotation's first two columns."""
    if plan.rotation is None:
        return plan.position
    return np.concatenate([plan.position, _core.rotation_to_6d(plan.rotation)], axis=2)


def _step(plan: Plan, index: int, rotation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return plan.position[:, index], rotation if plan.rotation is None else plan.rotation[:, index]

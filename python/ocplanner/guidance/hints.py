"""From plans to hints: the action that would take the held object to a planned pose (the paper's section 5)."""

import numpy as np

from ocplanner import _core
from ocplanner.files.records.labels import ActionScale
from ocplanner.geometry.rotation import rotation_to_6d
from ocplanner.guidance.settings import Origin
from ocplanner.planner.planner import Plan
from ocplanner.settings import require, require_choice

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

    The hint is a = (x, y) * hint + A with x = y = 1 and A = 0, which is :func:`ocplanner._core.delta_pose_action`
    without the gripper. The first three of its six numbers move the end effector (weighted by x), the other three turn
    it (weighted by y).

    With the origin ``plan`` it is the command from the plan's first step to k steps after it: what the plan does,
    regardless of how far the object is from where it should be.

    Args:
        plan: made at the same moment, (B, H, ...); without planned rotations the object keeps its own.
        pose_object: present positions (B, 3) in m and rotations (B, 3, 3), world.
        eef_positions: (B, 3) present positions of the end-effector site, world, metres.
        rotations_world_action: (B, 3, 3), frame of the actions -> world.
        horizon_steps: which planned steps, 1 for the next.
        law: limits and scales; the core's defaults if not given.
        origin: ``"object"``, as the paper's text says, or ``"plan"``, as its equation is printed.

    Raises:
        InvalidValueError: a step is beyond the plan, a number is not finite, or a matrix is no rotation.
        ShapeError: wrong shape or dtype.
        UnknownNameError: no such origin.
    """
    check_horizon_steps(horizon_steps, plan.position.shape[1], origin)
    position, rotation = pose_object
    first = 0 if origin == "object" else 1
    if origin == "plan":
        # Assume that the hand holds the planned object as it holds the real one.
        grip = np.einsum("bji,bj->bi", rotation, eef_positions - position)
        position, rotation = _step(plan, 0, rotation)
        eef_positions = position + np.einsum("bij,bj->bi", rotation, grip)
    pose_eef = (eef_positions, rotation)  # the law ignores how the hand is turned
    parts = []
    for k in horizon_steps:
        target = _step(plan, first + k - 1, rotation)
        parts.append(_core.delta_pose_action((position, rotation), target, pose_eef, rotations_world_action, law))
    return np.concatenate(parts, axis=1)


def check_horizon_steps(horizon_steps: tuple[int, ...], horizon: int, origin: Origin) -> None:
    """Check that a plan of ``horizon`` steps reaches far enough.

    Raises:
        InvalidValueError: a step is beyond it.
        UnknownNameError: no such origin.
    """
    require_choice("origin of hints", origin, Origin)
    last = horizon if origin == "object" else horizon - 1
    for k in horizon_steps:
        require(1 <= k <= last, f"horizon step {k} is outside the plan; choose from 1 to {last}")


def steps_needed(horizon_steps: tuple[int, ...], origin: Origin) -> int:
    """How many steps of a plan the hints read."""
    return max(horizon_steps) + (origin == "plan")


def action_law(scale: ActionScale) -> _core.DeltaPoseLaw:
    """The core's law for actions of this scale, with its limits capped at what an action of 1 asks for."""
    return _core.DeltaPoseLaw(
        limit_horizontal=min(0.05, scale.position),
        limit_vertical=min(0.05, scale.position),
        limit_rotation=min(0.2, scale.rotation),
        scale_position=scale.position,
        scale_rotation=scale.rotation,
    )


def plan_rows(plan: Plan) -> np.ndarray:
    """(B, H, 9) float64, or (B, H, 3) for positions only: position in m, then the rotation's first two columns."""
    if plan.rotation is None:
        return plan.position
    return np.concatenate([plan.position, rotation_to_6d(plan.rotation)], axis=2)


def _step(plan: Plan, index: int, rotation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return plan.position[:, index], rotation if plan.rotation is None else plan.rotation[:, index]

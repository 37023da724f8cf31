"""Hints: exactly the core's command, and in the frame and sign of what people did."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ocplanner import _core
from ocplanner.control.grasp_detection import held_steps
from ocplanner.demos.dataset import Demonstrations
from ocplanner.errors import InvalidValueError, UnknownNameError
from ocplanner.guidance.hints import plan_hints, plan_rows
from ocplanner.planner.planner import Plan

HORIZON = 4


def scene(seed: int, batch: int = 3, spread: float = 0.05):
    rng = np.random.default_rng(seed)
    here = rng.normal(0, 0.3, (batch, 3)), Rotation.random(batch, rng).as_matrix()
    turns = Rotation.from_rotvec(0.3 * rng.standard_normal((batch * HORIZON, 3))).as_matrix()
    plan = Plan(
        here[0][:, None] + rng.normal(0, spread, (batch, HORIZON, 3)),
        np.ascontiguousarray(turns.reshape(batch, HORIZON, 3, 3) @ here[1][:, None]),
        np.ones(batch),
    )
    eef = here[0] + rng.normal(0, 0.05, (batch, 3))
    return plan, here, eef, Rotation.random(batch, rng).as_matrix()


@given(st.integers(0, 10_000), st.sampled_from([(1,), (3,), (1, 4), (2, 1, 3)]))
def test_with_unit_weights_and_no_residual_it_is_the_cores_command(seed, steps):
    plan, here, eef, bases = scene(seed)
    hints = plan_hints(plan, here, eef, bases, steps)
    assert hints.shape == (3, 6 * len(steps))
    x = y = 1.0
    residual = np.zeros(6)
    for row in range(3):
        for place, k in enumerate(steps):
            hint = hints[row, 6 * place : 6 * place + 6]
            action = np.concatenate([x * hint[:3], y * hint[3:]]) + residual
            pose_eef = (eef[row], Rotation.random(None, seed).as_matrix())  # how the hand is turned does not matter
            target = (plan.position[row, k - 1], plan.rotation[row, k - 1])
            expected = _core.delta_pose_action((here[0][row], here[1][row]), target, pose_eef, bases[row])
            np.testing.assert_allclose(action, expected, rtol=0, atol=1e-12)


@given(st.integers(0, 10_000))
def test_from_the_plan_it_does_not_see_where_the_object_is(seed):
    plan, here, eef, bases = scene(seed)
    hints = plan_hints(plan, here, eef, bases, (1, 3), origin="plan")
    moved = (here[0] + 0.3, here[1])
    np.testing.assert_allclose(plan_hints(plan, moved, eef + 0.3, bases, (1, 3), origin="plan"), hints, atol=1e-9)
    there = (plan.position[:, 0].copy(), plan.rotation[:, 0].copy())
    carried = there[0] + np.einsum("bij,bkj,bk->bi", there[1], here[1], eef - here[0])
    np.testing.assert_allclose(plan_hints(plan, there, carried, bases, (2, 4)), hints, atol=1e-9)


def test_a_plan_of_positions_asks_for_no_turn():
    plan, here, eef, bases = scene(0, spread=0.01)
    hints = plan_hints(plan._replace(rotation=None), here, eef, bases)
    np.testing.assert_allclose(hints[:, 3:], 0, atol=1e-12)
    moved = np.einsum("bji,bj->bi", bases, plan.position[:, 0] - here[0]) / 0.05
    np.testing.assert_allclose(hints[:, :3], moved, atol=1e-12)


@pytest.mark.parametrize("step", [0, -1, HORIZON + 1])
def test_steps_outside_the_plan_are_refused(step):
    with pytest.raises(InvalidValueError, match=f"horizon step {step} .* from 1 to 4"):
        plan_hints(*scene(0), (1, step))


def test_from_the_plan_the_last_step_starts_nothing():
    with pytest.raises(InvalidValueError, match=r"horizon step 4 .* from 1 to 3"):
        plan_hints(*scene(0), (4,), origin="plan")
    with pytest.raises(UnknownNameError, match="known: object, plan"):
        plan_hints(*scene(0), origin="hand")


def test_rows_are_position_and_two_columns():
    plan = scene(0)[0]
    rows = plan_rows(plan)
    assert rows.shape == (3, HORIZON, 9)
    np.testing.assert_array_equal(rows[1, 2, :3], plan.position[1, 2])
    np.testing.assert_array_equal(rows[1, 2, 3:], plan.rotation[1, 2][:, :2].T.ravel())
    assert plan_rows(plan._replace(rotation=None)) is plan.position


def recorded(demos: Demonstrations, k: int) -> tuple[np.ndarray, np.ndarray]:
    """Hints toward where the object really was k steps later, and the actions that were recorded, while held."""
    hints, actions = [], []
    for demo in demos:
        positions, rotations = demo.object_poses("SquareNut")
        held = held_steps(positions, rotations, demo.eef_positions, demo.actions[:, -1])
        now = np.flatnonzero(held & (demo.actions[:, -1] > 0))  # not the action that lets go
        later = np.minimum(now[:, None] + np.arange(1, k + 1), len(held) - 1)
        plan = Plan(positions[later], rotations[later], np.ones(len(now)))
        frames = np.tile(np.eye(3), (len(now), 1, 1))
        hints.append(plan_hints(plan, (positions[now], rotations[now]), demo.eef_positions[now], frames, (k,)))
        actions.append(demo.actions[now, :6])
    return np.concatenate(hints), np.concatenate(actions)


def test_hints_are_the_recorded_actions_where_the_recording_is_kinematic(tiny_square):
    # The synthetic hand moves by 0.05 m times the action and keeps its grip.
    hints, actions = recorded(Demonstrations(tiny_square()), 1)
    np.testing.assert_allclose(hints[:, :3], actions[:, :3], atol=1e-6)


def test_hints_have_the_frame_and_sign_of_what_people_did(square_ph):
    with Demonstrations(square_ph) as demos:
        hints, actions = recorded(demos[:20], 5)
    for axis in (0, 1, 2, 5):  # people hardly tilted the nut: no axis to judge by
        assert np.corrcoef(hints[:, axis], actions[:, axis])[0, 1] > 0.8
    weight = np.sum(hints * actions, axis=0) / np.sum(hints**2, axis=0)
    assert np.all((weight[[0, 1, 2, 5]] > 0.75) & (weight[[0, 1, 2, 5]] < 1.25))

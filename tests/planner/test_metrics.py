import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocplanner.geometry.rotation import angles_between
from ocplanner.planner.metrics import fold, plan_errors, yaw_angle


def turn(yaw) -> np.ndarray:
    yaw = np.asarray(yaw, float)
    zero, one = np.zeros_like(yaw), np.ones_like(yaw)
    rows = [np.cos(yaw), -np.sin(yaw), zero, np.sin(yaw), np.cos(yaw), zero, zero, zero, one]
    return np.stack(rows, axis=-1).reshape(*yaw.shape, 3, 3)


@given(st.floats(-3.1, 3.1), st.floats(-3.1, 3.1))
def test_angles_about_the_vertical(a, b):
    difference = (b - a + np.pi) % (2 * np.pi) - np.pi
    assert angles_between(turn(a), turn(b)) == pytest.approx(abs(difference), abs=1e-6)
    assert np.sin(yaw_angle(turn(a), turn(b))) == pytest.approx(np.sin(difference), abs=1e-9)
    assert angles_between(turn(a), turn(b)) == pytest.approx(angles_between(turn(b), turn(a)), abs=1e-12)


@given(st.floats(-20, 20), st.integers(-5, 5))
def test_folding_forgets_whole_periods(angle, turns):
    period = np.pi / 2
    assert fold(np.array(angle + turns * period), period) == pytest.approx(fold(np.array(angle), period), abs=1e-9)
    assert 0 <= fold(np.array(angle), period) <= period / 2 + 1e-12


def test_a_perfect_plan_has_no_error():
    rng = np.random.default_rng(0)
    positions, rotations = rng.normal(size=(30, 5, 3)), turn(rng.normal(size=(30, 5)))
    errors = plan_errors(positions, positions, rotations, rotations, np.arange(30, 0, -1))
    assert {name: value for name, value in errors.as_row().items() if name != "frames" and abs(value) > 1e-9} == {}


def test_known_errors():
    true = np.zeros((40, 4, 3))
    positions = true + np.array([0.003, 0.004, 0.0])
    positions[:, -1] += np.array([0.0, 0.0, 0.1])
    remaining = np.arange(40, 0, -1)
    errors = plan_errors(positions, true, turn(np.full((40, 4), np.pi / 2)), turn(np.zeros((40, 4))), remaining)
    assert errors.frames == 40
    assert errors.fde_mm == pytest.approx(np.hypot(5, 100))
    assert errors.ade_mm == pytest.approx((15 + np.hypot(5, 100)) / 4)
    assert errors.end_fde_xy_mm == pytest.approx(5)
    assert errors.yaw_deg == pytest.approx(90)
    assert errors.yaw90_deg == pytest.approx(0, abs=1e-9)
    assert errors.yaw_wrong_percent == 100


def test_the_end_counts_the_last_frames_only():
    true = np.zeros((40, 2, 3))
    positions = true.copy()
    positions[:20] = 1.0
    errors = plan_errors(positions, true, None, turn(np.zeros((40, 2))), np.arange(40, 0, -1))
    assert errors.end_ade_mm == 0
    assert errors.ade_mm > 0
    assert errors.rotation_deg is None
    assert "yaw_deg" not in errors.as_row()


def test_the_path_error_ignores_timing():
    line = np.column_stack([np.linspace(0, 1, 11), np.zeros(11), np.zeros(11)])[None]
    late = line[:, [0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 5]]
    errors = plan_errors(late, line, None, turn(np.zeros((1, 11))), np.array([1]))
    assert errors.path_mm == 0
    assert errors.ade_mm > 100

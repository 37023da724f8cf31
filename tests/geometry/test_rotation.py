"""Axioms of rotations and of their other forms; tests/core/test_pose.py compares the core with scipy."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ocplanner.geometry.rotation import (
    angle_between,
    angles_between,
    mean_rotation,
    quat_wxyz_from_rotation,
    quat_xyzw_from_rotation,
    rotation_exp,
    rotation_from_6d,
    rotation_from_quat_wxyz,
    rotation_from_quat_xyzw,
    rotation_log,
    rotation_to_6d,
    yaw_rotation,
)

vectors = st.lists(st.floats(-1.7, 1.7), min_size=3, max_size=3).map(np.array)
rotations = vectors.map(lambda vector: Rotation.from_rotvec(vector).as_matrix())


@given(vectors)
def test_the_exponential_is_a_rotation_and_the_logarithm_undoes_it(vector):
    rotation = rotation_exp(vector)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    np.testing.assert_allclose(rotation_log(rotation), vector, atol=1e-8)
    np.testing.assert_allclose(rotation_exp(-vector), rotation.T, atol=1e-12)


@given(rotations)
def test_every_form_gives_the_rotation_back(rotation):
    np.testing.assert_allclose(rotation_from_6d(rotation_to_6d(rotation)), rotation, atol=1e-12)
    np.testing.assert_allclose(rotation_from_quat_xyzw(quat_xyzw_from_rotation(rotation)), rotation, atol=1e-12)
    np.testing.assert_allclose(rotation_from_quat_wxyz(quat_wxyz_from_rotation(rotation)), rotation, atol=1e-12)


@given(rotations)
def test_a_quaternion_and_its_negative_are_the_same_rotation(rotation):
    quat = quat_xyzw_from_rotation(rotation)
    np.testing.assert_array_equal(rotation_from_quat_xyzw(-quat), rotation_from_quat_xyzw(quat))
    np.testing.assert_array_equal(quat_wxyz_from_rotation(rotation), quat[[3, 0, 1, 2]])


@given(rotations, rotations, rotations)
def test_the_angle_is_a_distance_that_no_turn_changes(a, b, c):
    assert angle_between(a, a) == pytest.approx(0.0, abs=1e-7)
    assert angle_between(a, b) == pytest.approx(angle_between(b, a), abs=1e-7)
    assert angle_between(a, c) <= angle_between(a, b) + angle_between(b, c) + 1e-7
    assert angle_between(c @ a, c @ b) == pytest.approx(angle_between(a, b), abs=1e-6)
    expected = (Rotation.from_matrix(a) * Rotation.from_matrix(b).inv()).magnitude()
    assert angle_between(a, b) == pytest.approx(expected, abs=1e-6)


@given(st.floats(-3, 3), st.floats(-3, 3))
def test_yaws_add_up(a, b):
    np.testing.assert_allclose(yaw_rotation(a) @ yaw_rotation(b), yaw_rotation(a + b), atol=1e-12)
    np.testing.assert_allclose(rotation_exp(np.array([0.0, 0.0, a])), yaw_rotation(a), atol=1e-12)


@given(rotations, rotations)
def test_the_mean_is_a_rotation_that_turns_with_its_members(a, b):
    mean = mean_rotation(np.array([a, a, a @ yaw_rotation(0.4)]))
    np.testing.assert_allclose(mean @ mean.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(mean) == pytest.approx(1.0)
    assert 0 < angle_between(mean, a) < 0.2
    turned = mean_rotation(np.array([b @ a, b @ a, b @ a @ yaw_rotation(0.4)]))
    np.testing.assert_allclose(turned, b @ mean, atol=1e-9)


def test_mean_of_two_yaws():
    assert mean_rotation(np.array([yaw_rotation(0.2), yaw_rotation(0.6)])) == pytest.approx(yaw_rotation(0.4))


def test_angles_are_exact_near_zero_and_for_any_leading_axes():
    turns = np.array([[1e-9, 0.1], [1.0, np.pi]])
    turned = np.array([[yaw_rotation(turn) for turn in row] for row in turns])
    angles = angles_between(np.broadcast_to(np.eye(3), turned.shape), turned)
    np.testing.assert_allclose(angles, turns, rtol=1e-7)

"""Poses form a group."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from ocplanner.geometry.pose import Pose
from ocplanner.geometry.rotation import rotation_exp

numbers = st.lists(st.floats(-2, 2), min_size=6, max_size=6)
poses = numbers.map(lambda x: Pose(np.array(x[:3]), rotation_exp(np.array(x[3:]))))
IDENTITY = Pose(np.zeros(3), np.eye(3))


def assert_close(a: Pose, b: Pose) -> None:
    np.testing.assert_allclose(a.position, b.position, atol=1e-9)
    np.testing.assert_allclose(a.rotation, b.rotation, atol=1e-9)


@given(poses, poses, poses)
def test_poses_form_a_group(a, b, c):
    assert_close((a @ b) @ c, a @ (b @ c))
    assert_close(a @ IDENTITY, a)
    assert_close(IDENTITY @ a, a)
    assert_close(a @ a.inverse(), IDENTITY)
    assert_close(a.inverse() @ a, IDENTITY)
    assert_close((a @ b).inverse(), b.inverse() @ a.inverse())


@given(poses, st.floats(-1, 1))
def test_a_raised_pose_moves_along_the_worlds_vertical_and_leaves_the_other_as_it_was(pose, height):
    before = pose.position.copy()
    raised = pose.raised(height)
    np.testing.assert_allclose(raised.position - before, [0.0, 0.0, height], atol=1e-12)
    assert raised.rotation is pose.rotation
    np.testing.assert_array_equal(pose.position, before)

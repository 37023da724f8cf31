import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ocplanner.geometry.rotation import angle_between, mean_rotation, yaw_rotation
from ocplanner.geometry.symmetry import nearest_equivalent

vectors = st.lists(st.floats(-3, 3), min_size=3, max_size=3)


@given(vectors, vectors, st.sampled_from([1, 2, 4, 0]))
def test_no_equivalent_is_nearer(a, b, fold):
    rotation, reference = Rotation.from_rotvec(a).as_matrix(), Rotation.from_rotvec(b).as_matrix()
    chosen = nearest_equivalent(rotation, reference, fold)
    turns = np.linspace(0, 2 * np.pi, 73) if fold == 0 else 2 * np.pi * np.arange(fold) / fold
    best = min(angle_between(rotation @ yaw_rotation(turn), reference) for turn in turns)
    assert angle_between(chosen, reference) <= best + 1e-6
    assert np.allclose(chosen[:, 2], rotation[:, 2])  # only turned about its own z


def test_half_a_turn_too_far_is_mended():
    now = yaw_rotation(0.3)
    assert nearest_equivalent(yaw_rotation(0.35 + np.pi), now, 4) == pytest.approx(yaw_rotation(0.35))


@given(vectors, vectors)
def test_angle(a, b):
    first, second = Rotation.from_rotvec(a), Rotation.from_rotvec(b)
    expected = (first * second.inv()).magnitude()
    assert angle_between(first.as_matrix(), second.as_matrix()) == pytest.approx(expected, abs=1e-6)


def test_mean_of_two_yaws():
    assert mean_rotation(np.array([yaw_rotation(0.2), yaw_rotation(0.6)])) == pytest.approx(yaw_rotation(0.4))

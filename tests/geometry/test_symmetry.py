import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ocplanner.geometry.rotation import angle_between, yaw_rotation
from ocplanner.geometry.symmetry import equivalents, nearest_equivalent

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


@given(vectors, vectors, st.sampled_from([1, 2, 4, 0]))
def test_equivalents_begin_with_the_nearest_and_serve_alike(a, b, fold):
    rotation, reference = Rotation.from_rotvec(a).as_matrix(), Rotation.from_rotvec(b).as_matrix()
    found = equivalents(rotation, reference, fold)
    assert len(found) == (fold or 8)
    np.testing.assert_allclose(found[0], nearest_equivalent(rotation, reference, fold), atol=1e-6)
    distances = [angle_between(other, reference) for other in found]
    assert distances == sorted(distances)
    for other in found:
        np.testing.assert_allclose(other[:, 2], rotation[:, 2], atol=1e-12)

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from ocplanner import _core
from ocplanner.errors import InvalidValueError, ShapeError

seeds = st.integers(0, 2**31)


def rotations(seed: int, *shape: int) -> np.ndarray:
    count = int(np.prod(shape))
    return Rotation.random(count, random_state=seed).as_matrix().reshape(*shape, 3, 3)


@given(seed=seeds)
def test_agrees_with_scipy(seed: int) -> None:
    a, b = rotations(seed, 5), rotations(seed + 1, 5)
    scipy_a = Rotation.from_matrix(a)
    quat = scipy_a.as_quat()
    np.testing.assert_allclose(_core.rotation_from_quat_xyzw(quat), a, atol=1e-12)
    np.testing.assert_allclose(_core.rotation_from_quat_wxyz(quat[:, [3, 0, 1, 2]].copy()), a, atol=1e-12)
    canonical = quat * np.where(quat[:, 3:] < 0, -1, 1)
    np.testing.assert_allclose(_core.quat_xyzw_from_rotation(a), canonical, atol=1e-12)
    np.testing.assert_allclose(_core.quat_wxyz_from_rotation(a), canonical[:, [3, 0, 1, 2]], atol=1e-12)
    np.testing.assert_allclose(_core.rotation_log(a), scipy_a.as_rotvec(), atol=1e-9)
    np.testing.assert_allclose(_core.rotation_exp(scipy_a.as_rotvec()), a, atol=1e-9)
    angle = (scipy_a.inv() * Rotation.from_matrix(b)).magnitude()
    np.testing.assert_allclose(_core.geodesic_angle(a, b), angle, atol=1e-9)


def numpy_rotation_from_quat_xyzw(quat_xyzw: np.ndarray) -> np.ndarray:
    """The formula that planners were trained with, one rounding an operation."""
    x, y, z, w = np.moveaxis(quat_xyzw / np.linalg.norm(quat_xyzw, axis=-1, keepdims=True), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


@given(arrays(np.float64, (50, 4), elements=st.floats(-10, 10)))
def test_quaternions_round_as_in_numpy(quat: np.ndarray) -> None:
    quat = quat[np.linalg.norm(quat, axis=-1) > 1e-6]
    expected = numpy_rotation_from_quat_xyzw(quat)
    np.testing.assert_array_equal(_core.rotation_from_quat_xyzw(quat), expected)
    np.testing.assert_array_equal(_core.rotation_from_quat_wxyz(quat[:, [3, 0, 1, 2]].copy()), expected)


def test_recorded_quaternions_round_as_in_numpy() -> None:
    rng = np.random.default_rng(0)
    recorded = rng.normal(size=(100_000, 4))
    recorded /= np.linalg.norm(recorded, axis=-1, keepdims=True)
    for quat in (recorded, recorded.astype(np.float32).astype(np.float64)):
        np.testing.assert_array_equal(_core.rotation_from_quat_xyzw(quat), numpy_rotation_from_quat_xyzw(quat))


@pytest.mark.parametrize("component", [0.0, np.nan, np.inf, -np.inf])
def test_quaternions_without_a_direction_are_errors(component: float) -> None:
    with pytest.raises(InvalidValueError, match=r"quaternion .*finite numbers that are not all zero"):
        _core.rotation_from_quat_xyzw(np.full((3, 4), component))


@given(arrays(np.float64, (4, 6), elements=st.floats(allow_nan=True, allow_infinity=True)))
def test_six_numbers_give_a_rotation_or_an_error(rot6d: np.ndarray) -> None:
    try:
        found = _core.rotation_from_6d(rot6d)
    except InvalidValueError:
        return
    identity = np.broadcast_to(np.eye(3), (4, 3, 3))
    np.testing.assert_allclose(found.transpose(0, 2, 1) @ found, identity, atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(found), 1.0, atol=1e-12)


def test_columns_are_the_first_two() -> None:
    rotation = rotations(0, 2, 3)
    rot6d = _core.rotation_to_6d(rotation)
    np.testing.assert_array_equal(rot6d[..., :3], rotation[..., 0])
    np.testing.assert_array_equal(rot6d[..., 3:], rotation[..., 1])
    np.testing.assert_allclose(_core.rotation_from_6d(rot6d), rotation, atol=1e-14)


@pytest.mark.parametrize("leading", [(), (0,), (1,), (2, 3)])
def test_any_leading_shape(leading: tuple[int, ...]) -> None:
    rotation = np.broadcast_to(np.eye(3), (*leading, 3, 3)).copy()
    assert _core.rotation_log(rotation).shape == (*leading, 3)
    assert _core.rotation_to_6d(rotation).shape == (*leading, 6)
    assert _core.quat_xyzw_from_rotation(rotation).shape == (*leading, 4)
    assert _core.geodesic_angle(rotation, rotation).shape == leading


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (np.zeros((2, 5)), r"rot6d: expected a C-contiguous \(..., 6\) array of float64, found shape \[2, 5\]"),
        (np.zeros(()), r"found shape \[\]"),
        (np.zeros((2, 6), np.float32), "found dtype float32"),
        (np.zeros((2, 6), ">f8"), "byte-swapped"),
        (np.ones((6, 6)).T[::2], "memory order"),
        (np.asfortranarray(np.ones((2, 6))), "memory order"),
        (np.array([None] * 6), "found dtype object"),
        ([1.0] * 6, "found list"),
    ],
)
def test_misread_arrays_are_errors(array, message: str) -> None:
    with pytest.raises(ShapeError, match=message):
        _core.rotation_from_6d(array)


def test_bad_numbers_are_errors() -> None:
    with pytest.raises(InvalidValueError, match="6-D rotation"):
        _core.rotation_from_6d(np.zeros(6))
    with pytest.raises(InvalidValueError, match="quaternion"):
        _core.rotation_from_quat_xyzw(np.zeros(4))
    with pytest.raises(InvalidValueError, match="expected a rotation matrix"):
        _core.rotation_log(np.full((3, 3), np.nan))
    with pytest.raises(InvalidValueError, match=r"rotation vector: found .* expected finite numbers"):
        _core.rotation_exp(np.array([np.inf, 0, 0]))
    with pytest.raises(ShapeError, match="differ"):
        _core.geodesic_angle(np.eye(3), np.eye(3)[None])

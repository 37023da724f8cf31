import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ocplanner import _core
from ocplanner.errors import InvalidValueError, ShapeError
from ocplanner.geometry.pose import Pose

numbers = st.lists(st.floats(-2, 2), min_size=6, max_size=6)
poses = numbers.map(lambda x: Pose(np.array(x[:3]), Rotation.from_rotvec(x[3:]).as_matrix()))


@given(poses, poses, poses, st.floats(0.1, 5))
def test_limits(held, target, eef, gain):
    law = _core.DeltaPoseLaw(gain_position=gain, gain_rotation=gain)
    action = _core.delta_pose_action(held, target, eef, np.eye(3), law)
    assert np.abs(action).max() <= 1
    assert np.linalg.norm(action[3:]) * 0.5 <= 0.2 + 1e-9


@given(st.lists(st.tuples(poses, poses, poses), min_size=1, max_size=4))
def test_batch_equals_one_by_one(rows):
    batch = [
        Pose(np.stack([p.position for p in column]), np.stack([p.rotation for p in column])) for column in zip(*rows)
    ]
    bases = np.tile(np.eye(3), (len(rows), 1, 1))
    expected = [_core.delta_pose_action(*row, np.eye(3)) for row in rows]
    assert np.array_equal(_core.delta_pose_action(*batch, bases), expected)


@pytest.mark.parametrize("leading", [(), (0,), (1,), (2, 3)])
def test_any_leading_shape(leading):
    here = (np.zeros((*leading, 3)), np.broadcast_to(np.eye(3), (*leading, 3, 3)))
    assert _core.delta_pose_action(here, here, here, here[1]).shape == (*leading, 6)


def test_any_memory_order():
    turned = Rotation.from_euler("xyz", [0.1, 0.2, 0.3]).as_matrix()
    here, there = (np.zeros(3), np.eye(3)), (np.arange(6.0)[::2] / 100, turned.T.copy())
    strided = (np.arange(6.0)[::2] / 100, turned.T)
    assert np.array_equal(
        _core.delta_pose_action(here, strided, here, turned.T),
        _core.delta_pose_action(here, there, here, turned.T.copy()),
    )


def test_the_base_turns_the_command():
    here = Pose(np.zeros(3), np.eye(3))
    there = Pose(np.array([0.02, 0.0, 0.0]), np.eye(3))
    base = Rotation.from_euler("z", 90, degrees=True).as_matrix()
    assert _core.delta_pose_action(here, there, here, base) == pytest.approx([0, -0.4, 0, 0, 0, 0])


@pytest.mark.parametrize("follow", ["open-loop", "time", "gated"])
def test_controller_walks_a_plan(follow):
    line = np.array([[0.01 * step, 0.0, 1.0] for step in range(1, 21)])
    controller = _core.DeltaPoseController(follow)
    here = np.array([0.0, 0.0, 1.0])
    controller.set_plan(line, np.tile(np.eye(3), (20, 1, 1)), (here, np.eye(3)))
    for _ in range(30):
        position, _ = controller.target((here, np.eye(3)))
        here = here + 0.5 * (position - here) if follow != "open-loop" else position
    assert controller.at_end
    assert here[0] == pytest.approx(0.19 if follow == "open-loop" else 0.2, abs=0.002)


def test_bad_input():
    good = (np.zeros(3), np.eye(3))
    with pytest.raises(InvalidValueError, match="rotation"):
        _core.delta_pose_action(good, (np.zeros(3), 2 * np.eye(3)), good, np.eye(3))
    with pytest.raises(InvalidValueError, match="finite"):
        _core.delta_pose_action((np.full(3, np.nan), np.eye(3)), good, good, np.eye(3))
    for bad in [
        (np.zeros(4), np.eye(3)),
        (np.zeros(3), np.eye(4)),
        (np.zeros(3, np.float32), np.eye(3)),
        (np.zeros((1, 3)), np.eye(3)[None]),
        (np.zeros((1, 3)), np.eye(3)),
        ([0, 0, 0], np.eye(3)),
    ]:
        with pytest.raises(ShapeError, match="eef"):
            _core.delta_pose_action(good, good, bad, np.eye(3))
    huge = np.broadcast_to(np.zeros(3), (1 << 40, 3)), np.broadcast_to(np.eye(3), (1 << 40, 3, 3))
    with pytest.raises(ShapeError, match=r"object.*ascontiguousarray"):
        _core.delta_pose_action(huge, huge, huge, huge[1])
    with pytest.raises(ShapeError, match="rotation_world_base"):
        _core.delta_pose_action(good, good, good, np.eye(3)[None])
    with pytest.raises(ShapeError, match="object"):
        _core.DeltaPoseController().target((np.zeros((1, 3)), np.eye(3)[None]))
    with pytest.raises(ShapeError, match="plan"):
        _core.DeltaPoseController().set_plan(np.zeros((2, 4, 3)), None, good)
    with pytest.raises(ShapeError, match="plan"):
        _core.DeltaPoseController().set_plan(np.zeros((0, 3)), None, good)
    with pytest.raises(ShapeError, match="plan"):
        _core.DeltaPoseController().set_plan(np.zeros((2, 3)), np.tile(np.eye(3), (3, 1, 1)), good)
    with pytest.raises(InvalidValueError, match="follow"):
        _core.DeltaPoseController("blind")
    with pytest.raises(InvalidValueError, match="gain_position"):
        _core.DeltaPoseLaw(gain_position=0.0)
    with pytest.raises(InvalidValueError, match="plan"):
        _core.DeltaPoseController().target(good)

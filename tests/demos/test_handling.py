import numpy as np
import pytest

from ocplanner.demos.collect import collect
from ocplanner.demos.dataset import Demonstrations
from ocplanner.demos.handling import NOBODY, Handling, handlings
from ocplanner.demos.segments import Segment
from ocplanner.envs.tasks import task
from ocplanner.errors import DatasetError


@pytest.fixture(scope="module")
def transport(tmp_path_factory):
    return collect(tmp_path_factory.mktemp("collect") / "transport.hdf5", "Transport", episodes=1).path


def test_two_arms_are_recorded_as_robomimic_has_them(transport):
    with Demonstrations(transport) as demos:
        assert demos.robots == ("Panda", "Panda")
        assert demos.env_args["env_name"] == "TwoArmTransport"
        demo = demos[0]
        assert demo.rewards[-1] == 1.0
        assert demo.actions.shape == (demo.length, 14)
        for arm in range(2):
            for name, width in (("eef_pos", 3), ("eef_quat", 4), ("gripper_qpos", 2)):
                assert demo.observation(f"robot{arm}_{name}").shape == (demo.length, width)
        vector = demo.observation("object")
        assert vector.shape == (demo.length, 41)
        np.testing.assert_allclose(vector[:, :3], demo.object_poses("payload")[0], atol=1e-9)


def test_each_object_is_handled_by_its_arms(transport):
    with Demonstrations(transport) as demos:
        lid, trash, payload = handlings(demos[0], task("Transport"))
    assert [found.name for found in (lid, trash, payload)] == ["lid", "trash", "payload"]
    assert (lid.arms, trash.arms, payload.arms) == ((0,), (1,), (0, 1))
    assert lid.segment.stop <= trash.segment.start < trash.segment.stop <= payload.segment.start
    for found in (lid, trash, payload):
        held = np.flatnonzero(found.holder != NOBODY)
        assert abs(held[0] - found.segment.onset) < 10
        assert abs(held[-1] - found.segment.release) < 10


def test_arms_are_named_in_the_order_in_which_they_held():
    def arms(*holder):
        return Handling("cube", Segment(0, 1, 0, 0), np.array(holder)).arms

    assert arms(-1, -1) == ()
    assert arms(-1, 1, 1, -1, 1, 0, -1) == (1, 0)


def test_grippers_are_told_together(transport):
    with Demonstrations(transport) as demos:
        demo = demos[0]
        first, second = demo.gripper_actions(), demo.gripper_actions((1,))
        np.testing.assert_array_equal(first, demo.actions[:, 6])
        np.testing.assert_array_equal(demo.gripper_actions((0, 1)), np.maximum(first, second))
        assert np.any((first > 0) & (second > 0))  # the hammer in both hands
        with pytest.raises(DatasetError, match="arm 2 is asked for"):
            demo.gripper_actions((0, 2))

import shutil

import h5py
import pytest

from ocplanner.demos.dataset import Demonstrations
from ocplanner.demos.segments import manipulation_segment
from ocplanner.errors import DatasetError


@pytest.mark.parametrize(
    ("env_name", "part", "kept"),
    [
        ("ToolHang", "frame", (6, 41)),  # it does not fall after the release
        ("ToolHang", "tool", (56, 91)),  # led through each pose: what follows the release is a fall
        ("TwoArmTransport", "payload:0", (106, 141)),  # ends when it is held still for the second arm
        ("TwoArmTransport", "payload:1", (156, 191)),
        ("TwoArmTransport", "payload", (106, 191)),
    ],
)
def test_the_kept_steps_are_those_of_the_tasks_own_rule(carried_objects, env_name, part, kept):
    with Demonstrations(carried_objects(env_name)) as demos:
        segment = demos[0].manipulation(part)
        assert (segment.start, segment.stop) == kept


def test_the_default_rule_keeps_other_steps(carried_objects):
    with Demonstrations(carried_objects("TwoArmTransport")) as demos:
        demo = demos[0]
        by_default = manipulation_segment(*demo.object_poses("payload:0"), demo.carrier_actions("payload:0"))
        assert by_default.stop > demo.manipulation("payload:0").stop


def test_the_tasks_first_object_is_meant_if_none_is_named(tiny_square):
    with Demonstrations(tiny_square()) as demos:
        assert demos[0].manipulation() == demos[0].manipulation("SquareNut")


def test_an_unknown_part_has_an_error(carried_objects):
    with Demonstrations(carried_objects("ToolHang")) as demos, pytest.raises(DatasetError, match="no pose of nut"):
        demos[0].manipulation("nut")


@pytest.mark.parametrize("key", ["actions", "states", "obs/object", "obs/agentview_image", "attribute", "added"])
def test_the_digest_changes_with_what_is_stored(tiny_square, tmp_path, key):
    path = shutil.copy(tiny_square("1.5.1", images=True), tmp_path / "copy.hdf5")
    with Demonstrations(path) as demos:
        before = [demo.digest() for demo in demos]
    assert len({*before}) == len(before)
    with h5py.File(path, "r+") as file:
        demo = file["data/demo_0"]
        if key == "attribute":
            demo.attrs["model_file"] = "<mujoco/>"
        elif key == "added":
            demo["notes"] = ["left", "right"]
        else:
            demo[key][-1] = 1 - demo[key][-1]
    with Demonstrations(path) as demos:
        after = [demo.digest() for demo in demos]
    assert [a == b for a, b in zip(after, before)] == [False, True, True, True]

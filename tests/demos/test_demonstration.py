import pytest

from ocplanner.demos.dataset import Demonstrations
from ocplanner.demos.segments import manipulation_segment
from ocplanner.errors import DatasetError


@pytest.mark.parametrize(
    ("env_name", "part", "kept"),
    [
        ("ToolHang", "frame", (6, 46)),  # five steps after the release, as by default
        ("ToolHang", "tool", (56, 91)),  # led through each pose: what follows the release is a fall
        ("TwoArmTransport", "payload:0", (106, 145)),  # ends when it is held still for the second arm
        ("TwoArmTransport", "payload:1", (156, 196)),
        ("TwoArmTransport", "payload", (106, 196)),
    ],
)
def test_the_kept_steps_are_those_of_the_tasks_own_rule(carried_objects, env_name, part, kept):
    with Demonstrations(carried_objects(env_name)) as demos:
        segment = demos[0].manipulation(part)
        assert (segment.start, segment.stop) == kept


def test_the_default_rule_keeps_other_steps(carried_objects):
    for env_name, part in (("ToolHang", "tool"), ("TwoArmTransport", "payload:0")):
        with Demonstrations(carried_objects(env_name)) as demos:
            demo = demos[0]
            by_default = manipulation_segment(*demo.object_poses(part), demo.carrier_actions(part))
            assert by_default.stop > demo.manipulation(part).stop


def test_the_tasks_first_object_is_meant_if_none_is_named(tiny_square):
    with Demonstrations(tiny_square()) as demos:
        assert demos[0].manipulation() == demos[0].manipulation("SquareNut")


def test_an_unknown_part_has_an_error(carried_objects):
    with Demonstrations(carried_objects("ToolHang")) as demos, pytest.raises(DatasetError, match="no pose of nut"):
        demos[0].manipulation("nut")

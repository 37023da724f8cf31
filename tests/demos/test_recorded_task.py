import numpy as np

from ocplanner.demos.recorded_task import carriers, object_of, part_gripper, recorded_task, segment_rule
from ocplanner.demos.segments import DEFAULT_RULE


def test_an_environment_without_a_layout_is_known_by_its_task():
    assert recorded_task("ToolHang") == ("ToolHang", ("frame", "tool"), ("frame", "tool"))
    assert recorded_task("NutAssemblyRound") == ("Round", ("RoundNut",), ("RoundNut",))
    assert recorded_task("Wipe") is None


def test_nothing_after_the_release_is_kept_of_an_object_that_is_led_along_its_plan():
    assert segment_rule("ToolHang", "tool").fall == 0
    assert segment_rule("ToolHang", "frame") == segment_rule("Wipe", "cube") == DEFAULT_RULE


def test_an_object_that_is_handed_over_has_a_part_for_each_arm():
    found = recorded_task("TwoArmTransport")
    assert found.objects == ("lid", "trash", "payload")
    assert found.parts == ("lid", "trash", "payload:0", "payload:1")
    assert [object_of(part) for part in found.parts] == ["lid", "trash", "payload", "payload"]
    assert [carriers("TwoArmTransport", part) for part in found.parts] == [(0,), (1,), (0,), (1,)]
    assert carriers("TwoArmTransport", "payload") == (0, 1)
    assert [segment_rule("TwoArmTransport", part).at_rest for part in found.parts] == [False, False, True, False]


def test_what_happens_between_two_hands_is_neither_arms_part():
    giver = np.array([-1, 1, 1, 1, 1, 1, 1, -1, -1, -1])
    taker = np.array([-1, -1, -1, -1, -1, 1, 1, 1, 1, -1])
    both = np.column_stack([giver, taker]).astype(float)
    assert part_gripper(both, "TwoArmTransport", "payload:0").tolist() == [-1, 1, 1, 1, 1, -1, -1, -1, -1, -1]
    assert part_gripper(both, "TwoArmTransport", "payload:1").tolist() == [-1] * 7 + [1, 1, -1]
    assert part_gripper(both, "TwoArmTransport", "payload").tolist() == [-1] + [1] * 8 + [-1]
    assert part_gripper(both, "TwoArmTransport", "lid").tolist() == giver.tolist()

from ocplanner.demos.recorded_task import recorded_task, segment_rule
from ocplanner.demos.segments import DEFAULT_RULE


def test_an_environment_without_a_layout_is_known_by_its_task():
    assert recorded_task("ToolHang") == ("ToolHang", ("frame", "tool"))
    assert recorded_task("NutAssemblyRound") == ("Round", ("RoundNut",))
    assert recorded_task("Wipe") is None


def test_nothing_after_the_release_is_kept_of_an_object_that_is_led_along_its_plan():
    assert segment_rule("ToolHang", "tool").after == 0
    assert segment_rule("ToolHang", "frame") == segment_rule("Wipe", "cube") == DEFAULT_RULE

from ocplanner.report.results import failure_classes, group_results
from ocplanner.zero_shot.result import FAILURES, read_results


def test_planners_of_one_setting_form_a_group(write_result):
    paths = [
        write_result("a", successes=2, failures=("slip", "slip")),
        write_result("other", robot="UR5e"),
        write_result("b", successes=4, failures=()),
    ]
    groups = group_results(record for path in paths for record in read_results(path))
    assert [group.title for group in groups] == ["Square on Sawyer (gated, masked)", "Square on UR5e (gated, masked)"]
    assert groups[0].mean_rate == 0.75
    assert groups[0].failures == {"slip": 2}


def test_the_interval_of_several_planners_knows_that_they_differ(write_result):
    """One planner succeeds always, the other never: the episodes together would say 50 %, within 5 points."""
    good = write_result("good", successes=200, failures=())
    bad = write_result("bad", successes=0, failures=("slip",) * 200, planner_sha256="cd" * 32)
    (group,) = group_results(record for path in (good, bad) for record in read_results(path))
    assert group.mean_rate == 0.5
    assert group.interval == (0.0, 1.0)


def test_the_interval_of_one_planner_is_that_of_its_file(write_result):
    (group,) = group_results(read_results(write_result("a")))
    assert group.interval == (0.2, 0.9)


def test_a_patch_switched_off_is_another_setting(write_result):
    paths = [write_result("with"), write_result("without", patches=[])]
    groups = group_results(record for path in paths for record in read_results(path))
    assert [group.title for group in groups] == [
        "Square on Sawyer (gated, masked)",
        "Square on Sawyer (gated, masked, no patches)",
    ]


def test_classes_are_listed_in_order_and_unknown_ones_last(write_result):
    groups = group_results(read_results(write_result(failures=("fell off", "time-out"))))
    assert failure_classes(groups) == [*FAILURES, "fell off"]

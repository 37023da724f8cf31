import json

import pytest

from ocplanner.errors import ResultFileError
from ocplanner.report.results import FAILURES, failure_classes, group_results, read_results
from ocplanner.zero_shot.result import FAILURES as CLASSES


def test_a_result_file_is_read_whole(write_result):
    (record,) = read_results(write_result(successes=3, failures=("slip", "not aligned", "slip")))
    assert (record.robot, record.successes, record.episodes, record.rate) == ("Sawyer", 3, 6, 0.5)
    assert record.failures() == {"slip": 2, "not aligned": 1}
    assert record.episode(10004).failure == "not aligned"
    assert record.episode(1) is None


def test_a_matrix_gives_one_record_a_cell(tmp_path, write_result):
    cell = json.loads(write_result().read_text())
    path = tmp_path / "matrix.json"
    path.write_text(json.dumps({"command": "ocplanner transfer --matrix", "cells": [cell, cell | {"robot": "UR5e"}]}))
    assert [record.robot for record in read_results(path)] == ["Sawyer", "UR5e"]


@pytest.mark.parametrize("key", ["robot", "interval", "runs"])
def test_a_missing_key_is_named(write_result, key):
    path = write_result()
    content = json.loads(path.read_text())
    del content[key]
    path.write_text(json.dumps(content))
    with pytest.raises(ResultFileError, match=key):
        read_results(path)


@pytest.mark.parametrize("text", ["", "{", "[]", "3", '{"cells": 3}', '{"cells": [3]}'])
def test_a_file_that_is_no_result_is_an_error(tmp_path, text):
    path = tmp_path / "transfer.json"
    path.write_text(text)
    with pytest.raises(ResultFileError, match=r"transfer\.json"):
        read_results(path)


def test_a_value_of_the_wrong_kind_is_an_error(write_result):
    with pytest.raises(ResultFileError, match="damaged"):
        read_results(write_result(interval=["low"]))


def test_planners_of_one_setting_form_a_group(write_result):
    paths = [
        write_result("a", successes=2, failures=("slip", "slip")),
        write_result("other", robot="UR5e"),
        write_result("b", successes=4, failures=()),
    ]
    groups = group_results(record for path in paths for record in read_results(path))
    assert [group.title for group in groups] == ["Square on Sawyer (gated, masked)", "Square on UR5e (gated, masked)"]
    assert groups[0].mean_rate == 0.75
    assert groups[0].failures() == {"slip": 2}


def test_a_patch_switched_off_is_another_setting(write_result):
    paths = [write_result("with"), write_result("without", patches=[])]
    assert len(group_results(record for path in paths for record in read_results(path))) == 2


def test_classes_are_listed_in_order_and_unknown_ones_last(write_result):
    groups = group_results(read_results(write_result(failures=("fell off", "time-out"))))
    assert failure_classes(groups) == [*FAILURES, "fell off"]


def test_the_classes_are_those_that_transfers_report():
    assert FAILURES == CLASSES

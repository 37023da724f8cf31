import json

from ocplanner.report.heat_map import draw_heat_map, heat_map, write_heat_map
from ocplanner.report.results import group_results
from ocplanner.zero_shot.result import read_results


def table(paths):
    return heat_map(group_results(record for path in paths for record in read_results(path)))


def texts(figure) -> list[str]:
    return [text.get_text() for text in figure.axes[0].texts]


def test_a_cell_has_the_count_and_the_interval_and_one_that_was_not_run_says_so(write_result):
    paths = [
        write_result("a", successes=3),
        write_result("b", robot="UR5e", successes=0),
        write_result("c", task="Lift", successes=2, failures=()),
    ]
    found = table(paths)
    assert (found.rows, found.robots) == (("Square", "Lift"), ("Sawyer", "UR5e"))
    figure = draw_heat_map(found)
    assert texts(figure) == ["3/4", "20-90 %", "0/1", "20-90 %", "2/2", "20-90 %", "not run"]
    shades = [patch.get_facecolor()[0] for patch in figure.axes[0].patches[:3]]
    assert shades[1] > shades[0] > shades[2]  # less red is bluer: more success


def test_several_planners_give_their_mean(write_result):
    paths = [write_result("a", successes=3), write_result("b", successes=0, planner_sha256="cd" * 32)]
    assert texts(draw_heat_map(table(paths))) == ["38 %", "0-88 %\n2 planners"]


def test_settings_are_named_where_they_differ(write_result):
    assert table([write_result("a"), write_result("b", follow="time")]).rows == (
        "Square (gated, masked)",
        "Square (time, masked)",
    )


def test_a_result_without_patches_has_a_row_of_its_own(write_result):
    found = table([write_result("with", successes=3), write_result("without", successes=1, patches=[])])
    assert found.rows == ("Square (gated, masked)", "Square (gated, masked, no patches)")
    assert texts(draw_heat_map(found)) == ["3/4", "20-90 %", "1/2", "20-90 %"]


def test_a_matrix_file_becomes_a_picture(tmp_path, write_result):
    cells = [json.loads(write_result(robot, robot=robot).read_text()) for robot in ("Panda", "IIWA")]
    (tmp_path / "matrix.json").write_text(json.dumps({"command": "", "cells": cells}))
    picture = write_heat_map(tmp_path / "matrix.json", tmp_path / "matrix.png")
    assert picture.read_bytes().startswith(b"\x89PNG")

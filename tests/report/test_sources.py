import json
import shutil

import pytest

from ocplanner.errors import ResultFileError
from ocplanner.report.sources import find_sources
from random_planner import write_random_planner
from random_policy import random_training, write_random_policy


def test_a_folder_is_searched_for_runs_results_videos_and_figures(tmp_path, write_run, write_result):
    for name in ("h5", "h20", "h100"):
        write_run(name)
    write_result()
    (tmp_path / "h5" / "figures").mkdir()
    for name in (
        "h5/figures/plans.png",
        "h5/stray.png",
        "h5/a.mp4",
        "h5/planner.safetensors",
        "h5/notes.json",
        ".hidden.mp4",
    ):
        (tmp_path / name).write_text("{}")
    (tmp_path / "h5" / "checkpoints").mkdir()
    shutil.copy(tmp_path / "transfer.json", tmp_path / "h5" / "checkpoints")
    sources = find_sources([tmp_path])
    assert [run.name for run in sources.runs] == ["h5", "h20", "h100"]
    assert [record.path.name for record in sources.records] == ["transfer.json"]
    assert [path.name for path in sources.videos] == ["a.mp4"]
    assert [path.name for path in sources.figures] == ["plans.png"]
    assert [path.name for path in sources.planners] == ["planner.safetensors"]


def test_policies_are_told_from_planners_by_what_they_say_of_themselves(tmp_path, tiny_square):
    write_random_policy(tmp_path / "a.safetensors", tiny_square(), random_training(hint=None))
    write_random_planner(tmp_path / "b.safetensors")
    sources = find_sources([tmp_path])
    assert [path.name for path in sources.policies] == ["a.safetensors"]
    assert [path.name for path in sources.planners] == ["b.safetensors"]


def test_of_a_run_the_last_policy_is_taken_and_others_only_by_name(tmp_path, write_policy_run, tiny_square):
    run = write_policy_run("run")
    files = [run / "policies" / f"step_{step:03d}.safetensors" for step in (20, 100)]
    for file in files:
        write_random_policy(file, tiny_square(), random_training(hint=None))
    assert find_sources([run]).policies == (files[1],)
    finished = write_random_policy(run / "policy.safetensors", tiny_square(), random_training(hint=None))
    assert find_sources([run]).policies == (finished,)
    assert find_sources([files[0]]).policies == (files[0],)


def test_evaluations_and_runs_of_policies_are_told_from_those_of_planners(
    tmp_path, write_run, write_policy_run, write_result, write_evaluation
):
    write_run("planner")
    write_policy_run("policy")
    write_result("transfer")
    write_evaluation("evaluation")
    sources = find_sources([tmp_path])
    assert [run.name for run in sources.planner_runs] == ["planner"]
    assert [run.name for run in sources.policy_runs] == ["policy"]
    assert [record.path.name for record in sources.records] == ["transfer.json"]
    assert [record.seed for record in sources.evaluations] == [0]


def test_a_damaged_evaluation_is_an_error_that_names_it(tmp_path, write_evaluation):
    path = write_evaluation("evaluation")
    path.write_text(path.read_text().replace('"sha256"', '"sha"'))
    with pytest.raises(ResultFileError, match=r"evaluation\.json .*sha256"):
        find_sources([tmp_path])


def test_what_is_named_twice_is_taken_once(tmp_path, write_result):
    path = write_result()
    assert len(find_sources([path, tmp_path, path]).records) == 1


def test_a_cell_is_taken_from_its_matrix_or_from_its_own_file_but_once(tmp_path, write_result):
    cells = [json.loads(write_result(robot, robot=robot).read_text()) for robot in ("Sawyer", "UR5e")]
    (tmp_path / "matrix.json").write_text(json.dumps({"command": "", "cells": cells}))
    assert [record.robot for record in find_sources([tmp_path]).records] == ["Sawyer", "UR5e"]
    write_result("other", robot="UR5e", planner_sha256="cd" * 32)
    assert len(find_sources([tmp_path]).records) == 3


def test_a_result_can_be_named_outright_and_must_then_be_one(tmp_path, write_result):
    assert find_sources([write_result()]).records[0].robot == "Sawyer"
    (tmp_path / "notes.json").write_text("{}")
    with pytest.raises(ResultFileError, match="lacks task"):
        find_sources([tmp_path / "notes.json"])


@pytest.mark.parametrize("name", ["absent", "data.hdf5"])
def test_a_path_that_cannot_be_shown_is_an_error_that_names_it(tmp_path, name):
    (tmp_path / "data.hdf5").write_bytes(b"")
    with pytest.raises(ResultFileError, match=name):
        find_sources([tmp_path / name])


def test_an_empty_folder_is_an_error(tmp_path):
    with pytest.raises(ResultFileError, match="nothing to report"):
        find_sources([tmp_path])

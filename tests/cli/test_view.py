"""``ocplanner view``: which episode is shown; what is shown is tested with the viewer."""

import importlib
import json
from pathlib import Path

import pytest

from ocplanner.cli.view import View
from ocplanner.errors import MismatchError, ResultFileError, VersionError
from ocplanner.report import viewer

ROOT = Path(__file__).parents[2]
PLANNER = ROOT / "results" / "planners" / "square_masked_h20_pose_0.safetensors"
RESULT = ROOT / "results" / "transfer" / "square_sawyer_open-loop_masked_0.json"


@pytest.fixture
def asked(monkeypatch):
    """(planner, robot, seed, follow) of the episodes that were asked for, without running them."""
    found = []

    class Steps(list):
        outcome = "success"

    def record(planner, robot, seed, *, follow, patches=None):
        found.append((planner.paths[0].name, robot, seed, follow))
        return Steps()

    monkeypatch.setattr(viewer, "record_playback", record)
    monkeypatch.chdir(ROOT)
    return found


def runs(success: bool) -> list[int]:
    return [run["seed"] for run in json.loads(RESULT.read_text())["runs"] if run["success"] == success]


def test_of_a_planner_an_episode_is_run(asked):
    View(PLANNER, robot="UR5e", seed=3).playback()
    assert asked == [(PLANNER.name, "UR5e", 3, "gated")]


def test_of_a_run_folder_its_planner(asked, tmp_path):
    (tmp_path / "planner.safetensors").write_bytes(PLANNER.read_bytes())
    View(tmp_path).playback()
    assert asked == [("planner.safetensors", "Sawyer", 10000, "gated")]


def test_of_a_result_the_first_failure_is_run_again(asked, capsys):
    View(RESULT, robot="Panda").playback()
    assert asked == [(PLANNER.name, "Sawyer", runs(success=False)[0], "open-loop")]
    assert "other versions" in capsys.readouterr().err


def test_an_episode_of_a_result_can_be_chosen(asked):
    seed = runs(success=True)[0]
    View(RESULT, seed=seed).playback()
    assert asked[0][2] == seed


def test_without_viser_no_episode_is_run(asked, monkeypatch):
    def missing(name):
        raise ModuleNotFoundError(name)

    monkeypatch.setattr(importlib, "import_module", missing)
    with pytest.raises(VersionError, match=r"ocplanner\[viewer\]"):
        View(PLANNER).run()
    assert asked == []


def test_what_does_not_fit_is_an_error(asked, tmp_path):
    with pytest.raises(MismatchError, match="has episodes 10000 to 10099, not 5"):
        View(RESULT, seed=5).playback()
    with pytest.raises(MismatchError, match="is not the planner of"):
        View(RESULT, planner=(PLANNER.with_name("square_masked_h20_pose_1.safetensors"),)).playback()
    many = tmp_path / "matrix.json"
    many.write_text(json.dumps({"cells": [json.loads(RESULT.read_text())] * 2}))
    with pytest.raises(ResultFileError, match="holds 2 results"):
        View(many).playback()
    nameless = tmp_path / "result.json"
    nameless.write_text(json.dumps({**json.loads(RESULT.read_text()), "command": "by hand"}))
    with pytest.raises(ResultFileError, match="name it with --planner"):
        View(nameless).playback()

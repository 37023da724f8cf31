"""``ocplanner view``: which episode is shown; what is shown is tested with the viewer."""

import importlib
import json
import shlex
from pathlib import Path

import pytest

from ocplanner.cli.view import View
from ocplanner.control.settings import ControlSettings
from ocplanner.errors import MismatchError, ResultFileError, VersionError
from ocplanner.files.records.episode import EpisodeResult
from ocplanner.report import viewer
from ocplanner.zero_shot.result import with_episodes
from ocplanner.zero_shot.settings import TransferConfig
from ocplanner.zero_shot.setup import TransferSetup

ROOT = Path(__file__).parents[2]
PLANNER = ROOT / "results" / "planners" / "square_masked_h20_pose_0.safetensors"
RESULT = ROOT / "results" / "transfer" / "square_sawyer_open-loop_masked_0.json"


@pytest.fixture
def asked(monkeypatch):
    """(setup, seed) of the episodes that were asked for, without running them."""
    found = []

    class Steps(list):
        outcome = "success"

    def record(setup, seed):
        found.append((setup, seed))
        return Steps()

    monkeypatch.setattr(viewer, "record_playback", record)
    monkeypatch.chdir(ROOT)
    return found


def runs(success: bool) -> list[int]:
    return [run["seed"] for run in json.loads(RESULT.read_text())["runs"] if run["success"] == success]


def test_of_a_planner_an_episode_is_run(asked):
    config = TransferConfig(mask_error=2)
    View(PLANNER, robot="UR5e", seed=3, config=config).playback()
    ((setup, seed),) = asked
    assert (setup.planners, setup.result.robot, setup.result.settings, seed) == ((PLANNER,), "UR5e", config, 3)


def test_of_a_run_folder_its_planner(asked, tmp_path):
    (tmp_path / "planner.safetensors").write_bytes(PLANNER.read_bytes())
    View(tmp_path).playback()
    ((setup, seed),) = asked
    assert (setup.planners, setup.result.robot, seed) == ((tmp_path / "planner.safetensors",), "Sawyer", 10000)


def test_of_a_result_the_first_failure_is_run_again(asked, capsys):
    View(RESULT, robot="Panda").playback()
    ((setup, seed),) = asked
    assert (setup.planners, setup.result.robot, seed) == ((PLANNER,), "Sawyer", runs(success=False)[0])
    assert setup.result.settings == TransferConfig(control=ControlSettings(follow="open-loop"))
    assert "another version" in capsys.readouterr().err


def test_a_result_is_run_again_under_its_own_conditions(asked, tmp_path):
    wrong = ROOT / "results" / "pose_noise" / "square_sawyer_gated_masked_0_5mm2deg_filter8.json"
    View(wrong).playback()
    settings = TransferConfig(control=ControlSettings(follow="time"), patches=False, mask_error=2, pose_latency=1)
    result = TransferSetup.of(PLANNER, "Sawyer", settings).result
    path = with_episodes(result, [EpisodeResult(7, False, 9, "slip")]).save(tmp_path / "result.json")
    View(path).playback()
    first, second = (setup.result.settings for setup, _ in asked)
    assert first == TransferConfig(pose_noise=(5.0, 2.0), pose_filter=8)
    assert second == settings


def test_the_planner_of_a_result_is_found_whatever_its_path(asked, tmp_path):
    old, new = tmp_path / "my old", tmp_path / "my new"
    for folder in (old, new):
        folder.mkdir()
        (folder / "p.safetensors").write_bytes(PLANNER.read_bytes())
    command = shlex.join(["ocplanner", "transfer", "--planner", str(old / "p.safetensors"), "--robot", "Sawyer"])
    named = tmp_path / "old.json"
    named.write_text(json.dumps({**json.loads(RESULT.read_text()), "command": command}))
    View(named).playback()
    result = with_episodes(TransferSetup.of(new / "p.safetensors").result, [EpisodeResult(7, True, 9)])
    View(result.save(tmp_path / "new.json")).playback()
    assert [setup.planners for setup, _ in asked] == [(old / "p.safetensors",), (new / "p.safetensors",)]


def test_an_episode_of_a_result_can_be_chosen(asked):
    seed = runs(success=True)[0]
    View(RESULT, seed=seed).playback()
    assert asked[0][1] == seed


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

"""A matrix of planners with random weights: it solves nothing, but all the rest must work."""

import json
from dataclasses import replace

import pytest

from ocplanner.control.settings import ControlSettings, GraspSettings
from ocplanner.drawing.video import read_video
from ocplanner.envs.robots import ROBOTS
from ocplanner.errors import InvalidValueError, ModelFileError, OutputError, UnknownNameError
from ocplanner.planner.planner import Planner
from ocplanner.zero_shot import matrix as matrix_module
from ocplanner.zero_shot import scenario
from ocplanner.zero_shot.loop import describe
from ocplanner.zero_shot.matrix import find_planners, transfer_matrix
from random_planner import planner_config, random_tensors, write_planner, write_random_planner

HASTY = ControlSettings(grasp=GraspSettings(settle_steps=1, approach_steps=2, tries=1))


@pytest.fixture
def planners(tmp_path):
    folder = tmp_path / "planners"
    folder.mkdir()
    write_random_planner(folder / "square_0.safetensors")
    write_planner(folder / "square_1.safetensors", config := planner_config(seed=1), random_tensors(config))
    write_random_planner(folder / "lift_0.safetensors", task="Lift", object="cube")
    return folder


def test_of_a_folder_the_planners_of_one_seed_are_taken(planners):
    assert [planner.paths[0].name for planner in find_planners([planners])] == [
        "lift_0.safetensors",
        "square_0.safetensors",
    ]
    assert [planner.paths[0].name for planner in find_planners([planners], seed=1)] == ["square_1.safetensors"]
    assert len(find_planners([planners / "square_1.safetensors", planners / "lift_0.safetensors"])) == 2


def test_no_planners_and_two_of_one_task_are_errors(planners, tmp_path):
    with pytest.raises(InvalidValueError, match=r"square_0\..* and .*square_1\..* both plan for Square"):
        find_planners([planners, planners / "square_1.safetensors"])
    (tmp_path / "empty").mkdir()
    with pytest.raises(ModelFileError, match=r"no planner .* in .*empty"):
        find_planners([tmp_path / "empty"])
    with pytest.raises(ModelFileError, match="training seed 7"):
        find_planners([planners], seed=7)
    with pytest.raises(ModelFileError, match="absent"):
        find_planners([tmp_path / "absent.safetensors"])


def test_a_stopped_matrix_goes_on_where_it_was(planners, tmp_path):
    out = tmp_path / "matrix.json"
    played = []

    def stop(run):
        played.append(run.seed)
        if len(played) == 3:
            raise KeyboardInterrupt

    options = {"robots": ("Panda", "Sawyer"), "out": out, "episodes": 2, "settings": HASTY, "command": "remake"}
    found = find_planners([planners])[:1]
    with pytest.raises(KeyboardInterrupt):
        transfer_matrix(found, on_episode=stop, **options)
    assert [cell["robot"] for cell in json.loads(out.read_text())["cells"]] == ["Panda"]
    played.clear()
    done = []
    matrix = transfer_matrix(found, on_episode=lambda run: played.append(run.seed), on_cell=done.append, **options)
    assert played == [10000, 10001]  # of Sawyer, the first from the journal
    assert done == list(matrix.cells)
    content = json.loads(out.read_text())
    assert content["command"] == "remake"
    assert content["cells"] == [cell.to_json() for cell in matrix.cells]
    assert [(cell.task, cell.robot, cell.episodes) for cell in done] == [("Lift", "Panda", 2), ("Lift", "Sawyer", 2)]
    cells = sorted(path.name for path in (tmp_path / "matrix").glob("*.json"))
    assert cells == ["lift_panda_gated_masked_0.json", "lift_sawyer_gated_masked_0.json"]


def test_cells_of_another_planner_are_not_mixed_in(planners, tmp_path):
    options = {"robots": ("Panda",), "out": tmp_path / "matrix.json", "episodes": 1, "settings": HASTY}
    first = transfer_matrix([Planner.load(planners / "square_0.safetensors")], **options)
    write_random_planner(planners / "square_0.safetensors", seed=5)
    other = [Planner.load(planners / "square_0.safetensors")]
    with pytest.raises(OutputError, match=r"square_panda_gated_masked_0\.json holds another transfer"):
        transfer_matrix(other, **options)
    second = transfer_matrix(other, overwrite=True, **options)
    assert first.cells[0].planner_sha256 != second.cells[0].planner_sha256


def test_one_success_and_one_failure_are_filmed(planners, tmp_path, monkeypatch):
    """The verdict is the seed's, in place of robosuite's: even seeds succeed."""
    real = scenario.run_episode

    def run_episode(env, planner, seed, *arguments, **options):
        return replace(real(env, planner, seed, *arguments, **options), success=seed % 2 == 0)

    monkeypatch.setattr(scenario, "run_episode", run_episode)
    options = {"robots": ("Panda",), "out": tmp_path / "matrix.json", "episodes": 4, "settings": HASTY, "videos": 1}
    found = [Planner.load(planners / "square_0.safetensors")]
    transfer_matrix(found, **options)
    folder = tmp_path / "matrix" / "square_panda_gated_masked_0"
    assert sorted(path.name for path in folder.iterdir()) == ["episode_10000.mp4", "episode_10001.mp4"]
    assert len(read_video(folder / "episode_10001.mp4")) > 5
    (folder / "episode_10001.mp4").unlink()
    kept = (folder / "episode_10000.mp4").stat().st_mtime_ns
    transfer_matrix(found, **options)
    assert (folder / "episode_10001.mp4").exists()
    assert (folder / "episode_10000.mp4").stat().st_mtime_ns == kept


def test_what_does_not_fit_is_refused_before_anything_is_run(planners, tmp_path):
    options = {"out": tmp_path / "matrix.json", "episodes": 1}
    with pytest.raises(UnknownNameError, match="robot 'Pnda'"):
        transfer_matrix(find_planners([planners]), ("Panda", "Pnda"), **options)
    with pytest.raises(InvalidValueError, match="at least 1"):
        transfer_matrix(find_planners([planners]), **options | {"episodes": 0})
    assert not (tmp_path / "matrix").exists()


def test_every_arm_is_tried_unless_said_otherwise(planners, tmp_path, monkeypatch):
    tried = []

    def run_transfer(scenario, planner, seeds, **options):
        tried.append((scenario.task, scenario.robot))
        return describe(scenario, planner)

    monkeypatch.setattr(matrix_module, "run_transfer", run_transfer)
    transfer_matrix(find_planners([planners]), out=tmp_path / "matrix.json", episodes=1)
    assert tried == [(task, robot) for task in ("Lift", "Square") for robot in ROBOTS]

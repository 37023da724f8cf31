"""A matrix of planners with random weights: it solves nothing, but all the rest must work."""

import json
from dataclasses import replace

import pytest

from ocplanner.control.settings import ControlSettings, GraspSettings
from ocplanner.drawing.video import read_video
from ocplanner.envs.robots import ROBOTS
from ocplanner.errors import InvalidValueError, ModelFileError, OutputError, UnknownNameError, WorkerError
from ocplanner.files.records.episode import EpisodeResult
from ocplanner.zero_shot import setup as transfer_setup
from ocplanner.zero_shot.matrix import MatrixProgress, find_planners, transfer_matrix
from ocplanner.zero_shot.result import read_result
from ocplanner.zero_shot.settings import TransferConfig
from ocplanner.zero_shot.setup import EpisodeRunner
from ocplanner.zero_shot.task_planners import TaskPlanners
from random_planner import planner_config, random_tensors, write_planner, write_random_planner

CONTROL = ControlSettings(grasp=GraspSettings(settle_steps=1, approach_steps=2, tries=1))
HASTY = TransferConfig(control=CONTROL)


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

    options = {"robots": ("Panda", "Sawyer"), "out": out, "episodes": 2, "config": HASTY}
    found = find_planners([planners])[:1]
    with pytest.raises(KeyboardInterrupt):
        transfer_matrix(found, progress=MatrixProgress(episode=stop), **options)
    assert [cell["robot"] for cell in json.loads(out.read_text())["cells"]] == ["Panda"]
    played.clear()
    done = []
    progress = MatrixProgress(episode=lambda run: played.append(run.seed), done=done.append)
    matrix = transfer_matrix(found, progress=progress, **options)
    assert played == [10000, 10001]  # of Sawyer, the first from the journal
    assert done == list(matrix.cells)
    content = json.loads(out.read_text())
    assert content["command"] == matrix.command
    assert content["cells"] == [cell.to_json() for cell in matrix.cells]
    assert [(cell.task, cell.robot, cell.episodes) for cell in done] == [("Lift", "Panda", 2), ("Lift", "Sawyer", 2)]
    cells = sorted(path.name for path in (tmp_path / "matrix").glob("*.json"))
    assert cells == [cell.file_name for cell in done]


def test_cells_of_another_planner_are_not_mixed_in(planners, tmp_path):
    options = {"robots": ("Panda",), "out": tmp_path / "matrix.json", "episodes": 1, "config": HASTY}
    first = transfer_matrix(find_planners([planners / "square_0.safetensors"]), **options)
    write_random_planner(planners / "square_0.safetensors", seed=5)
    other = find_planners([planners / "square_0.safetensors"])
    with pytest.raises(OutputError, match=r"square_panda_gated_masked_.*\.json holds another transfer"):
        transfer_matrix(other, **options)
    second = transfer_matrix(other, overwrite=True, **options)
    assert first.cells[0].planner_sha256 != second.cells[0].planner_sha256


def test_one_success_and_one_failure_are_filmed(planners, tmp_path, monkeypatch):
    """The verdict is the seed's, in place of robosuite's: even seeds succeed."""
    real = transfer_setup.run_episode

    def run_episode(env, planner, seed, *arguments, **options):
        return replace(real(env, planner, seed, *arguments, **options), success=seed % 2 == 0)

    monkeypatch.setattr(transfer_setup, "run_episode", run_episode)
    options = {"robots": ("Panda",), "out": tmp_path / "matrix.json", "episodes": 4, "config": HASTY, "videos": 1}
    found = find_planners([planners / "square_0.safetensors"])
    matrix = transfer_matrix(found, **options)
    folder = (tmp_path / "matrix" / matrix.cells[0].file_name).with_suffix("")
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


@pytest.fixture
def instant(monkeypatch):
    """Episodes of no time: even seeds succeed."""
    monkeypatch.setattr(EpisodeRunner, "__init__", lambda runner, setup: None)
    monkeypatch.setattr(EpisodeRunner, "close", lambda runner: None)
    monkeypatch.setattr(EpisodeRunner, "play", lambda runner, seed: EpisodeResult(seed, seed % 2 == 0, 1))


def test_every_arm_is_tried_unless_said_otherwise(planners, tmp_path, instant):
    matrix = transfer_matrix(find_planners([planners]), out=tmp_path / "matrix.json", episodes=1)
    tried = [(cell.task, cell.robot) for cell in matrix.cells]
    assert tried == [(task, robot) for task in ("Lift", "Square") for robot in ROBOTS]


def cells(out):
    return [(cell["robot"], cell["episodes"]) for cell in json.loads(out.read_text())["cells"]]


def test_a_matrix_with_fewer_robots_keeps_the_other_cells(planners, tmp_path, instant):
    out, found = tmp_path / "matrix.json", find_planners([planners])[:1]
    transfer_matrix(found, ("UR5e", "Panda"), out=out, episodes=2)
    matrix = transfer_matrix(found, ("Sawyer",), out=out, episodes=2)
    assert cells(out) == [("Panda", 2), ("Sawyer", 2), ("UR5e", 2)]
    assert [cell.robot for cell in matrix.cells] == ["Panda", "Sawyer", "UR5e"]
    (tmp_path / "matrix" / "lift_panda_gated_masked_0.json").unlink()
    with pytest.raises(OutputError, match=r"matrix\.json holds another transfer of Lift on Panda"):
        transfer_matrix(found, ("Panda",), out=out, episodes=3)
    assert cells(out) == [("Panda", 2), ("Sawyer", 2), ("UR5e", 2)]
    transfer_matrix(found, ("Panda",), out=out, episodes=3, overwrite=True)
    assert cells(out) == [("Panda", 3), ("Sawyer", 2), ("UR5e", 2)]


def test_other_conditions_are_other_cells(planners, tmp_path, instant):
    out, found = tmp_path / "matrix.json", find_planners([planners])[:1]
    for config in (TransferConfig(), TransferConfig(patches=False)):
        transfer_matrix(found, ("Sawyer",), out=out, episodes=1, config=config)
    assert sorted(path.name for path in (tmp_path / "matrix").glob("*.json")) == [
        "lift_sawyer_gated_masked_0.json",
        "lift_sawyer_gated_masked_unpatched_0.json",
    ]
    assert cells(out) == [("Sawyer", 1), ("Sawyer", 1)]


def test_a_cell_is_kept_only_if_it_is_of_these_episodes(planners, tmp_path):
    out, found, seen = tmp_path / "matrix.json", find_planners([planners])[:1], []
    options = {"robots": ("Panda",), "out": out, "config": HASTY}
    first = transfer_matrix(found, episodes=(1, 2), **options)
    progress = MatrixProgress(episode=seen.append)
    assert transfer_matrix(found, episodes=(1, 2), progress=progress, **options).cells == first.cells
    assert seen == []
    with pytest.raises(OutputError, match="holds another transfer"):
        transfer_matrix(found, episodes=(1, 3), **options)
    again = transfer_matrix(found, episodes=(3,), overwrite=True, progress=progress, **options)
    assert [run.seed for run in again.cells[0].runs] == [run.seed for run in seen] == [3]
    assert read_result(tmp_path / "matrix" / again.cells[0].file_name) == again.cells[0]


def test_an_example_that_ends_otherwise_when_it_is_filmed_is_an_error(planners, tmp_path, instant, monkeypatch):
    played = iter([EpisodeResult(1, True, 10, None, "follower"), EpisodeResult(1, False, 12, "slip", None)])
    monkeypatch.setattr(EpisodeRunner, "play", lambda runner, seed: next(played))
    found = [TaskPlanners.of(planners / "square_0.safetensors")]
    with pytest.raises(WorkerError, match="seed 1 of Square on Panda ended otherwise"):
        transfer_matrix(found, ("Panda",), out=tmp_path / "matrix.json", episodes=(1,), videos=1)

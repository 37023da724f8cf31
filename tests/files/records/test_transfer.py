"""Result files of transfers: written as the design says, read in every format, never silently misread."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from ocplanner.errors import ResultFileError
from ocplanner.files.records.episode import EpisodeResult
from ocplanner.files.records.transfer import is_matrix, is_transfer
from ocplanner.zero_shot.result import Matrix, TransferResult, read_result, read_results, with_episodes
from ocplanner.zero_shot.settings import TransferConfig

HERE, ROOT = Path(__file__).parent, Path(__file__).parents[3]
RUNS = (EpisodeResult(10000, True, 150, None, "follower"), EpisodeResult(10001, False, 400, "time-out", None))


def result(**changes) -> TransferResult:
    blank = TransferResult(
        task="Square",
        robot="Sawyer",
        observe="masked",
        visual="stock",
        planner_visual="fast",
        patches=("sawyer-base-contact",),
        settings=TransferConfig(visual="stock", allow_mismatch=True, pose_noise=(5.0, 2.0)),
        privileged=("object pose",),
        planners=("p.safetensors",),
        planner_sha256="ab12",
        planner_seed=0,
        command="ocplanner transfer",
        versions={},
    )
    return with_episodes(replace(blank, **changes), changes.get("runs", RUNS))


def test_file_holds_what_the_design_asks_for(tmp_path):
    path = result().save(tmp_path / "transfer" / "x.json")
    content = json.loads(path.read_text())
    keys = {"task", "robot", "observe", "patches", "episodes", "successes", "interval", "planner_sha256"}
    assert keys | {"format", "command", "versions", "runs", "settings", "privileged"} <= set(content)
    assert content["format"] == 2
    assert content["successes"] == 1
    assert content["episodes"] == 2
    assert content["failures"] == {"time-out": 1}
    assert content["privileged"] == ["object pose"]
    assert {"seed", "success", "steps", "failure"} <= set(content["runs"][0])
    assert (content["visual"], content["planner_visual"]) == ("stock", "fast")
    settings = content["settings"]
    assert (settings["control"]["follow"], settings["control_loop"]) == ("gated", "native")
    assert settings["control"]["grasp"]["tries"] == 3
    assert read_result(path).setting == "gated, masked, stock visuals, pose noise 5 mm 2°"


def test_the_object_that_failed_is_named_where_there_are_several(tmp_path):
    runs = (EpisodeResult(10000, False, 700, "slip", None, "tool"), EpisodeResult(10001, True, 500, None, "follower"))
    path = result(runs=runs).save(tmp_path / "x.json")
    first, second = json.loads(path.read_text())["runs"]
    assert first["failed_with"] == "tool"
    assert "failed_with" not in second
    assert read_result(path).runs == runs


def test_a_file_is_read_as_it_was_written(tmp_path):
    path = result().save(tmp_path / "x.json")
    assert read_result(path) == result()
    assert read_result(path).planners == ("p.safetensors",)
    assert read_result(path).path == path


def test_a_file_of_format_1_is_read():
    found = read_result(HERE / "transfer_format_1.json")
    assert (found.task, found.robot, found.observe, found.visual) == ("Square", "Sawyer", "masked", "fast")
    assert (found.successes, found.episodes, found.planner_seed) == (47, 50, 0)
    assert found.settings == TransferConfig(pose_noise=(5.0, 2.0), pose_filter=8)
    assert found.patches == ("sawyer-base-contact",)
    assert found.privileged == ("object pose",)
    assert found.failures == {"not aligned": 1, "not released": 1, "lost grasp": 1}
    assert found.runs[0] == EpisodeResult(10000, True, 206, None, "follower")
    assert found.interval == pytest.approx((0.838, 0.979), abs=1e-3)


def test_a_file_from_before_visual_presets_and_pose_errors_is_read():
    found = read_result(HERE / "transfer_format_1_oldest.json")
    assert (found.visual, found.planner_visual) == (None, None)
    assert found.settings == TransferConfig(mask_error=2)
    assert found.setting == "gated, masked, mask 2 px off"


def committed() -> list[Path]:
    files = (path for path in (ROOT / "results").rglob("*.json"))
    return [path for path in files if is_transfer(content := json.loads(path.read_text())) or is_matrix(content)]


def test_every_committed_result_is_read():
    paths = committed()
    assert len(paths) > 90
    for path in paths:
        content = json.loads(path.read_text())
        cells = content.get("cells", [content])
        for cell, found in zip(cells, read_results(path), strict=True):
            assert (found.original or found.to_json()) == cell
            assert [(run.seed, run.success) for run in found.runs] == [
                (run["seed"], run["success"]) for run in cell["runs"]
            ]
            said = cell if "follow" in cell else cell["settings"]["control"]
            assert found.settings.control.follow == said["follow"]
            if path.parent.name in ("transfer", "matrix"):
                assert found.file_name == path.name


def test_a_matrix_repeats_cells_of_format_1_as_they_are(tmp_path):
    old = read_result(HERE / "transfer_format_1.json")
    path = Matrix("remake", (old, result())).save(tmp_path / "matrix.json")
    content = json.loads(path.read_text())
    assert content["format"] == 2
    assert content["cells"][0] == json.loads((HERE / "transfer_format_1.json").read_text())
    assert read_results(path) == (old, result())


def test_episodes_and_failures_are_found():
    slips = tuple(
        EpisodeResult(i, False, 9, failure) for i, failure in enumerate(("slip", "not aligned", "slip", None))
    )
    found = result(runs=(*slips, EpisodeResult(4, True, 9)))
    assert (found.successes, found.episodes, found.rate) == (1, 5, 0.2)
    assert found.failures == {"slip": 2, "not aligned": 1, "unclassified": 1}
    assert found.episode(1).failure == "not aligned"
    assert found.episode(9) is None


@pytest.mark.parametrize("text", ["", "{", "[]", "3", "{}", '{"runs": 3}', '{"cells": 3}', '{"cells": [3]}'])
def test_a_file_that_is_no_result_is_named(tmp_path, text):
    (tmp_path / "x.json").write_text(text)
    for read in (read_result, read_results):
        with pytest.raises(ResultFileError, match=r"x\.json"):
            read(tmp_path / "x.json")


def changed(path: Path, **changes) -> Path:
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))
    return path


@pytest.mark.parametrize("key", ["robot", "interval", "runs", "settings", "privileged"])
def test_a_missing_key_is_named(tmp_path, key):
    path = result().save(tmp_path / "x.json")
    content = json.loads(path.read_text())
    del content[key]
    path.write_text(json.dumps(content))
    with pytest.raises(ResultFileError, match=f"lacks {'follow' if key == 'settings' else key}"):
        read_result(path)


@pytest.mark.parametrize(
    "change",
    [
        {"interval": ["low"]},
        {"settings": {"mask_error": "two"}},
        {"settings": {"control": {"follow": "blind"}}},
        {"settings": {"wind": 3}},
        {"runs": [{"seed": 1, "success": "no", "steps": 3}]},
        {"successes": 2},
    ],
)
def test_a_value_of_the_wrong_kind_is_damage(tmp_path, change):
    path = changed(result().save(tmp_path / "x.json"), **change)
    with pytest.raises(ResultFileError, match="damaged"):
        read_result(path)


def test_a_newer_format_is_refused(tmp_path):
    path = changed(result().save(tmp_path / "x.json"), format=3)
    with pytest.raises(ResultFileError, match=r"format 3, but this version reads 1 to 2; update ocplanner"):
        read_result(path)


def test_names():
    plain = replace(result(), visual="fast", settings=TransferConfig())
    assert plain.file_name == "square_sawyer_gated_masked_0.json"
    other = replace(plain, robot="UR5e", observe="no-robot", planner_seed=None)
    assert other.file_name == "square_ur5e_gated_no-robot.json"
    late = replace(plain, settings=TransferConfig(pose_noise=(5.0, 2.0), pose_latency=3))
    assert late.file_name == "square_sawyer_gated_masked_noise5mm2deg_latency3_0.json"
    unpatched = replace(plain, settings=TransferConfig(patches=False))
    assert unpatched.file_name == "square_sawyer_gated_masked_unpatched_0.json"
    assert unpatched.title == "Square on Sawyer (gated, masked, no patches)"


def test_printed_line():
    assert "1/2" in str(result())
    assert "1 time-out" in str(result())
    assert "pose noise 5 mm 2°" in str(result())

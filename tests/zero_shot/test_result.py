import json
from dataclasses import replace

import pytest

from ocplanner.control.noisy_pose import PoseError
from ocplanner.errors import ResultFileError
from ocplanner.files.records.episode import EpisodeResult
from ocplanner.report.results import read_results
from ocplanner.zero_shot.result import TransferResult


def result() -> TransferResult:
    runs = (EpisodeResult(10000, True, 150, None, "follower"), EpisodeResult(10001, False, 400, "time-out", None))
    return TransferResult(
        task="Square",
        robot="Sawyer",
        follow="gated",
        observe="masked",
        visual="stock",
        planner_visual="fast",
        control="native",
        patches=("sawyer-base-contact",),
        mask_error=0,
        pose_error=PoseError(5.0, 2.0),
        pose_filter=1,
        planner_sha256="ab12",
        planner_seed=0,
        command="ocplanner transfer",
        versions={},
        runs=runs,
    )


def test_file_holds_what_the_design_asks_for(tmp_path):
    path = result().save(tmp_path / "transfer" / "x.json")
    content = json.loads(path.read_text())
    keys = {"task", "robot", "follow", "observe", "patches", "episodes", "successes", "interval", "planner_sha256"}
    assert keys | {"command", "versions", "runs"} <= set(content)
    assert content["successes"] == 1
    assert content["episodes"] == 2
    assert content["failures"] == {"time-out": 1}
    assert {"seed", "success", "steps", "failure"} <= set(content["runs"][0])
    assert read_results(path)[0].successes == 1
    assert (content["visual"], content["planner_visual"], content["control"]) == ("stock", "fast", "native")
    assert read_results(path)[0].setting == "gated, masked, stock visuals, pose noise 5 mm 2°"


def test_the_object_that_failed_is_named_where_there_are_several(tmp_path):
    runs = (EpisodeResult(10000, False, 700, "slip", None, "tool"), EpisodeResult(10001, True, 500, None, "follower"))
    path = replace(result(), runs=runs).save(tmp_path / "x.json")
    first, second = json.loads(path.read_text())["runs"]
    assert first["failed_with"] == "tool"
    assert "failed_with" not in second
    assert TransferResult.load(path).runs == runs


def test_a_file_is_read_as_it_was_written(tmp_path):
    assert TransferResult.load(result().save(tmp_path / "x.json")) == result()


def test_files_from_before_there_were_pose_errors_are_read(tmp_path):
    path = result().save(tmp_path / "x.json")
    content = json.loads(path.read_text())
    del content["pose_error"]
    path.write_text(json.dumps(content))
    assert TransferResult.load(path) == replace(result(), pose_error=PoseError())


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"runs": 3}'])
def test_a_file_that_is_no_result_is_named(tmp_path, text):
    (tmp_path / "x.json").write_text(text)
    with pytest.raises(ResultFileError, match=r"x\.json is no result"):
        TransferResult.load(tmp_path / "x.json")


def test_names():
    plain = replace(result(), visual="fast", pose_error=PoseError())
    assert plain.file_name == "square_sawyer_gated_masked_0.json"
    other = replace(plain, robot="UR5e", follow="open-loop", observe="no-robot", planner_seed=None)
    assert other.file_name == "square_ur5e_open-loop_no-robot.json"
    assert "_error2_" in replace(plain, mask_error=2).file_name
    assert "_stock_" in replace(plain, visual="stock").file_name
    late = replace(plain, pose_error=PoseError(5.0, 2.0, 3))
    assert late.file_name == "square_sawyer_gated_masked_noise5mm2deg_latency3_0.json"
    assert replace(plain, pose_filter=8).file_name == "square_sawyer_gated_masked_filter8_0.json"


def test_printed_line():
    assert "1/2" in str(result())
    assert "1 time-out" in str(result())
    assert "noise5mm2deg" in str(result())

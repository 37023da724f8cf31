import json

from ocplanner.report.results import read_results
from ocplanner.transfer.result import Run, TransferResult, result_name


def result() -> TransferResult:
    runs = (Run(10000, True, 150, None, "follower"), Run(10001, False, 400, "time-out", None))
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
    assert read_results(path)[0].setting == "gated, masked, stock visuals"


def test_names():
    assert result_name("Square", "Sawyer", "gated", "masked", 0) == "square_sawyer_gated_masked_0.json"
    assert result_name("Square", "UR5e", "open-loop", "no-robot", None) == "square_ur5e_open-loop_no-robot.json"
    assert "error2" in result_name("Square", "Sawyer", "gated", "masked", 0, 2)
    assert "stock" in result_name("Square", "Sawyer", "gated", "masked", 0, visual="stock")


def test_printed_line():
    assert "1/2" in str(result())
    assert "1 time-out" in str(result())

"""The rows of ``heldout.json``."""

import json

import pytest

from ocplanner.errors import ResultFileError
from ocplanner.reproduction import held_out
from ocplanner.reproduction.experiments import PlannerExperiment

ONE, TWO, SHORT = PlannerExperiment(), PlannerExperiment(seed=1), PlannerExperiment(horizon=5)
ORDER = (ONE, TWO, SHORT)


def train(work, experiment, ade):
    (work / experiment.name).mkdir(parents=True, exist_ok=True)
    rows = [{"stage": "predictor", "step": 1}, {"stage": "final", "candidate": "predictor", "ade_mm": ade}]
    (work / experiment.name / "metrics.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))


def written(results):
    return [(row["planner"], row["ade_mm"]) for row in held_out.read(results)["rows"]]


def test_rows_of_other_planners_stay_and_those_of_the_same_are_replaced(tmp_path):
    work, results = tmp_path / "work", tmp_path / "results"
    for experiment, ade in ((SHORT, 5.0), (TWO, 2.0)):
        train(work, experiment, ade)
        held_out.write([experiment], ORDER, work, results, "first")
    train(tmp_path / "new", ONE, 1.0)
    train(tmp_path / "new", TWO, 2.5)
    held_out.write([ONE, TWO], ORDER, tmp_path / "new", results, "second")
    assert written(results) == [(ONE.name, 1.0), (TWO.name, 2.5), (SHORT.name, 5.0)]
    assert held_out.read(results)["command"] == "second"
    held_out.write([], (), tmp_path, results, "third")
    assert written(results) == [(ONE.name, 1.0), (TWO.name, 2.5), (SHORT.name, 5.0)]


def test_a_row_measured_with_other_versions_says_so(tmp_path):
    old = {"versions": {"torch": "1.0"}, "rows": [{"planner": ONE.name, "ade_mm": 1.0}]}
    tmp_path.joinpath("heldout.json").write_text(json.dumps(old))
    train(tmp_path / "work", TWO, 2.0)
    for _ in range(2):
        held_out.write([TWO], ORDER, tmp_path / "work", tmp_path, "again")
    one, two = held_out.read(tmp_path)["rows"]
    assert one["versions"] == {"torch": "1.0"}
    assert "versions" not in two


def test_a_planner_that_transfers_run_is_kept_only_with_its_file(tmp_path):
    for experiment in (ONE, SHORT):
        assert not held_out.is_kept(experiment, tmp_path)
        train(tmp_path / "work", experiment, 1.0)
    held_out.write([ONE, SHORT], ORDER, tmp_path / "work", tmp_path, "made")
    assert held_out.is_kept(SHORT, tmp_path)
    assert not held_out.is_kept(ONE, tmp_path)
    ONE.file(tmp_path).parent.mkdir()
    ONE.file(tmp_path).touch()
    assert held_out.is_kept(ONE, tmp_path)


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"rows": [{}]}', '{"rows": 3}'])
def test_a_damaged_file_is_an_error_and_stays(tmp_path, text):
    path = tmp_path / "heldout.json"
    path.write_text(text)
    with pytest.raises(ResultFileError, match="is damaged"):
        held_out.write([], ORDER, tmp_path, tmp_path, "made")
    assert path.read_text() == text

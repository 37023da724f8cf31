import json
from pathlib import Path

import numpy as np
import pytest

from ocplanner import PolicyResult
from ocplanner.errors import InvalidValueError, ResultFileError
from ocplanner.files.records.evaluation import EvaluationSettings
from ocplanner.files.records.labels import LabelRecord
from ocplanner.policies.config import training_from_dict
from random_policy import random_training, result_of

COMMITTED = Path(__file__).parents[3] / "results" / "policies"


@pytest.fixture
def result():
    settings = EvaluationSettings(4, horizon=100)
    return result_of(
        random_training(), [4, 0, 1, 2, 1, 0, 1], 4, settings=settings, rewards=LabelRecord("ab", {"reward": "only"})
    )


def test_the_two_rates_that_papers_report(result):
    assert result.best == 1
    assert result.last_five == 0.25
    assert [checkpoint.step for checkpoint in result.last_checkpoints] == [300, 400, 500, 600, 700]
    assert result.last_outcomes.reshape(5, 4).sum(axis=1).tolist() == [1, 2, 1, 0, 1]
    many = result_of(random_training(), [0, 10, 5, 5, 4, 6, 5])
    assert many.best == 1.0
    np.testing.assert_allclose(many.last_five, 0.5)
    assert "best 100.0 %, mean of the last 5 50.0 %" in str(many)


def test_failures_are_counted_by_class(result):
    assert result.checkpoints[1].failures == {"time-out": 4}
    assert str(result).splitlines()[2] == "step 200: 0/4 succeeded, 95 % interval 0.00-0.49; 4 time-out"


def test_a_saved_result_is_read_back(result, tmp_path):
    assert PolicyResult.load(result.save(tmp_path / "result.json")) == result


@pytest.mark.parametrize("path", sorted(COMMITTED.glob("*.json")), ids=lambda path: path.stem)
def test_files_of_format_1_are_read(path):
    content, result = json.loads(path.read_text()), PolicyResult.load(path)
    assert "format" not in content
    assert (result.best, result.last_five) == pytest.approx((content["best"], content["last_five"]))
    seeds = [run.seed for checkpoint in result.checkpoints for run in checkpoint.runs]
    assert seeds == list(range(result.settings.seed_start, result.settings.seed_start + len(seeds)))
    assert result.settings.episodes == content["episodes"] == len(result.checkpoints[0].runs)
    assert [one.interval for one in result.checkpoints] == [tuple(one["interval"]) for one in content["checkpoints"]]
    training = training_from_dict(result.training)
    assert (training.algorithm, training.seed) == (result.algorithm, content["training"]["seed"])


def test_a_newer_format_is_not_misread(result, tmp_path):
    (tmp_path / "result.json").write_text(json.dumps(result.to_json() | {"format": 3}))
    with pytest.raises(ResultFileError, match=r"result\.json has format 3, but this version reads 1 to 2"):
        PolicyResult.load(tmp_path / "result.json")


@pytest.mark.parametrize(
    "change", [{"checkpoints": []}, {"checkpoints": [{}]}, {"checkpoints": 3}, {"versions": 3}, {"task": None}]
)
def test_damaged_results_are_refused(result, tmp_path, change):
    content = result.to_json() | change
    if change.get("task", "") is None:
        del content["task"]
    (tmp_path / "result.json").write_text(json.dumps(content))
    with pytest.raises(ResultFileError, match=r"result\.json is no evaluation"):
        PolicyResult.load(tmp_path / "result.json")


def test_successes_must_be_those_of_the_runs(result, tmp_path):
    content = result.to_json()
    content["checkpoints"][0]["successes"] = 3
    (tmp_path / "result.json").write_text(json.dumps(content))
    with pytest.raises(ResultFileError, match="step 100 counts 3 successes, but its runs have 4"):
        PolicyResult.load(tmp_path / "result.json")


@pytest.mark.parametrize("text", ["", "[1, 2", "[]"])
def test_what_is_no_result_is_refused(tmp_path, text):
    (tmp_path / "result.json").write_text(text)
    with pytest.raises(ResultFileError, match=r"result\.json"):
        PolicyResult.load(tmp_path / "result.json")
    with pytest.raises(ResultFileError, match="cannot read"):
        PolicyResult.load(tmp_path / "absent.json")


@pytest.mark.parametrize("name", ["episodes", "last", "horizon"])
def test_impossible_settings(name):
    with pytest.raises(InvalidValueError, match=f"{name} is 0, but must be at least 1"):
        EvaluationSettings(**{name: 0})

import json

import pytest

from ocplanner import PolicyResult
from ocplanner.errors import ResultFileError
from ocplanner.files.records.episode import EpisodeResult
from ocplanner.policies.result import Checkpoint


@pytest.fixture
def result():
    def runs(good: int) -> tuple[EpisodeResult, ...]:
        return tuple(EpisodeResult(i, i < good, 90, None if i < good else "time-out", None) for i in range(4))

    checkpoints = tuple(Checkpoint(10 * (i + 1), f"{i}", runs(good)) for i, good in enumerate([4, 0, 1, 2, 1, 0, 1]))
    return PolicyResult("Square", "Panda", "bc", {"seed": 1}, None, None, 4, checkpoints, "command", {"numpy": "1"})


def test_the_two_numbers_that_papers_report(result):
    assert result.best == 1
    assert result.last_five == 0.25
    assert [checkpoint.step for checkpoint in result.last_checkpoints] == [30, 40, 50, 60, 70]


def test_failures_are_counted_by_class(result):
    assert result.checkpoints[1].failures == {"time-out": 4}
    assert str(result).splitlines()[2] == "step 20: 0/4 succeeded, 95 % interval 0.00-0.49; 4 time-out"


def test_a_saved_result_is_read_back(result, tmp_path):
    assert PolicyResult.load(result.save(tmp_path / "result.json")) == result


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


@pytest.mark.parametrize("text", ["", "[1, 2", "[]"])
def test_what_is_no_result_is_refused(tmp_path, text):
    (tmp_path / "result.json").write_text(text)
    with pytest.raises(ResultFileError, match=r"result\.json"):
        PolicyResult.load(tmp_path / "result.json")
    with pytest.raises(ResultFileError, match="cannot read"):
        PolicyResult.load(tmp_path / "absent.json")

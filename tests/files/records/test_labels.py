import json
from pathlib import Path

import pytest

from ocplanner.errors import DatasetError
from ocplanner.files.records.labels import ActionScale, FileIdentity, LabelRecord
from ocplanner.guidance.rewards import RewardConfig
from ocplanner.guidance.settings import LabelSettings
from ocplanner.settings import build

RESULTS = Path(__file__).parents[3] / "results" / "policies"


def recorded() -> list[dict]:
    """The records of labels in committed results, which are those of the policies' files."""
    results = [json.loads(path.read_text()) for path in sorted(RESULTS.glob("*.json"))]
    found = [result.get(key) for result in results for key in ("labels", "rewards")]
    return [record for record in found if record is not None]


def test_committed_records_are_written_as_they_were_read():
    assert len(recorded()) > 3
    for values in recorded():
        assert json.loads(LabelRecord.from_json(json.dumps(values)).to_json()) == values


def test_values_are_typed():
    hinted = next(values for values in recorded() if "action_frame" in values)
    record = LabelRecord.from_json(json.dumps(hinted))
    assert record.action_scale == ActionScale(0.05, 0.5)
    assert record.action_frame == "world"
    assert record.planner is not None
    assert (record.planner.object, record.planner.cameras) == ("SquareNut", ("agentview",))
    assert record.source == FileIdentity(**hinted["source"])
    settings = LabelSettings.of(record)
    assert settings.horizon_steps == tuple(hinted["settings"]["horizon_steps"])
    assert settings.reward_config == RewardConfig(**hinted["settings"]["reward_config"])


def test_settings_that_do_not_apply_are_left_out():
    text = LabelRecord("ab", {"reward": "only"}).to_json()
    assert json.loads(text) == {
        "planner_sha256": "ab",
        "settings": {"reward": "only"},
        "versions": {},
        "pictures": None,
    }


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"settings": {}}, "planner_sha256 is missing"),
        ({"planner_sha256": "ab"}, "settings is missing"),
        ({"planner_sha256": "ab", "settings": {}, "action_scale": {"position": 1}}, "action_scale.rotation is missing"),
    ],
)
def test_a_fault_is_named(values, message):
    with pytest.raises(ValueError, match=message):
        build(LabelRecord, values)


def test_a_wrong_setting_is_named():
    with pytest.raises(DatasetError, match=r"horizon_steps\[0\] is 'x', expected a whole number"):
        LabelSettings.of(LabelRecord("ab", {"horizon_steps": ["x"]}))

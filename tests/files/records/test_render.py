import json
from typing import get_args, get_type_hints

import pytest

from ocplanner.envs.visuals import Observe
from ocplanner.files.records.render import RenderRecord

WRITTEN = {
    "cameras": ["agentview"],
    "frames": "all",
    "mask_rgb": [255, 0, 255],
    "observe": "masked",
    "silhouette_stride": 1,
    "silhouettes": ["IIWA", "Kinova3"],
    "size": 84,
    "versions": {"mujoco": "3.6.0"},
    "visual": "fast",
}
"""As the first release wrote it."""


def test_what_was_written_is_read_and_written_the_same():
    text = json.dumps(WRITTEN, sort_keys=True)
    record = RenderRecord.from_json(text)
    assert record.silhouettes == ("IIWA", "Kinova3")
    assert record.mask_rgb == (255, 0, 255)
    assert record.to_json() == text


def test_a_file_may_say_less_or_more():
    assert RenderRecord.from_json("{}") == RenderRecord()
    assert RenderRecord.from_json('{"size": 8, "of a later version": 1}') == RenderRecord(size=8)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ("{", "Expecting"),
        ("[]", "expected a mapping"),
        ('{"observe": "x-ray"}', "x-ray.*known: full, masked, no-robot"),
        ('{"mask_rgb": [255, 0]}', "mask_rgb is .*, expected 3 entries"),
        ('{"cameras": "agentview"}', "cameras is 'agentview', expected a list"),
    ],
)
def test_what_is_wrong_is_an_error(wrong, message):
    with pytest.raises(ValueError, match=message):
        RenderRecord.from_json(wrong)


def test_the_observations_are_those_of_the_simulation():
    assert get_args(get_type_hints(RenderRecord)["observe"]) == get_args(Observe)

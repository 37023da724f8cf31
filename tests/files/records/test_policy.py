import json
from dataclasses import replace

import pytest

from ocplanner.errors import InvalidValueError, ModelFileError
from ocplanner.files.records.labels import ActionScale
from ocplanner.files.records.policy import PolicyHeader

HEADER = PolicyHeader(
    task="Square",
    robots=("Panda",),
    object_layout="absolute-first",
    action_frame="world",
    action_scale=ActionScale(0.05, 0.5),
    render=None,
    labels=None,
    low_dim=23,
    actions=7,
    algorithm="bc",
    seed=1,
    step=20,
    training={"algorithm": "bc", "seed": 1},
)


def changed(**changes) -> dict[str, str]:
    content = json.loads(HEADER.metadata()["ocplanner"])
    content["config"] = {key: value for key, value in (content["config"] | changes).items() if value != "left out"}
    return {"ocplanner": json.dumps(content)}


def test_a_header_is_read_back():
    assert PolicyHeader.from_metadata(HEADER.metadata()) == HEADER
    assert PolicyHeader.from_metadata(changed(later="unknown")) == HEADER


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"task": {}}, "task is {}, expected a text"),
        ({"task": "left out"}, "task is missing"),
        ({"robots": [1]}, r"robots\[0\] is 1"),
        ({"step": "x"}, "step is 'x', expected a whole number"),
        ({"step": "left out"}, "step is missing"),
        ({"render": []}, "render is"),
        ({"labels": 1}, "labels is 1"),
        ({"action_scale": None}, "action_frame is 'world', but action_scale is None"),
        ({"action_scale": {}}, "action_scale.position is missing"),
        ({"action_frame": 1}, "action_frame is 1, expected one of world, base"),
        ({"object_layout": {}}, "object_layout is {}"),
    ],
)
def test_every_field_is_checked(change, message):
    with pytest.raises(ModelFileError, match=message):
        PolicyHeader.from_metadata(changed(**change))


def test_what_is_no_header_is_refused():
    for metadata in ({}, {"ocplanner": "{"}, {"ocplanner": "[]"}):
        with pytest.raises(ModelFileError, match="no header of ocplanner's"):
            PolicyHeader.from_metadata(metadata)
    with pytest.raises(ModelFileError, match="it holds a planner"):
        PolicyHeader.from_metadata({"ocplanner": json.dumps({"format": 1, "kind": "planner", "config": {}})})
    with pytest.raises(ModelFileError, match="it has format 3, and this version reads 1 to 2"):
        PolicyHeader.from_metadata({"ocplanner": json.dumps({"format": 3, "kind": "policy", "config": {}})})


def test_frame_and_scale_belong_together():
    with pytest.raises(InvalidValueError, match="action_frame is None"):
        replace(HEADER, action_frame=None)

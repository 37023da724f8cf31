import json
from dataclasses import replace
from pathlib import Path

import pytest
from safetensors import safe_open

from ocplanner.errors import ModelFileError
from ocplanner.files.records.planner import EncoderHeader, PlannerHeader
from random_planner import planner_config

COMMITTED = sorted((Path(__file__).parents[3] / "results").rglob("planners/*.safetensors"))


def header(**changes) -> PlannerHeader:
    return PlannerHeader.from_json(json.dumps(planner_config(**changes)))


def written(about: PlannerHeader) -> dict:
    return json.loads(about.metadata()["ocplanner"])


@pytest.mark.parametrize("path", COMMITTED, ids=lambda path: path.stem)
def test_committed_planners_are_written_as_they_were_read(path):
    with safe_open(path, framework="numpy") as file:
        stored = json.loads(file.metadata()["ocplanner"])
    stored["config"].setdefault("control_freq", 20.0)  # older files do not say
    assert written(PlannerHeader.from_json(json.dumps(stored["config"]))) == stored


def test_there_are_committed_planners():
    assert COMMITTED


def test_values_are_typed():
    about = header(cameras=["agentview", "sideview"], modes=3)
    assert (about.task, about.object, about.horizon, about.modes) == ("Square", "SquareNut", 6, 3)
    assert about.cameras == ("agentview", "sideview")
    assert about.mask_rgb == (255, 0, 255)
    assert about.normaliser.std == (0.12, 0.09, 0.06)
    assert about.encoder == EncoderHeader(
        type="small", channels=(16, 32, 64), pool="spatial_softmax", keypoints=32, feature=64
    )
    assert written(about)["config"]["encoder"]["channels"] == [16, 32, 64]
    assert "temperature" not in written(about)["config"]["encoder"]


def test_what_the_engine_does_not_need_may_be_missing():
    config = planner_config()
    for name in ("modes", "source_robot", "seed", "versions", "training"):
        del config[name]
    about = PlannerHeader.from_json(json.dumps(config))
    assert (about.modes, about.source_robot, about.seed) == (1, None, None)
    assert about == replace(header(), source_robot=None, seed=None, versions={})


def test_fields_of_later_versions_are_ignored():
    assert header(colour="blue", decoder={"hidden": 32, "layers": 2}) == header()


@pytest.mark.parametrize(
    "name", ["task", "object", "observe", "visual", "mask_rgb", "normaliser", "encoder", "cameras"]
)
def test_a_missing_field_is_named(name):
    config = planner_config()
    del config[name]
    with pytest.raises(ModelFileError, match=f"{name} is missing; train the planner again"):
        PlannerHeader.from_json(json.dumps(config))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"task": 3}, "task is 3, expected a text"),
        ({"horizon": "6"}, "horizon is '6', expected a whole number"),
        ({"horizon": True}, "horizon is True, expected a whole number"),
        ({"observe": "naked"}, "unknown observe 'naked'; known: full, masked, no-robot"),
        ({"cameras": "agentview"}, "cameras is 'agentview', expected a list"),
        ({"cameras": [1]}, r"cameras\[0\] is 1, expected a text"),
        ({"mask_rgb": [0, 0]}, r"mask_rgb is \[0, 0\], expected 3 entries"),
        ({"normaliser": {"mean": [0, 0, 0]}}, "normaliser.std is missing"),
        ({"decoder": {}}, "decoder.hidden is missing"),
        ({"training": {"held_out": {"source": {"ade_mm": None}}}}, "training.held_out.source.ade_mm is None"),
        ({"training": []}, r"training is \[\], expected a mapping"),
    ],
)
def test_a_wrong_field_is_named(changes, message):
    with pytest.raises(ModelFileError, match=message):
        header(**changes)


@pytest.mark.parametrize("text", ["[]", "null", "{"])
def test_what_is_no_header(text):
    with pytest.raises(ModelFileError, match="header cannot be read"):
        PlannerHeader.from_json(text)

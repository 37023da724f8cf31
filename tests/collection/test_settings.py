import subprocess
import sys

import pytest

from ocplanner.collection.settings import CollectSettings, RenderSettings
from ocplanner.errors import InvalidValueError, UnknownNameError


@pytest.mark.parametrize(
    "wrong",
    [
        {"size": 0},
        {"silhouette_stride": 0},
        {"cameras": ()},
        {"observe": "full", "silhouettes": ("IIWA",)},
    ],
)
def test_impossible_settings_are_refused(wrong):
    with pytest.raises(InvalidValueError):
        RenderSettings(**wrong)


@pytest.mark.parametrize(
    "wrong", [{"observe": "half"}, {"frames": "some"}, {"visual": "nice"}, {"silhouettes": ("PR2",)}]
)
def test_unknown_names_are_refused(wrong):
    with pytest.raises(UnknownNameError, match="known"):
        RenderSettings(**wrong)


def test_only_masked_images_have_silhouettes_unless_none_are_wanted():
    assert RenderSettings().silhouette_arms == ("IIWA", "Kinova3")
    assert RenderSettings(silhouettes=()).silhouette_arms == ()
    assert RenderSettings(silhouettes=("UR5e",)).silhouette_arms == ("UR5e",)
    assert RenderSettings(observe="full").silhouette_arms == ()


def test_the_record_embeds_every_setting():
    record = RenderSettings(cameras=("agentview", "sideview"), size=96, frames="manipulation").record()
    assert (record.observe, record.cameras, record.size) == ("masked", ("agentview", "sideview"), 96)
    assert (record.silhouettes, record.frames, record.mask_rgb) == (("IIWA", "Kinova3"), "manipulation", (255, 0, 255))
    assert record.versions["ocplanner"]


@pytest.mark.parametrize(
    ("wrong", "error"),
    [
        ({"robot": "Nobody"}, UnknownNameError),
        ({"task": "Nothing"}, UnknownNameError),
        ({"flaw": "sloth"}, UnknownNameError),
        ({"seed": 10}, InvalidValueError),  # its seeds are kept for evaluation
        ({"seed": -1}, InvalidValueError),
        ({"episodes": 0}, InvalidValueError),
        ({"noise": -0.1}, InvalidValueError),
        ({"noise": float("nan")}, InvalidValueError),
    ],
)
def test_impossible_collections_are_refused(wrong, error):
    with pytest.raises(error):
        CollectSettings(**wrong)


def test_settings_load_no_simulator():
    program = "import sys, ocplanner.collection.settings; print({'mujoco', 'robosuite', 'torch'} & {*sys.modules})"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"

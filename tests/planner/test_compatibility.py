import json
import shutil

import h5py
import pytest

from ocplanner.demos.dataset import Demonstrations
from ocplanner.errors import MismatchError
from ocplanner.files.records.render import RENDER_ATTRIBUTE
from ocplanner.planner.compatibility import check_fit
from ocplanner.planner.planner import Planner
from random_planner import write_random_planner

DRAWN = {"observe": "masked", "visual": "fast", "mask_rgb": [255, 0, 255]}


@pytest.fixture
def check(tiny_square, tmp_path):
    def run(drawn, **planner):
        write_random_planner(tmp_path / "p.safetensors", **planner)
        path = shutil.copy(tiny_square("1.4.1", images=True), tmp_path / "data.hdf5")
        with h5py.File(path, "r+") as file:
            if drawn is not None:
                file["data"].attrs[RENDER_ATTRIBUTE] = json.dumps(drawn)
        with Demonstrations(path) as demos:
            check_fit(Planner.load(tmp_path / "p.safetensors"), demos)

    return run


def test_what_fits(check):
    check(DRAWN)
    check({**DRAWN, "visual": "stock"}, visual=None)  # a planner that does not know its preset
    check(None, observe="full", visual=None)


@pytest.mark.parametrize(
    ("drawn", "planner", "message"),
    [
        (None, {}, "drawn with observe=full, .*--observe masked --cameras agentview --size 84 --visual fast"),
        ({**DRAWN, "observe": "no-robot"}, {}, "observe=no-robot, .*trained on masked"),
        ({**DRAWN, "visual": "stock"}, {}, "visual=stock, .*trained on fast"),
        ({"observe": "masked", "mask_rgb": [255, 0, 255]}, {}, "visual=unknown"),
        ({**DRAWN, "mask_rgb": [0, 0, 0]}, {}, "colour"),
        (DRAWN, {"image_size": 96}, "84x84, but the planner reads 96x96"),
        (DRAWN, {"task": "Lift", "object": "cube"}, "cube of Lift, .*NutAssemblySquare"),
        (DRAWN, {"object": "RoundNut"}, "RoundNut of Square"),
    ],
)
def test_what_does_not(check, drawn, planner, message):
    with pytest.raises(MismatchError, match=message):
        check(drawn, **planner)


def test_a_missing_camera(check):
    with pytest.raises(
        MismatchError, match=r"no images of camera side.*there are: agentview.*--cameras agentview side"
    ):
        check(DRAWN, cameras=["agentview", "side"])

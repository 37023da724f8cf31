"""What a planner file says about how it wants to see, against what is asked for."""

import pytest

from ocplanner.errors import MismatchError
from ocplanner.planner.planner import Planner
from ocplanner.zero_shot.scenario import make_scenario
from random_planner import write_random_planner


@pytest.fixture(scope="module")
def planner(tmp_path_factory):
    path = tmp_path_factory.mktemp("planner") / "p.safetensors"
    write_random_planner(path)
    return Planner.load(path)


def test_mask_error_needs_masks(tmp_path):
    path = tmp_path / "p.safetensors"
    write_random_planner(path, observe="full")
    with pytest.raises(MismatchError, match="masked"):
        make_scenario(Planner.load(path), "Sawyer", mask_error=2)


def test_the_visual_preset_is_the_planners_unless_a_mismatch_is_asked_for(planner):
    assert make_scenario(planner, "Sawyer").visual == "fast"
    assert make_scenario(planner, "Sawyer", visual="fast").visual == "fast"
    assert make_scenario(planner, "Sawyer", visual="stock", allow_mismatch=True).visual == "stock"


def test_images_of_an_unknown_preset_want_it_named(tmp_path):
    path = tmp_path / "p.safetensors"
    write_random_planner(path, visual=None)
    planner = Planner.load(path)
    with pytest.raises(MismatchError, match="does not say with which visual preset"):
        make_scenario(planner, "Sawyer")
    assert make_scenario(planner, "Sawyer", visual="stock").visual == "stock"


def test_patches_are_recorded_and_switchable(planner):
    assert make_scenario(planner, "Sawyer").patches == ("sawyer-base-contact",)
    assert make_scenario(planner, "Sawyer", patches=()).patches == ()

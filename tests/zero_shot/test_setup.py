"""What a planner file says about its images, against what is asked for."""

import pytest

from ocplanner.errors import MismatchError
from ocplanner.planner.planner import Planner
from ocplanner.zero_shot.settings import TransferConfig
from ocplanner.zero_shot.setup import TransferSetup
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
        TransferSetup.of(path, config=TransferConfig(mask_error=2))


def test_the_visual_preset_is_the_planners_unless_a_mismatch_is_asked_for(planner):
    for config in (TransferConfig(), TransferConfig(visual="fast"), TransferConfig(allow_mismatch=True)):
        result = TransferSetup.of(planner, config=config).result
        assert (result.visual, result.settings) == ("fast", TransferConfig())
    stock = TransferConfig(visual="stock", allow_mismatch=True)
    result = TransferSetup.of(planner, config=stock).result
    assert (result.visual, result.settings) == ("stock", stock)


def test_images_of_an_unknown_preset_want_it_named(tmp_path):
    path = tmp_path / "p.safetensors"
    write_random_planner(path, visual=None)
    with pytest.raises(MismatchError, match="does not say with which visual preset"):
        TransferSetup.of(path)
    assert TransferSetup.of(path, config=TransferConfig(visual="stock")).result.visual == "stock"


def test_patches_are_recorded_and_switchable(planner):
    assert TransferSetup.of(planner).result.patches == ("sawyer-base-contact",)
    assert TransferSetup.of(planner, config=TransferConfig(patches=False)).result.patches == ()


@pytest.mark.parametrize(("observe", "privileged"), [("masked", 1), ("no-robot", 2)])
def test_what_a_real_robot_does_not_have_is_named(tmp_path, observe, privileged):
    path = tmp_path / "p.safetensors"
    write_random_planner(path, observe=observe)
    assert TransferSetup.of(path).result.privileged == ("object pose", "hidden robot")[:privileged]


def test_the_planner_files_are_recorded_as_they_were_named(planner, tmp_path, monkeypatch):
    monkeypatch.chdir(planner.path.parent)
    setup = TransferSetup.of("p.safetensors")
    assert setup.result.planners == ("p.safetensors",)
    assert setup.planners == (planner.path,)

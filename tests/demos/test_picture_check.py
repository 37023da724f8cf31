"""Pictures of either preset are told apart by drawing them, and upside-down ones are refused."""

import h5py
import numpy as np
import pytest

from ocplanner.collection.collect import collect
from ocplanner.collection.render import render_dataset
from ocplanner.collection.settings import CollectSettings, RenderSettings
from ocplanner.demos.convert import ConvertSettings, convert_dataset
from ocplanner.demos.dataset import Demonstrations
from ocplanner.demos.picture_check import measured_visual
from ocplanner.errors import MismatchError
from ocplanner.files.records.render import RENDER_ATTRIBUTE

CAMERAS = ("agentview", "robot0_eye_in_hand")


@pytest.fixture(scope="module")
def collected(tmp_path_factory):
    path = tmp_path_factory.mktemp("pictures") / "lift.hdf5"
    return collect(path, CollectSettings("Lift", episodes=1)).path


@pytest.fixture(scope="module", params=["fast", "stock"])
def drawn(request, collected, tmp_path_factory):
    """Lift in a preset: its name and the file, which still says it."""
    path = tmp_path_factory.mktemp("pictures") / f"{request.param}.hdf5"
    settings = RenderSettings("full", CAMERAS, 32, request.param)
    return request.param, render_dataset(collected, path, settings)


def changed(path, tmp_path, edit):
    """A copy without the record of how it was drawn."""
    copy = tmp_path / "changed.hdf5"
    copy.write_bytes(path.read_bytes())
    with h5py.File(copy, "a") as file:
        del file["data"].attrs[RENDER_ATTRIBUTE]
        edit(file)
    return Demonstrations(copy)


@pytest.mark.parametrize("camera", CAMERAS)
def test_the_preset_is_measured(drawn, tmp_path, camera):
    preset, path = drawn
    with Demonstrations(path) as demos:
        assert measured_visual(demos, (camera,)) == preset
    with changed(path, tmp_path, lambda _: None) as demos:
        assert measured_visual(demos, ("no_such_camera", camera)) == preset


def test_upside_down_pictures_are_refused_and_the_remedy_works(drawn, tmp_path):
    preset, path = drawn

    def turn(file):
        for demo in file["data"].values():
            demo["obs/agentview_image"][:] = demo["obs/agentview_image"][:][:, ::-1]

    with changed(path, tmp_path, turn) as demos, pytest.raises(MismatchError, match=r"upside down.*--flip-images"):
        measured_visual(demos, ("agentview",))
    turned = convert_dataset(demos.path, tmp_path / "turned.hdf5", ConvertSettings(flip_images=True))
    with Demonstrations(turned) as demos:
        assert measured_visual(demos, ("agentview",)) == preset


def test_a_record_that_lies_is_found_out(drawn, tmp_path):
    preset, path = drawn
    other = "stock" if preset == "fast" else "fast"

    def lie(file):
        file["data"].attrs[RENDER_ATTRIBUTE] = f'{{"observe": "full", "visual": "{other}"}}'

    with changed(path, tmp_path, lie) as demos, pytest.raises(MismatchError, match=f"are {other}, but .* are {preset}"):
        measured_visual(demos, CAMERAS)


def test_what_cannot_be_compared_is_not_guessed(drawn, tmp_path):
    def noise(file):
        for demo in file["data"].values():
            images = demo["obs/agentview_image"]
            images[:] = np.random.default_rng(0).integers(0, 256, images.shape)

    def stateless(file):
        for demo in file["data"].values():
            del demo["states"]

    def blend(file):  # neither one preset nor the other
        for demo in file["data"].values():
            images = demo["obs/agentview_image"][:]
            demo["obs/agentview_image"][:] = images // 2 + images[:, ::-1] // 2

    for edit in (noise, stateless, blend):
        with changed(drawn[1], tmp_path, edit) as demos:
            assert measured_visual(demos, ("agentview",)) is None
    with Demonstrations(drawn[1]) as demos:
        assert measured_visual(demos, ("sideview",)) is None

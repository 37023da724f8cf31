import importlib
import time
import urllib.request

import numpy as np
import pytest

from ocplanner.errors import OutputError, VersionError
from ocplanner.report.viewer import Viewer


@pytest.fixture
def viewer(playback):
    with Viewer(playback, port=0) as viewer:
        viewer.playing.value = False
        yield viewer


def node(viewer, name):
    return viewer.server.scene.get_handle_by_name(name)


def test_the_page_is_served_on_this_machine_until_closed(playback):
    with Viewer(playback, port=0) as viewer:
        assert viewer.address.startswith("http://127.0.0.1:")
        with urllib.request.urlopen(viewer.address, timeout=20) as page:  # noqa: S310
            assert b"<html" in page.read()
    with pytest.raises(OSError, match=r"refused|closed|reset"):
        urllib.request.urlopen(viewer.address, timeout=5)  # noqa: S310


def test_everything_moves_with_the_time(viewer, playback):
    viewer.slider.value = 5
    np.testing.assert_allclose(node(viewer, "/bodies/box").position, playback.positions["box"][5])
    assert len(node(viewer, "/achieved").points) == 6
    assert not node(viewer, "/planned").visible
    viewer.slider.value = 30
    assert node(viewer, "/planned").visible
    np.testing.assert_allclose(node(viewer, "/planned").points, playback.planned[30], atol=1e-6)


def test_steps_beyond_the_end_show_the_end_and_its_outcome(viewer):
    viewer.show(1000)
    assert viewer.step == 39
    assert "success" in viewer.text.content


def wait_for_the_end(viewer):
    deadline = time.monotonic() + 60
    while viewer.playing.value and time.monotonic() < deadline:
        time.sleep(0.02)
    assert viewer.step == viewer.slider.value == 39


def test_it_plays_to_the_end_and_from_the_beginning_when_asked_again(playback):
    with Viewer(playback, port=0) as viewer:
        viewer.speed.value = 50.0
        wait_for_the_end(viewer)
        viewer.playing.value = True
        assert viewer.slider.value < 39
        wait_for_the_end(viewer)


def test_a_port_that_is_taken_is_an_error(viewer, playback):
    with pytest.raises(OutputError, match="choose another --port"):
        Viewer(playback, port=viewer.server.get_port())


def test_without_viser_the_extra_is_named(playback, monkeypatch):
    def missing(name):
        raise ModuleNotFoundError(name)

    monkeypatch.setattr(importlib, "import_module", missing)
    with pytest.raises(VersionError, match=r"ocplanner\[viewer\]"):
        Viewer(playback, port=0)

"""Serving a playback to the browser with viser."""

import importlib
import socket
import threading
from typing import Any, Self

import numpy as np
from matplotlib.colors import to_rgb

from ocplanner.drawing.style import ACHIEVED, PLANNED
from ocplanner.errors import OutputError, VersionError
from ocplanner.report.viewer.playback import Playback

_CONTROL_HZ = 20


class Viewer:
    """A web page with a playback: robot, objects, planned and achieved path, and a time slider.

    Use it as a context manager, or call :meth:`close`. The page loads nothing from elsewhere.

    Args:
        playback: the episode.
        host: address to listen on; the default is reached from this machine only.
        port: 0 lets the system choose.

    Attributes:
        server: viser's server.
        step: the step that is shown.
        slider, playing, speed, text: viser's handles of the controls; their ``value`` or ``content`` may be set.

    Raises:
        VersionError: viser is not installed.
        OutputError: the port is taken.
    """

    def __init__(self, playback: Playback, host: str = "127.0.0.1", port: int = 8080) -> None:
        viser = load_viser()
        port = _free_port(host, port)
        self._playback, self.step = playback, 0
        self.server = viser.ViserServer(host=host, port=port, verbose=False)
        self._build()
        self._closed = threading.Event()
        self._clock = threading.Thread(target=self._play, daemon=True)
        self._clock.start()

    @property
    def address(self) -> str:
        """Where the page is."""
        return f"http://{self.server.get_host()}:{self.server.get_port()}"

    def show(self, step: int) -> None:
        """Move everything to a step, 0 to T - 1."""
        playback, self.step = self._playback, int(np.clip(step, 0, len(self._playback) - 1))
        with self.server.atomic():
            for name, handle in self._bodies.items():
                handle.position = playback.positions[name][self.step]
                handle.wxyz = playback.quats_wxyz[name][self.step]
            planned = playback.planned[self.step]
            self._planned.visible = planned is not None
            if planned is not None:
                self._planned.points = np.asarray(planned, dtype=np.float32)
            self._achieved.points = playback.achieved[: self.step + 1].astype(np.float32)
        last = self.step == len(playback) - 1
        self.text.content = f"{playback.phases[self.step]}{f': **{playback.outcome}**' if last else ''}"

    def close(self) -> None:
        """Stop serving."""
        self._closed.set()
        self._clock.join()
        self.server.stop()

    def __enter__(self) -> Self:
        """Serving began when it was made."""
        return self

    def __exit__(self, *_: object) -> None:
        """Stop serving."""
        self.close()

    def _build(self) -> None:
        scene, gui, playback = self.server.scene, self.server.gui, self._playback
        scene.set_up_direction("+z")
        scene.add_grid("/floor", width=4.0, height=4.0)
        self._bodies = {name: scene.add_mesh_trimesh(f"/bodies/{name}", mesh) for name, mesh in playback.meshes.items()}
        start = playback.achieved[:1].astype(np.float32)
        self._planned = scene.add_point_cloud(
            "/planned", start, _rgb(PLANNED), point_size=0.006, precision="float32", visible=False
        )
        self._achieved = scene.add_point_cloud(
            "/achieved", start, _rgb(ACHIEVED), point_size=0.005, precision="float32"
        )
        look_at = playback.achieved.mean(axis=0)
        self.server.initial_camera.position = tuple(look_at + np.array([0.85, -0.7, 0.5]))
        self.server.initial_camera.look_at = tuple(look_at)
        gui.add_markdown(f"**{playback.title}**\n\nred: the plan in force; cyan: the object's way so far")
        self.text = gui.add_markdown("")
        self.slider = gui.add_slider("step", min=0, max=len(playback) - 1, step=1, initial_value=0)
        self.playing = gui.add_checkbox("play", initial_value=True)
        self.speed = gui.add_slider("speed", min=0.1, max=3.0, step=0.1, initial_value=1.0)
        self.slider.on_update(lambda _: self.show(self.slider.value))
        self.playing.on_update(lambda _: self._start())
        self.show(0)

    def _play(self) -> None:
        """Advance the time while ``play`` is ticked, until the end."""
        while not self._closed.wait(1 / (_CONTROL_HZ * self.speed.value)):
            if self.playing.value and self.slider.value < len(self._playback) - 1:
                self.slider.value += 1
            elif self.playing.value:
                self.playing.value = False

    def _start(self) -> None:
        """Start again if ``play`` is ticked at the end."""
        if self.playing.value and self.slider.value == len(self._playback) - 1:
            self.slider.value = 0


def load_viser() -> Any:
    """The module ``viser``.

    Raises:
        VersionError: it is not installed.
    """
    try:
        return importlib.import_module("viser")
    except ModuleNotFoundError as error:
        raise VersionError("viser is not installed; run: pip install 'ocplanner[viewer]'") from error


def _rgb(colour: str) -> tuple[int, int, int]:
    red, green, blue = (round(255 * part) for part in to_rgb(colour))
    return red, green, blue


def _free_port(host: str, port: int) -> int:
    """The port, or a free one for 0; viser itself would silently take another one."""
    with socket.socket() as probe:
        try:
            probe.bind((host, port))
        except OSError as error:
            raise OutputError(f"cannot listen on {host}:{port}: {error.strerror}; choose another --port") from error
        return int(probe.getsockname()[1])

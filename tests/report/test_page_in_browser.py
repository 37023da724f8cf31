"""The page in a real browser, where one is installed."""

import re
import shutil
import subprocess

import numpy as np
import pytest
from PIL import Image

from ocplanner.drawing.video import write_video
from ocplanner.report.page import write_report

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is installed (apt-get install chromium)")
FLAGS = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--hide-scrollbars"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
)


@pytest.fixture
def browse(tmp_path):
    def run(page, *arguments: str) -> str:
        command = [CHROMIUM, *FLAGS, f"--user-data-dir={tmp_path / 'profile'}", *arguments, page.as_uri()]
        done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True, cwd=tmp_path)
        return done.stdout

    return run


@pytest.fixture
def page(tmp_path, frames, write_run, write_result):
    folder = write_run("run")
    write_result(successes=3, failures=("slip", "not aligned"))
    write_video(tmp_path / "transfer" / "episode_10003.mp4", frames)
    return write_report([tmp_path, folder], tmp_path / "report.html")


@pytest.mark.parametrize("width", [390, 1280])
def test_nothing_is_wider_than_the_screen(page, browse, tmp_path, width):
    probe = tmp_path / "probe.html"
    probe.write_text(
        f"<iframe id=f src={page.name} style='width:{width}px;height:900px;border:0'></iframe>"
        "<script>f.onload = () => { const d = f.contentDocument.documentElement;"
        "document.title = d.scrollWidth + ' ' + d.clientWidth }</script>"
    )
    dom = browse(probe, "--allow-file-access-from-files", "--virtual-time-budget=5000", "--dump-dom")
    needed, given = map(int, re.search(r"<title>(\d+) (\d+)</title>", dom).groups())
    assert (needed, given) == (width, width)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_page_follows_the_colour_scheme(page, browse, tmp_path, scheme):
    setting = f"--blink-settings=preferredColorScheme={['dark', 'light'].index(scheme)}"
    browse(page, setting, "--window-size=390,1200", f"--screenshot={tmp_path / 'shot.png'}")
    with Image.open(tmp_path / "shot.png") as image:
        brightness = np.asarray(image.convert("L"), dtype=float)
    assert (brightness[0, 0] > 200) == (scheme == "light")
    assert brightness.std() > 15


def test_its_videos_play(page, browse, tmp_path):
    source = re.search(r'<video[^>]* src="([^"]+)"', page.read_text()).group(1)
    probe = tmp_path / "probe.html"
    probe.write_text(
        f"<video id=v muted src='{source}'></video><script>v.onerror = () => document.title = v.error.message;"
        "v.onloadeddata = () => document.title = [v.videoWidth, v.videoHeight, v.duration].join(' ')</script>"
    )
    dom = browse(probe, "--virtual-time-budget=10000", "--dump-dom")
    assert re.search(r"<title>([^<]*)</title>", dom).group(1) == "96 64 0.6"

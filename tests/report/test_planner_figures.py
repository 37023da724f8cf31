from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from ocplanner.demos.dataset import Demonstrations
from ocplanner.demos.segments import manipulation_segment
from ocplanner.errors import MismatchError
from ocplanner.files.records.planner import (
    DecoderHeader,
    EncoderHeader,
    NormaliserHeader,
    PlannerHeader,
    PredictorHeader,
)
from ocplanner.report.planner_figures import draw_planners, planner_figures

HORIZON = 4
HEADER = PlannerHeader(
    task="Square", object="SquareNut", cameras=("agentview",), observe="full", visual=None, mask_rgb=None,
    horizon=HORIZON, outputs="position", image_size=84, crop=76, latent=4, seed=0,
    encoder=EncoderHeader(type="small", pool="flatten", feature=8), predictor=PredictorHeader((8,)),
    decoder=DecoderHeader(8), normaliser=NormaliserHeader((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)),
)  # fmt: skip


class Recorded:
    """Stands in for a planner: looks the recorded future up by the image, and moves it 5 cm along x."""

    path = Path("recorded.safetensors")

    def __init__(self, demos: Demonstrations, **header) -> None:
        self.header = replace(HEADER, **header)
        self._future = {}
        for demo in demos:
            positions, rotations = demo.object_poses("SquareNut")
            stop = manipulation_segment(positions, rotations, demo.actions[:, -1]).stop
            for step, image in enumerate(demo.images("agentview")):
                rows = np.minimum(step + 1 + np.arange(HORIZON), stop - 1)
                self._future[image.tobytes()] = positions[rows] + [0.05, 0, 0]

    def plan(self, images):
        return SimpleNamespace(position=np.stack([self._future[image.tobytes()] for image in images["agentview"]]))

    def encode(self, images):
        return images["agentview"][:, ::20, 0, 0].astype(np.float32)


@pytest.fixture
def demos(tiny_square):
    with Demonstrations(tiny_square(images=True)) as demos:
        yield demos


def test_plans_lie_where_the_camera_sees_them(demos):
    figures = planner_figures(Recorded(demos), demos, rows=2, columns=2, demonstrations=3, size=128)
    assert set(figures) == {"plans", "latents"}
    grid = [axes for axes in figures["plans"].axes if axes.images]
    assert [axes.get_title("left").split(",")[0] for axes in grid] == ["demo_2", "demo_2", "demo_0", "demo_0"]
    for axes in grid:
        true, planned = (line.get_xydata() for line in axes.lines)
        assert true.shape == planned.shape == (HORIZON, 2)
        assert (true > 0).all()
        assert (true < 128).all()
        # agentview looks at the robot: 5 cm along x is towards the camera, down in the picture
        assert (planned[:, 1] - true[:, 1] > 2).all()
        np.testing.assert_allclose(planned[:, 0], true[:, 0], atol=6)


def test_the_nut_is_at_the_start_of_its_true_path(demos):
    figure = planner_figures(Recorded(demos), demos, rows=1, columns=1, demonstrations=1, size=256)["plans"]
    axes = next(axes for axes in figure.axes if axes.images)
    x, y = axes.lines[0].get_xydata()[0].astype(int)
    picture = np.asarray(axes.images[0].get_array())
    around = picture[y - 12 : y + 13, x - 12 : x + 13].reshape(-1, 3).astype(int)
    wooden = (around[:, 0] - around[:, 2] > 25).mean()
    assert wooden > 0.2


def test_figures_are_written_by_name(demos, tmp_path, monkeypatch):
    monkeypatch.setattr("ocplanner.planner.planner.Planner.load", lambda _: Recorded(demos))
    written = draw_planners([tmp_path / "h4.safetensors"], [demos.path], tmp_path / "figures")
    assert [path.name for path in written] == ["plans_h4.png", "latents_h4.png", "segments_SquareNut.png"]
    assert all(path.stat().st_size > 5000 for path in written)


def test_two_planners_share_the_figure_of_the_frames_kept(demos, tiny_square, tmp_path, monkeypatch):
    monkeypatch.setattr("ocplanner.planner.planner.Planner.load", lambda _: Recorded(demos))
    planners = [tmp_path / folder / "planner.safetensors" for folder in ("h5", "h20")]
    written = draw_planners(planners, [tiny_square(), demos.path], tmp_path / "figures")
    assert sorted(path.name for path in written) == [
        "latents_h20.png", "latents_h5.png", "plans_h20.png", "plans_h5.png", "segments_SquareNut.png",
    ]  # fmt: skip


def test_a_planner_without_a_data_set_that_fits_is_an_error(demos, tiny_square, tmp_path, monkeypatch):
    monkeypatch.setattr("ocplanner.planner.planner.Planner.load", lambda _: Recorded(demos))
    with pytest.raises(MismatchError, match="no images of camera agentview"):
        draw_planners([tmp_path / "h5.safetensors"], [tiny_square()], tmp_path / "figures")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"cameras": ("sideview",)}, "no images of camera sideview"),
        ({"observe": "masked"}, "drawn with observe=full"),
        ({"task": "Lift"}, "SquareNut of Lift, but .* shows NutAssemblySquare"),
    ],
)
def test_a_data_set_of_another_kind_is_refused(demos, change, message):
    with pytest.raises(MismatchError, match=message):
        planner_figures(Recorded(demos, **change), demos)

import numpy as np
import pytest

from ocplanner.errors import ShapeError
from ocplanner.report.overlays import film_strip, plan_grid

IMAGES = [np.zeros((20, 30, 3), dtype=np.uint8)] * 5
PATHS = [np.linspace([5, 5], [25, 15], 4)] * 5


def test_the_grid_draws_plan_and_truth_over_each_image():
    figure = plan_grid(IMAGES, PATHS, PATHS, titles=[f"step {i}" for i in range(5)], columns=3, title="Plans")
    drawn = [axes for axes in figure.axes if axes.images]
    assert len(drawn) == 5
    for axes in drawn:
        assert [line.get_label() for line in axes.lines] == ["true", "planned"]
        np.testing.assert_array_equal(axes.lines[1].get_xydata(), PATHS[0])
        assert axes.get_ylim() == (20, 0)


def test_short_plans_are_seen_closer_and_with_larger_dots():
    image = np.zeros((500, 500, 3), dtype=np.uint8)
    short = [np.linspace([40, 250], [48, 254], 5), np.linspace([300, 300], [320, 340], 5)]
    long = [np.linspace([40, 250], [400, 254], 50)] * 2
    near = plan_grid([image] * 2, short, short).axes
    far = plan_grid([image] * 2, long, long).axes
    for axes, path in zip(near, short):
        (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
        assert (right - left, bottom - top) == pytest.approx((150, 150))
        assert left >= 0
        assert left <= path[:, 0].min() <= path[:, 0].max() <= right
        assert top <= path[:, 1].min() <= path[:, 1].max() <= bottom
    assert far[0].get_xlim() == (0, 500)
    assert near[0].lines[1].get_markersize() > 1.5 * far[0].lines[1].get_markersize()


@pytest.mark.parametrize(
    ("images", "planned", "true", "titles"),
    [
        ([], [], [], None),
        (IMAGES, PATHS[:4], PATHS, None),
        (IMAGES, PATHS, PATHS, ["one"]),
        ([np.zeros((20, 30), dtype=np.uint8)], PATHS[:1], PATHS[:1], None),
        ([np.zeros((20, 30, 3))], PATHS[:1], PATHS[:1], None),
        (IMAGES[:1], [np.zeros((4, 3))], PATHS[:1], None),
    ],
)
def test_arrays_of_another_shape_are_refused(images, planned, true, titles):
    with pytest.raises(ShapeError):
        plan_grid(images, planned, true, titles=titles)


@pytest.mark.parametrize(("length", "count", "shown"), [(50, 8, 8), (3, 8, 3), (1, 8, 1)])
def test_the_film_strip_runs_from_the_first_frame_to_the_last(length, count, shown):
    frames = np.arange(length, dtype=np.uint8)[:, None, None, None] * np.ones((1, 10, 10, 3), dtype=np.uint8)
    figure = film_strip(frames, count=count, titles=[str(i) for i in range(length)])
    values = [axes.images[0].get_array()[0, 0, 0] for axes in figure.axes]
    assert len(values) == shown
    assert (values[0], values[-1]) == (0, length - 1)
    assert [axes.get_title("left") for axes in figure.axes] == [str(value) for value in values]


def test_a_film_strip_needs_frames():
    with pytest.raises(ShapeError):
        film_strip([])

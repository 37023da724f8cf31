import pytest

from ocplanner.demos.dataset import Demonstrations
from ocplanner.errors import DatasetError, InvalidValueError
from ocplanner.report.demonstrations import observations_figure, paths_figure


def test_paths_lie_in_the_picture_and_run_from_grasp_to_release(tiny_square):
    demos = Demonstrations(tiny_square())
    axes = paths_figure(demos, ["demo_0", "demo_2"], size=128).axes[0]
    assert len(axes.collections) == 2
    for lines in axes.collections:
        points = [segment for segment in lines.get_segments() if len(segment)]
        assert all((segment > 0).all() and (segment < 128).all() for segment in points)
        # agentview looks at the robot: the peg is nearer to the camera, lower in the picture
        assert points[-1][-1][1] > points[0][0][1] + 10


def test_each_observation_mode_is_shown(tiny_square):
    figure = observations_figure(Demonstrations(tiny_square()), "demo_0", 40, size=64)
    assert [axes.get_title("left") for axes in figure.axes] == ["full", "masked", "no-robot"]
    full, masked, hidden = (axes.images[0].get_array() for axes in figure.axes)
    assert (full != masked).any()
    assert (masked != hidden).any()


def test_what_is_not_there_is_an_error(tiny_square):
    demos = Demonstrations(tiny_square())
    with pytest.raises(InvalidValueError, match="steps 0 to 89"):
        observations_figure(demos, "demo_0", 90)
    with pytest.raises(InvalidValueError, match="no demonstration named"):
        paths_figure(demos, [])
    with pytest.raises(DatasetError, match="demo_9"):
        paths_figure(demos, ["demo_9"])

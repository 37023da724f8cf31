import pytest

from ocplanner.demos.dataset import Demonstrations
from ocplanner.drawing.style import save_figure
from ocplanner.errors import DatasetError, InvalidValueError
from ocplanner.report.segments import segment_figure


@pytest.mark.parametrize("names", [["demo_0"], ["demo_0", "demo_1", "demo_10"]])
def test_one_panel_a_demonstration(tiny_square, tmp_path, names):
    figure = segment_figure(Demonstrations(tiny_square()), names)
    shown = [axes.get_title("left") for axes in figure.axes if axes.axison]
    assert shown == names
    assert save_figure(figure, tmp_path / "segments.png").stat().st_size > 10_000


def test_bad_names(tiny_square):
    demos = Demonstrations(tiny_square())
    with pytest.raises(InvalidValueError, match="no demonstration named"):
        segment_figure(demos, [])
    with pytest.raises(DatasetError, match="demo_9: no such demonstration"):
        segment_figure(demos, ["demo_9"])


def test_irregular_human_demonstrations(square_ph):
    figure = segment_figure(Demonstrations(square_ph), [f"demo_{i}" for i in (191, 8, 17, 26, 53, 197)])
    assert len(figure.axes) == 6


@pytest.mark.parametrize(
    ("env_name", "part", "said"),
    [("ToolHang", "tool", "35 of 105 steps"), ("TwoArmTransport", "payload:0", "35 of 205 steps")],
)
def test_the_kept_frames_are_those_that_training_keeps(carried_objects, env_name, part, said):
    figure = segment_figure(Demonstrations(carried_objects(env_name)), ["demo_0"], part)
    assert figure.axes[0].get_title("right") == said

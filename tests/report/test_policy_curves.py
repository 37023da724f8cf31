import numpy as np
import pytest

from ocplanner.drawing.style import save_figure
from ocplanner.errors import InvalidValueError
from ocplanner.report.policy_curves import policy_curves, success_curves
from ocplanner.report.policy_results import policy_cells, read_evaluation
from ocplanner.report.runs import read_run
from ocplanner.rollouts.intervals import seed_level_interval, wilson


def drawn(*paths):
    return success_curves(policy_cells(read_evaluation(path) for path in paths))


def test_seeds_are_thin_lines_around_the_mean_with_its_interval(write_evaluation):
    paths = [write_evaluation("a", (2, 6), seed=0), write_evaluation("b", (4, 8), seed=1)]
    (axes,) = drawn(*paths).axes
    mean, *seeds = axes.lines
    assert axes.get_title("left") == "BC, state"
    np.testing.assert_allclose(mean.get_xydata(), [[100, 0.3], [200, 0.7]])
    np.testing.assert_allclose([line.get_ydata() for line in seeds], [[0.2, 0.6], [0.4, 0.8]])
    assert all(line.get_linewidth() < mean.get_linewidth() for line in seeds)
    (band,) = axes.collections
    edges = band.get_paths()[0].vertices
    for step, good in ((100, (2, 4)), (200, (6, 8))):
        at = edges[edges[:, 0] == step, 1]
        expected = seed_level_interval([np.arange(10) < successes for successes in good])
        np.testing.assert_allclose([at.min(), at.max()], expected)
    assert [text.get_text() for text in axes.get_legend().get_texts()] == ["no hint, 2 seeds"]


def test_hints_share_a_panel_with_what_they_are_compared_with(write_evaluation, tmp_path):
    figure = drawn(
        write_evaluation("plain"), write_evaluation("hint", hint=(5,)), write_evaluation("rnn", algorithm="bc-rnn")
    )
    titles = [axes.get_title("left") for axes in figure.axes]
    assert titles == ["BC, state", "BC-RNN, state"]
    assert [len(axes.lines) for axes in figure.axes] == [2, 1]
    assert len({line.get_color() for line in figure.axes[0].lines}) == 2
    assert save_figure(figure, tmp_path / "curves.png").stat().st_size > 5000


def test_a_single_checkpoint_has_a_bar(write_evaluation):
    (axes,) = drawn(write_evaluation("a", (7,))).axes
    (bar,) = axes.collections
    np.testing.assert_allclose(bar.get_segments()[0], [[100, wilson(7, 10)[0]], [100, wilson(7, 10)[1]]])


def test_nothing_to_draw_is_an_error():
    with pytest.raises(InvalidValueError, match="at least one"):
        success_curves([])


def test_training_curves_follow_losses_below_zero(write_policy_run):
    figure = policy_curves([read_run(write_policy_run("plain")), read_run(write_policy_run("hint", hint=(5,)))])
    loss, held_out, speed = figure.axes
    assert all(len(axes.lines) == 2 for axes in figure.axes)
    assert [line.get_label() for line in loss.lines] == ["no hint", "hint k = 5"]
    assert loss.get_ylim()[0] < -4
    assert loss.get_yscale() == "linear"
    assert held_out.get_yscale() == "symlog"  # from -2 to 253
    assert speed.get_ylim()[0] == 0

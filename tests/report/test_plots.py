import matplotlib.pyplot as plt
import numpy as np
import pytest

from ocplanner.drawing.style import save_figure
from ocplanner.errors import InvalidValueError, ShapeError
from ocplanner.report import plots
from ocplanner.report.results import group_results
from ocplanner.report.runs import read_run
from ocplanner.zero_shot.result import read_results


def texts(figure) -> str:
    return " ".join(text.get_text() for text in figure.findobj(lambda artist: hasattr(artist, "get_text")))


@pytest.mark.parametrize("plot", [plots.loss_curves, plots.error_curves])
def test_curves_show_one_line_a_run(write_run, tmp_path, plot):
    runs = [read_run(write_run(f"h{horizon}", horizon=horizon)) for horizon in (5, 20, 50)]
    figure = plot(runs)
    assert all(len(axes.lines) == 3 for axes in figure.axes)
    save_figure(figure, tmp_path / "curves.svg")
    assert "H = 50" in (tmp_path / "curves.svg").read_text()


def test_a_stage_that_was_not_trained_says_so(write_run):
    folder = write_run("run")
    lines = [line for line in (folder / "metrics.jsonl").read_text().splitlines() if "vae" in line]
    (folder / "metrics.jsonl").write_text("\n".join(lines) + "\n")
    assert "not measured" in texts(plots.loss_curves([read_run(folder)]))


@pytest.mark.parametrize(("losses", "scale"), [((3.0, 2.0, 1.0), "linear"), ((3.0, 0.3, 0.03), "log")])
def test_a_narrow_loss_has_a_linear_axis(losses, scale):
    axes = plt.figure().add_subplot()
    axes.plot(losses)
    plots._value_axis(axes, loss=True)
    assert axes.get_yscale() == scale
    plt.close("all")


def test_success_rates_show_counts_and_intervals(write_result):
    paths = [write_result("a", successes=3), write_result("b", successes=1), write_result("c", robot="UR5e")]
    figure = plots.success_rates(group_results(record for path in paths for record in read_results(path)))
    assert "3/4, 1/2" in texts(figure)
    assert "Square on UR5e (gated, masked)" in texts(figure)


def test_failures_are_counted_by_class(write_result):
    figure = plots.failure_matrix(group_results(read_results(write_result(failures=("slip",) * 5 + ("time-out",) * 3))))
    shown = [text.get_text() for text in figure.axes[0].texts]
    assert shown == ["0", "0", "0", "5", "0", "0", "0", "3"]


def test_the_latent_map_has_one_dot_a_step_and_one_line_a_demonstration():
    rng = np.random.default_rng(0)
    figure = plots.latent_map([rng.normal(size=(length, 8)) for length in (6, 9)])
    axes = figure.axes[0]
    assert len(axes.collections[0].get_offsets()) == 15
    assert [len(line.get_xdata()) for line in axes.lines] == [6, 9]
    np.testing.assert_allclose(axes.collections[0].get_array()[[0, 5, 6, 14]], [0, 1, 0, 1])


@pytest.mark.parametrize("latents", [[], [np.zeros(8)], [np.zeros((5, 8)), np.zeros((5, 4))]])
def test_latents_of_another_shape_are_refused(latents):
    with pytest.raises(ShapeError):
        plots.latent_map(latents)


@pytest.mark.parametrize("latents", [[np.zeros((2, 8))], [np.full((9, 8), np.nan)]])
def test_latents_that_cannot_be_mapped_are_refused(latents):
    with pytest.raises(InvalidValueError):
        plots.latent_map(latents)

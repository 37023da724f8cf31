"""Charts of trainings and results: Figures 4 and 7 of the paper, success rates and failure classes.

Every function returns a new :class:`matplotlib.figure.Figure`; :func:`ocplanner.drawing.style.save_figure` writes it.
"""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator, PercentFormatter

from ocplanner.drawing.style import GRID, INK, MUTED, SERIES, new_figure, styled
from ocplanner.errors import InvalidValueError, ShapeError
from ocplanner.report.results import TransferGroup, failure_classes
from ocplanner.report.runs import TrainingRun, run_labels

_LINES = ("-", "--", "-.", ":")
_NARROW = 5.0
"""The axis of losses is linear while the highest loss is at most this many times the lowest."""
_FAR = 4
"""The axis of likelihoods is linear while the highest loss is at most this many times the best likelihood."""
LOSSES = (("vae", "LSTM-VAE, validation loss"), ("predictor", "Latent predictor, validation loss"))
ERRORS = (
    ("ade_mm", "mean error (ADE), mm"),
    ("fde_mm", "final error (FDE), mm"),
    ("rotation_deg", "rotation error, degrees"),
)


def loss_curves(runs: Sequence[TrainingRun]) -> Figure:
    """Figure 4: validation loss of (a) the LSTM-VAE and (b) the latent predictor, one line a run."""
    with styled():
        figure = new_figure(7.4, 2.9)
        for letter, axes, (stage, title) in zip("ab", figure.subplots(1, 2), LOSSES):
            run_curves(axes, runs, stage, "valid_loss", f"({letter}) {title}")
        shared_legend(figure)
    return figure


def error_curves(runs: Sequence[TrainingRun]) -> Figure:
    """Held-out errors of the whole planner, image to plan, while the latent predictor trains."""
    with styled():
        figure = new_figure(7.4, 2.6)
        for axes, (value, title) in zip(figure.subplots(1, len(ERRORS)), ERRORS):
            run_curves(axes, runs, "predictor", value, title)
        shared_legend(figure)
    return figure


def curve_panel(runs: Sequence[TrainingRun], stage: str, value: str, title: str) -> Figure:
    """One panel of the figures above, without a legend; colours follow :data:`ocplanner.drawing.style.SERIES`."""
    with styled():
        figure = new_figure(3.6, 2.5)
        run_curves(figure.subplots(), runs, stage, value, title)
    return figure


def run_curves(axes: Axes, runs: Sequence[TrainingRun], stage: str, value: str, title: str) -> None:
    """Draw one line for each run; losses that change by a large factor get a logarithmic axis."""
    drawn = False
    for i, (run, label) in enumerate(zip(runs, run_labels(runs))):
        steps, values = run.series(stage, value)
        if len(steps):
            marker = "o" if len(steps) < 3 else None
            line = _LINES[i // len(SERIES) % len(_LINES)]
            axes.plot(steps, values, line, color=SERIES[i % len(SERIES)], label=label, marker=marker, markersize=4)
            drawn = True
    axes.set_title(title)
    step_axis(axes)
    if not drawn:
        axes.text(0.5, 0.5, "not measured", transform=axes.transAxes, ha="center", va="center", color=MUTED)
    else:
        _value_axis(axes, "loss" in value)


def _value_axis(axes: Axes, loss: bool) -> None:
    drawn = np.concatenate([np.asarray(line.get_ydata()) for line in axes.lines])
    lowest, highest = float(drawn.min()), float(drawn.max())
    if loss and highest > _NARROW * lowest > 0:  # a narrower logarithmic axis would show hardly any number
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter(FuncFormatter(lambda tick, _: f"{tick:g}"))
        axes.yaxis.set_minor_formatter(FuncFormatter(lambda tick, _: f"{tick:g}" if f"{tick:.0e}"[0] in "25" else ""))
    elif loss and highest > -_FAR * lowest > 0:  # a likelihood that falls apart must not flatten what came before
        axes.set_yscale("symlog", linthresh=10 ** np.floor(np.log10(-lowest)))
        axes.yaxis.set_major_formatter(FuncFormatter(lambda tick, _: f"{tick:g}"))
    elif lowest >= 0:
        axes.set_ylim(bottom=0)


def step_axis(axes: Axes) -> None:
    """Show training steps along x, thousands as k."""
    axes.set_xlabel("training step")
    axes.xaxis.set_major_locator(MaxNLocator(5, integer=True))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda step, _: f"{step / 1000:g}k" if step >= 1000 else f"{step:g}"))


def shared_legend(figure: Figure) -> None:
    """Add one legend below the figure if it has more than one kind of line."""
    entries = {}
    for axes in figure.axes:
        entries |= dict(zip(*reversed(axes.get_legend_handles_labels())))
    if len(entries) > 1:
        columns = min(len(entries), 4)
        figure.legend(list(entries.values()), list(entries), loc="outside lower center", ncols=columns)


def success_rates(groups: Sequence[TransferGroup]) -> Figure:
    """Success rates: a dot for each planner with its 95 % Wilson interval, a bar at the mean of several planners with
    an interval over planners and episodes.
    """
    with styled():
        figure = new_figure(7.4, 0.75 + sum(_row_height(group) for group in groups))
        axes = figure.subplots()
        top = 0.0
        ticks = []
        for group in groups:
            height = _row_height(group)
            center = top + height / 2
            ticks.append(center)
            axes.barh(center, group.mean_rate, height=height * 0.72, color=SERIES[0], alpha=0.22)
            if len(group.records) > 1:
                axes.hlines(top + 0.86 * height, *group.interval, color=MUTED, linewidth=1.4)
            offsets = np.arange(len(group.records)) - (len(group.records) - 1) / 2
            for record, offset in zip(group.records, offsets):
                low, high = record.interval
                y = center + offset * 0.16
                axes.plot([low, high], [y, y], color=SERIES[0], linewidth=1.4, solid_capstyle="butt")
                axes.plot(record.rate, y, "o", color=SERIES[0], markersize=4.5)
            counts = ", ".join(f"{record.successes}/{record.episodes}" for record in group.records)
            axes.text(1.02, center, counts, va="center", fontsize=8, transform=axes.get_yaxis_transform())
            top += height
        axes.set_yticks(ticks, [group.title for group in groups])
        axes.set(xlim=(0, 1.0), ylim=(top, 0), xlabel="success rate, with 95 % intervals")
        axes.xaxis.set_major_formatter(PercentFormatter(1.0))
        axes.grid(visible=False, axis="y")
        axes.tick_params(axis="y", length=0)
    return figure


def _row_height(group: TransferGroup) -> float:
    return max(0.34, 0.2 + 0.16 * len(group.records))


def failure_matrix(groups: Sequence[TransferGroup]) -> Figure:
    """Counts of failed episodes by class, one row for each group."""
    classes = failure_classes(groups)
    counts = np.array([[group.failures[name] for name in classes] for group in groups])
    shades = LinearSegmentedColormap.from_list("failures", ["#ffffff", SERIES[1]])
    with styled():
        figure = new_figure(7.4, 1.0 + 0.32 * len(groups))
        axes = figure.subplots()
        axes.imshow(counts, cmap=shades, vmin=0, vmax=max(1, counts.max()) * 1.4, aspect="auto")
        for (row, column), count in np.ndenumerate(counts):
            axes.text(column, row, str(count), ha="center", va="center", color=INK if count else MUTED, fontsize=8)
        axes.set_yticks(range(len(groups)), [group.title for group in groups])
        axes.set_xticks(range(len(classes)), [name.replace(" ", "\n", 1) for name in classes])
        axes.xaxis.tick_top()
        axes.tick_params(length=0)
        axes.grid(visible=False)
        for spine in axes.spines.values():
            spine.set_visible(False)
    return figure


def latent_map(latents: Sequence[np.ndarray], *, seed: int = 0) -> Figure:
    """Figure 7: t-SNE of the latent plans along demonstrations, coloured by normalised time.

    Args:
        latents: one array (T_i, latent) for each demonstration, in order of time.
        seed: seed of t-SNE.

    Raises:
        ShapeError: an array is not two-dimensional or their widths differ.
        InvalidValueError: fewer than 4 latents in all, or one is not finite.
    """
    from sklearn.manifold import TSNE

    if not latents or any(np.ndim(part) != 2 or np.shape(part)[1] != np.shape(latents[0])[1] for part in latents):
        raise ShapeError("latents: expected one array (T, latent) a demonstration, all of one width")
    stacked = np.concatenate(latents).astype(np.float64)
    if len(stacked) < 4 or not np.isfinite(stacked).all():
        raise InvalidValueError(f"latents: need at least 4 finite ones for t-SNE, found {len(stacked)}")
    perplexity = min(30.0, (len(stacked) - 1) / 3)
    flat = TSNE(perplexity=perplexity, random_state=seed, init="pca", n_jobs=1).fit_transform(stacked)
    with styled():
        figure = new_figure(5.2, 4.2)
        axes = figure.subplots()
        start = 0
        for part in latents:
            span = flat[start : start + len(part)]
            start += len(part)
            axes.plot(span[:, 0], span[:, 1], color=GRID, linewidth=0.8, zorder=1)
        time = np.concatenate([np.linspace(0, 1, len(part)) for part in latents])
        dots = axes.scatter(flat[:, 0], flat[:, 1], c=time, cmap="viridis", s=14, linewidths=0, zorder=2)
        bar = figure.colorbar(dots, ax=axes, ticks=[0, 0.5, 1], shrink=0.85)
        bar.ax.set_yticklabels(["grasp", "half-way", "release"])
        bar.outline.set_visible(False)  # pyright: ignore[reportCallIssue]
        axes.set(title=f"Latent plans along {len(latents)} demonstrations (t-SNE)", xticks=[], yticks=[])
        axes.grid(visible=False)
        axes.spines[:].set_visible(False)
    return figure

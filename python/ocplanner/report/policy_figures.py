"""What policies make of the plan along an episode: do they use the hint when they should?"""

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter

from ocplanner.demos.dataset import Demonstrations
from ocplanner.drawing.style import GRID, INK, MUTED, SERIES, new_figure, save_figure, styled
from ocplanner.errors import DatasetError
from ocplanner.policies.hint_use import HintUse, check_fits, hint_use, mean_share
from ocplanner.policies.policy import Policy
from ocplanner.report.model_figures import distinct_names, first_fitting
from ocplanner.report.plots import step_axis
from ocplanner.report.policy_results import PolicyKind, policy_kind

_PARTS = (("position", "x"), ("rotation", "y"))
_HELD = SERIES[2]
_RESIDUAL = SERIES[1]
_HINT = SERIES[0]
_WEIGHT_COLORS = (SERIES[3], SERIES[6])
_MOST_DEMONSTRATIONS = 10
_LINES = ("-", "--", ":", "-.")


def hint_use_figure(use: HintUse, title: str = "") -> Figure:
    """The weights x and y along an episode, and how large the hint and the residual A are, position and rotation.

    The span in which the object is held is shaded: only there is a hint, and only there do the weights matter.

    Args:
        use: of a policy on a recorded episode.
        title: above the figure.
    """
    with styled():
        figure = new_figure(7.4, 5.2)
        weights, *sizes = figure.subplots(3, 1, sharex=True)
        for axes in (weights, *sizes):
            _shade(axes, use.held)
        _weights(weights, use)
        for part, axes in enumerate(sizes):
            _sizes(axes, use, part)
        sizes[-1].set(xlabel="control step", xlim=(0, max(1, len(use.held) - 1)))
        handles = {}
        for axes in (weights, sizes[0]):
            handles |= dict(zip(*reversed(axes.get_legend_handles_labels())))
        figure.legend(list(handles.values()), list(handles), loc="outside lower center", ncols=4)
        if title:
            figure.suptitle(title, x=0.01, ha="left", fontsize=9.5, fontweight="bold")
    return figure


def _shade(axes: Axes, held: np.ndarray) -> None:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], held, [False]]).astype(int)))
    for i, (start, stop) in enumerate(edges.reshape(-1, 2)):
        label = "object held: hint on" if i == 0 else None
        axes.axvspan(start - 0.5, stop - 0.5, color=_HELD, alpha=0.16, linewidth=0, label=label)


def _weights(axes: Axes, use: HintUse) -> None:
    several = len(use.horizons) > 1
    steps = np.arange(len(use.held))
    for level in (0, 1):
        axes.axhline(level, color=MUTED, linewidth=0.8, linestyle=(0, (1, 2)))
    for part, (name, letter) in enumerate(_PARTS):
        for k, horizon in enumerate(use.horizons):
            values, color = use.weights[:, k, part], _WEIGHT_COLORS[part]
            label = f"{letter}, {name}" + (f", k = {horizon}" if several else "")
            axes.plot(steps, values, _LINES[k % len(_LINES)], color=color, alpha=0.3, linewidth=1.0)
            shown = np.where(use.held, values, np.nan)
            axes.plot(steps, shown, _LINES[k % len(_LINES)], color=color, label=label)
    axes.set_title("weights of the hint (pale: nothing to weigh)")


def _sizes(axes: Axes, use: HintUse, part: int) -> None:
    steps = np.arange(len(use.held))
    name, letter = _PARTS[part]
    for k in range(len(use.horizons)):
        length = np.where(use.held, np.linalg.norm(use.hint[:, k, part], axis=-1), np.nan)
        label = "|hint|" + (f", k = {use.horizons[k]}" if len(use.horizons) > 1 else "")
        axes.plot(steps, length, _LINES[k % len(_LINES)], color=GRID if k else MUTED, linewidth=1.2, label=label)
    moved = np.where(use.held, np.linalg.norm(use.moved[:, part], axis=-1), np.nan)
    axes.plot(steps, moved, color=_HINT, label="|weighted hint|")
    axes.plot(steps, use.residual_size[:, part], color=_RESIDUAL, label="|residual A|")
    axes.set_title(f"{name}, action units")
    axes.set_ylim(bottom=0)
    if np.isfinite(use.share[part]):
        share = f"{100 * use.share[part]:.0f} % of the motion while held is the hint's, weighted by {letter}"
        axes.set_title(share, loc="right", fontsize=8, fontweight="normal", color=INK)


def hint_share_figure(steps: Sequence[int], shares: Sequence[np.ndarray], title: str = "") -> Figure:
    """How much of the motion while held comes from the hint, as training goes on.

    Args:
        steps: of training, one a checkpoint.
        shares: of each checkpoint (2,), position and rotation; see :attr:`ocplanner.policies.hint_use.HintUse.share`.
        title: above the figure.
    """
    with styled():
        figure = new_figure(6.2, 2.9)
        axes = figure.subplots()
        for (name, letter), color, values in zip(_PARTS, _WEIGHT_COLORS, np.stack(shares).T):
            axes.plot(steps, values, "o-", color=color, markersize=3.5, label=f"{name}, through {letter}")
        axes.set_ylim(min(0.0, np.nanmin(shares)), max(1.0, np.nanmax(shares)))
        axes.yaxis.set_major_formatter(PercentFormatter(1.0))
        axes.set_ylabel("share of the hint")
        step_axis(axes)
        axes.legend(loc="best")
        axes.set_title(title)
    return figure


def draw_policies(policies: Sequence[Path], data: Sequence[Path], folder: Path) -> list[Path]:
    """For each policy with a hint, write ``hint_use_NAME.png``: its use on a held-out demonstration.

    For the last policy of a run folder ``hint_share_NAME.png`` shows how the use changed from checkpoint to checkpoint.

    Args:
        policies: policy files; those without hints are passed over.
        data: labelled data sets; each policy is shown the first that is labelled as its own was.
        folder: where the figures go.

    Raises:
        ModelFileError: a file is damaged.
        MismatchError: no data set fits a policy.
        DatasetError: a data set is damaged, or the object is held in none of its demonstrations.
    """
    loaded = [Policy.load(path) for path in policies]
    hinted = [policy for policy in loaded if policy.training.network.hint is not None]
    names = distinct_names([policy.path for policy in hinted], [policy_name(policy.path) for policy in hinted])
    written = []
    with ExitStack() as opened:
        sets = [opened.enter_context(Demonstrations(path)) for path in data]
        for policy, name in zip(hinted, names):
            demos = first_fitting(sets, lambda demos, policy=policy: check_fits(policy, demos))
            figures = {"hint_use": _held_out_figure(policy, demos)}
            checkpoints = _checkpoints(policy.path)
            if len(checkpoints) > 1:
                figures["hint_share"] = _training_figure(checkpoints, demos)
            written += [save_figure(figure, folder / f"{kind}_{name}.png") for kind, figure in figures.items()]
    return written


def policy_name(file: Path) -> str:
    """``RUN/policy.safetensors`` goes by its run, ``RUN/policies/step_N.safetensors`` by run and step."""
    parent = file.resolve().parent
    if file.stem == "policy":
        return parent.name
    return f"{parent.parent.name}_{file.stem}" if parent.name == "policies" else file.stem


def _checkpoints(file: Path) -> list[Path]:
    """The policies kept of the run whose last one ``file`` is; none of another file."""
    folder = file.parent / "policies" if file.stem == "policy" else file.parent
    kept = sorted(folder.glob("step_*.safetensors")) if folder.name == "policies" else []
    return kept if file.stem == "policy" or kept[-1:] == [file] else []


def _training_figure(checkpoints: Sequence[Path], demos: Demonstrations) -> Figure:
    policies = [Policy.load(path) for path in checkpoints]
    names, which = _shown(policies[0], demos)
    names = names[:_MOST_DEMONSTRATIONS]
    shares = [mean_share([hint_use(policy, demos, name) for name in names]) for policy in policies]
    steps = [policy.header.step for policy in policies]
    episodes = "1 episode" if len(names) == 1 else f"{len(names)} episodes"
    return hint_share_figure(steps, shares, f"{_kind(policies[0])}: {episodes} ({which})")


def _shown(policy: Policy, demos: Demonstrations) -> tuple[list[str], str]:
    """The demonstrations to show a policy, and what they are to it: those it did not learn from, if there are any."""
    mask = policy.training.mask
    learned = set(demos.mask(mask)) if mask in demos.mask_names else set(demos.names)
    held_out = [name for name in demos.names if name not in learned]
    return (held_out, "held out") if held_out else (list(demos.names), "trained on")


def _held_out_figure(policy: Policy, demos: Demonstrations) -> Figure:
    """On the first demonstration in which a hint is ever given."""
    names, which = _shown(policy, demos)
    for name in names:
        use = hint_use(policy, demos, name)
        if use.held.any():
            return hint_use_figure(use, f"{_kind(policy)}, step {policy.header.step}: {name} ({which})")
    raise DatasetError(f"{demos.path}: the object is held in none of {', '.join(names[:4])}; label another data set")


def _kind(policy: Policy) -> PolicyKind:
    return policy_kind(policy.training, policy.header.labels)

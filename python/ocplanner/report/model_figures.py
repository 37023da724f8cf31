"""Figures of planners and policies as files: each model is drawn on the first data set that fits it."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import TypeVar

from matplotlib.figure import Figure

from ocplanner.demos.dataset import Demonstrations
from ocplanner.drawing.style import save_figure
from ocplanner.errors import MismatchError

Model = TypeVar("Model")


def write_model_figures(
    models: Mapping[str, Model],
    data: Sequence[Path],
    folder: Path,
    check: Callable[[Model, Demonstrations], object],
    draw: Callable[[str, Model, Demonstrations], Mapping[str, Figure]],
) -> list[Path]:
    """Draw each model and write ``folder/NAME.png`` for each figure.

    Args:
        models: by name.
        data: data sets.
        folder: where the figures go.
        check: raises a MismatchError if a data set does not fit a model.
        draw: gives the figures of a model on a data set, by name.

    Raises:
        MismatchError: no data set fits a model.
        DatasetError: a data set is damaged.
        OutputError: a file cannot be written.
    """
    with ExitStack() as opened:
        sets = [opened.enter_context(Demonstrations(path)) for path in data]
        return [
            save_figure(figure, folder / f"{stem}.png")
            for name, model in models.items()
            for stem, figure in draw(name, model, first_fitting(sets, partial(check, model))).items()
        ]


def first_fitting(datasets: Sequence[Demonstrations], check: Callable[[Demonstrations], object]) -> Demonstrations:
    """The first data set for which ``check`` raises no MismatchError.

    Raises:
        MismatchError: there is none; the message gives each reason.
    """
    faults = []
    for demos in datasets:
        try:
            check(demos)
        except MismatchError as error:
            faults.append(str(error))
        else:
            return demos
    raise MismatchError("; ".join(faults) or "no data set was given; give one with --data")


def distinct_names(paths: Sequence[Path], names: Sequence[str] | None = None) -> list[str]:
    """One name for each file: short where that is enough, with its folders in front where others have the same.

    ``a/sawyer/episode_10000.mp4`` becomes ``episode_10000``; beside ``a/ur5e/episode_10000.mp4`` it becomes
    ``sawyer_episode_10000``.

    Args:
        paths: the files, no two the same.
        names: the short name of each; the file's name without its ending if not given.
    """
    shorts = [path.stem for path in paths] if names is None else list(names)
    folders = [path.resolve().parent.parts[1:] for path in paths]
    chosen = list(shorts)
    for depth in range(1, max(map(len, folders), default=0) + 1):
        count = Counter(chosen)
        if max(count.values()) == 1:
            break
        chosen = [
            "_".join([*parts[-depth:], short]) if count[name] > 1 else name
            for name, parts, short in zip(chosen, folders, shorts)
        ]
    return chosen

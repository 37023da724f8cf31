"""From a data set with images to a copy with hints and rewards, one demonstration after the other."""

import json
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from ocplanner.demos.dataset import LABEL_ATTRIBUTE, Demonstrations
from ocplanner.demos.writer import DatasetWriter
from ocplanner.errors import OutputError
from ocplanner.guidance.labels import Labeller, LabelSettings
from ocplanner.planner.planner import Planner
from ocplanner.settings import require

DEFAULT_LABELS = LabelSettings()


def label_dataset(
    source: str | Path,
    target: str | Path,
    planner: Planner | str | Path,
    settings: LabelSettings = DEFAULT_LABELS,
    *,
    pictures: str | Path | None = None,
    threads: int = 1,
    limit: int | None = None,
    overwrite: bool = False,
    progress: Callable[[str, int], None] | None = None,
) -> Path:
    """Copy a data set and write what a planner makes of it into the copy (the paper's section 5).

    Plans are made where the robot holds the object; elsewhere hints, plans and the plan's reward are zero. The copy
    holds, for each demonstration of T steps:

    - ``obs/ocp_hint`` (T, 6 K + 1) float32: for each of K ``horizon_steps`` the action that would take the object
      there (see :func:`ocplanner.guidance.hints.plan_hints`), then 1 where the object is held, else 0;
    - ``obs/ocp_plan`` (T, H, 9 or 3) float32: planned positions in m, world, and the first two columns of rotations;
    - ``rewards``, the recorded ones as ``rewards_sparse``, and the unweighted terms ``ocp_reward_position`` (m^2) and
      ``ocp_reward_rotation``, (T,) float64 each;
    - ``next_obs`` of what is new, where there is ``next_obs`` already or rewards are written; with rewards also of
      every other observation that lacks it. The last one is repeated.

    A run that was stopped, at whatever moment, goes on when called again with the same settings, and ends with the
    same file. One demonstration is in memory at a time.

    Args:
        source: a robomimic data set, with the images that the planner was trained on unless ``pictures`` has them.
        target: the file to make.
        planner: the planner or its file.
        settings: what is written.
        pictures: a data set of the same demonstrations with the planner's images, where those of ``source`` are drawn
            otherwise (for the policy's eyes).
        threads: threads of the planner; the labels depend on it only by rounding.
        limit: label the first so many demonstrations only.
        overwrite: replace ``target`` if it is there.
        progress: called with the name and the number of steps of each demonstration that is done; those of an earlier
            run come first.

    Raises:
        DatasetError: the source lacks images, object poses, or what else the labels need, or is labelled already.
        InvalidValueError: a number is out of range.
        MismatchError: planner and images do not fit together, or ``pictures`` are of other demonstrations.
        OutputError: the target exists, is the source, cannot be written, or was begun with other settings.
        ModelFileError: the planner cannot be read.
    """
    require(threads >= 1, f"threads {threads} must be at least 1")
    require(limit is None or limit >= 1, f"limit {limit} must be at least 1")
    if Path(source).resolve() == Path(target).resolve():
        raise OutputError(f"{target} is the source itself; choose another output")
    planner = planner if isinstance(planner, Planner) else Planner.load(planner)
    with ExitStack() as opened:
        demos = opened.enter_context(Demonstrations(source))
        drawn = None if pictures is None else opened.enter_context(Demonstrations(pictures))
        labeller = opened.enter_context(Labeller(planner, demos, settings, threads, drawn))
        names = demos.names[:limit]
        attrs = {key: value for key, value in demos.attrs.items() if key not in {"env_args", "total"}}
        record = {**labeller.record(), "source": _identity(demos), "pictures": drawn and _identity(drawn)}
        attrs[LABEL_ATTRIBUTE] = json.dumps(record, sort_keys=True)
        with DatasetWriter(target, demos.env_args, data_attrs=attrs, overwrite=overwrite, durable=False) as writer:
            done = set(writer.done)
            for name in sorted(names, key=lambda name: name not in done):
                if name not in done:
                    writer.add_copy(demos[name], labeller.label(demos[name]))
                if progress:
                    progress(name, demos[name].length)
            masks = {mask: [name for name in demos.mask(mask) if name in names] for mask in demos.mask_names}
            return writer.finish({mask: listed for mask, listed in masks.items() if listed}, names)


def _identity(demos: Demonstrations) -> dict[str, Any]:
    return {"name": demos.path.name, "bytes": demos.path.stat().st_size}

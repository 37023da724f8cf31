"""From a data set with images to a copy with hints and rewards, one demonstration after the other."""

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

from ocplanner.demos.dataset import Demonstrations
from ocplanner.demos.settings import DEFAULT_READING, ReadSettings
from ocplanner.demos.soundness import sound_names
from ocplanner.demos.writer import DatasetWriter
from ocplanner.files.records.labels import LABEL_ATTRIBUTE, FileIdentity
from ocplanner.files.storage import check_output
from ocplanner.guidance.labels import Labeller
from ocplanner.guidance.settings import LabelSettings
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
    reading: ReadSettings = DEFAULT_READING,
    limit: int | None = None,
    overwrite: bool = False,
    progress: Callable[[str, int], None] | None = None,
    say: Callable[[str], None] | None = None,
) -> Path:
    """Copy a data set and add a planner's hints, plans and rewards to the copy (the paper's section 5).

    Plans are made where the robot holds the object; elsewhere hints, plans and the plan's reward are zero. For each
    demonstration of T steps the copy holds:

    - ``obs/ocp_hint`` (T, 6 K + 1) float32: for each of K ``horizon_steps`` the action that would take the object
      there (see :func:`ocplanner.guidance.hints.plan_hints`), then 1 where the object is held, else 0;
    - ``obs/ocp_plan`` (T, H, 9 or 3) float32: planned positions in m, world, and the first two columns of rotations;
    - ``rewards``, the recorded ones as ``rewards_sparse``, and the unweighted terms ``ocp_reward_position`` (m^2) and
      ``ocp_reward_rotation``, (T,) float64 each;
    - ``next_obs`` of each new observation, if the source has ``next_obs`` or rewards are written; with rewards also of
      every other observation that lacks it. The last one is repeated.

    Call it again with the same settings to continue a stopped run: it ends with the same file. One demonstration is in
    memory at a time.

    Args:
        source: a robomimic data set, with the images that the planner was trained on unless ``pictures`` has them.
        target: the file to make.
        planner: the planner or its file.
        settings: what is written.
        pictures: a data set of the same demonstrations with the planner's images, if those of ``source`` are drawn
            differently (for the policy to see).
        reading: how both data sets are read.
        limit: label only the first ``limit`` demonstrations.
        overwrite: replace ``target`` if it exists.
        progress: called with the name and the number of steps of each finished demonstration; those of an earlier run
            come first.
        say: called with a line for each demonstration that is left out, and with how often the object is held.

    Raises:
        DatasetError: the source lacks images, object poses, or anything else that the labels need, or is labelled
            already.
        InvalidValueError: a number is out of range.
        MismatchError: planner and images do not fit together, or ``pictures`` shows other demonstrations.
        OutputError: the target exists, is the source, cannot be written, or was begun with other settings or from
            another source.
        ModelFileError: the planner cannot be read.
    """
    require(limit is None or limit >= 1, f"limit {limit} must be at least 1")
    planner = planner if isinstance(planner, Planner) else Planner.load(planner)
    check_output(Path(target), overwrite, "HDF5 data set", reads := (source, pictures, planner.path), resumed=True)
    with ExitStack() as opened:
        demos = opened.enter_context(Demonstrations(source, reading=reading))
        drawn = None if pictures is None else opened.enter_context(Demonstrations(pictures, reading=reading))
        labeller = opened.enter_context(Labeller(planner, demos, settings, drawn))
        masks = {mask: demos.mask(mask) for mask in demos.mask_names}
        names = sound_names(demos, demos.names[:limit], labeller.needed, say)
        labeller.check_held([demos[name] for name in names], say)
        attrs = {key: value for key, value in demos.attrs.items() if key not in {"env_args", "total"}}
        pictured = None if drawn is None else _identity(drawn)
        record = replace(labeller.record(), source=_identity(demos), pictures=pictured)
        attrs[LABEL_ATTRIBUTE] = record.to_json()
        with DatasetWriter(
            target, demos.env_args, data_attrs=attrs, overwrite=overwrite, durable=False, reads=reads
        ) as writer:
            done = {name for name in writer.done if name in names and writer.holds(name, labeller.digest(demos[name]))}
            for name in sorted(names, key=lambda name: name not in done):
                if name not in done:
                    writer.add_copy(demos[name], labeller.label(demos[name]), labeller.digest(demos[name]))
                if progress:
                    progress(name, demos[name].length)
            masks = {mask: [name for name in listed if name in names] for mask, listed in masks.items()}
            return writer.finish({mask: listed for mask, listed in masks.items() if listed}, names)


def _identity(demos: Demonstrations) -> FileIdentity:
    return FileIdentity(demos.path.name, demos.path.stat().st_size)

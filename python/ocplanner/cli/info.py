"""``ocplanner info``."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TypeVar

import numpy as np
import tyro
from rich.console import Console
from rich.table import Table
from rich.text import Text
from safetensors import SafetensorError, safe_open

from ocplanner.demos.dataset import Demonstrations
from ocplanner.demos.settings import DEFAULT_READING, ReadSettings
from ocplanner.errors import DatasetError, ModelFileError, OcplannerError, ResultFileError
from ocplanner.files.hdf5 import HDF5_MAGIC
from ocplanner.planner.planner import FILE_NAME
from ocplanner.policies.config import POLICY_FILE
from ocplanner.settings import to_dict

_LONGEST = 30
"""Lines of an entry that is printed whole."""

_SENTENCE = 40
"""Characters from which on an item of a list gets a line of its own."""

_LISTED = ("runs", "cells", "rows", "checkpoints")
"""What a result file has many of."""

_Value = TypeVar("_Value")

_TRAINED = (FILE_NAME, POLICY_FILE)
"""What a finished training leaves in its run folder."""

Facts = dict[str, Any]


@dataclass(frozen=True)
class Info:
    """Describe a data set, planner or policy."""

    file: Annotated[Path, tyro.conf.Positional]
    """HDF5 data set, a .safetensors or result file made by ocplanner, or the run folder of a training."""
    json: bool = False
    """Print JSON instead of a table; nothing is left out."""
    all: bool = False
    """Print long entries whole, such as all settings of a training and every held-out error."""

    keys: Path | None = None
    """JSON file that maps our names of observations to the data set's, such as {"robot0_eef_pos": "ee_pos"}."""

    def run(self) -> None:
        """Print what the file holds."""
        facts = describe(self.file, ReadSettings(keys=self.keys))
        console = Console()
        if self.json:
            console.print_json(json.dumps(facts))
        else:
            console.print(_table(self.file, facts, self.all))


COMMAND = Info


def describe(path: Path, reading: ReadSettings = DEFAULT_READING) -> Facts:
    """What a file holds, as JSON can hold it; nothing in the file is executed or unpickled.

    Args:
        path: a data set, a planner or policy file, or a run folder that holds one of those.
        reading: how a data set is read.

    Raises:
        OcplannerError: the file is missing, damaged or of another kind.
    """
    if path.is_dir():
        return describe_weights(_trained(path))
    try:
        with path.open("rb") as file:
            start = file.read(len(HDF5_MAGIC))
    except OSError as error:
        raise DatasetError(f"cannot read {path}: {error.strerror}; give the path of a file") from error
    if start == HDF5_MAGIC:
        return describe_dataset(path, reading)
    if path.suffix == ".json":
        return describe_result(path)
    if path.suffix == ".safetensors" or start[4:] == b"\x00\x00\x00\x00":  # a header length below 4 GiB
        return describe_weights(path)
    raise DatasetError(f"{path}: neither an HDF5 data set nor a .safetensors or .json file (it begins with {start!r})")


def _trained(folder: Path) -> Path:
    for name in _TRAINED:
        if (folder / name).exists():
            return folder / name
    raise ModelFileError(f"{folder} holds no {' nor '.join(_TRAINED)}; give a file, or the run folder of a training")


def describe_dataset(path: Path, reading: ReadSettings = DEFAULT_READING) -> Facts:
    """The demonstrations of a robomimic file in numbers.

    Raises:
        DatasetError: the file is missing, damaged or no robomimic data set.
    """
    from ocplanner.demos.findings import findings  # it may start the simulator

    with Demonstrations(path, reading=reading) as demos:
        lengths = np.array([length for demo in demos if (length := _of(lambda demo=demo: demo.length))] or [0])
        first = next((demo for demo in demos if _of(lambda demo=demo: demo.length)), demos[0])
        try:
            layout = first.object_layout() or "none"
        except OcplannerError as error:
            layout = f"unclear: {error}"
        named = [name for name in first.object_names if f"{name}_pos" in first.observation_keys]
        sizes = (_of(lambda demo=demo: float(np.abs(demo.recorded_actions).max(initial=0))) for demo in demos)
        largest = max((size for size in sizes if size is not None), default=0.0)
        return {
            "kind": "data set",
            "recorded by": demos.kind,
            "findings": findings(demos),
            "task": demos.task_name,
            "environment": demos.env_name,
            "robosuite": demos.env_version,
            "robots": list(demos.robots),
            "demonstrations": len(demos),
            "steps": int(lengths.sum()),
            "steps each": {
                "min": int(lengths.min()),
                "mean": float(lengths.mean().round(1)),
                "max": int(lengths.max()),
            },
            "controller": demos.controllers,
            "masks": {mask: len(set(demos.listed(mask))) for mask in demos.mask_names},
            "object layout": layout,
            "named sensors": named,
            "largest action": largest,
            "arrays": _of(lambda: {key: f"{array.dtype} {array.shape}" for key, array in first.arrays().items()}),
            "derived": list(first.derived_keys),
            "cameras": list(demos.cameras),
            "rendered": None if demos.render_record is None else to_dict(demos.render_record),
            "labelled": None if demos.label_record is None else json.loads(demos.label_record.to_json()),
        }


def _of(read: Callable[[], _Value]) -> _Value | None:
    """What can be read; None for what a finding is about."""
    try:
        return read()
    except OcplannerError:
        return None


def describe_result(path: Path) -> Facts:
    """A result file without its single episodes or rows.

    Raises:
        ResultFileError: the file is no JSON object.
    """
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ResultFileError(f"{path}: not a readable JSON file ({error}); make it again") from error
    if not isinstance(found, dict):
        raise ResultFileError(f"{path}: a JSON {type(found).__name__}, but results are objects; give another file")
    shown = {key: f"{len(value)} entries" if key in _LISTED else value for key, value in found.items()}
    return {"kind": "result", **shown}


def describe_weights(path: Path) -> Facts:
    """The configuration in a planner or policy file, and the number of its parameters.

    Raises:
        ModelFileError: the file is damaged or was not made by ocplanner.
    """
    try:
        with safe_open(path, framework="numpy") as file:
            metadata: Mapping[str, str] = file.metadata() or {}
            shapes = {name: file.get_slice(name).get_shape() for name in file.keys()}  # noqa: SIM118
    except (SafetensorError, OSError, ValueError) as error:
        raise ModelFileError(f"{path}: not a readable safetensors file ({error}); make or download it again") from error
    try:
        header = json.loads(metadata["ocplanner"])
        kind, config = str(header["kind"]), dict(header["config"])
    except (KeyError, TypeError, ValueError) as error:
        raise ModelFileError(
            f"{path}: a safetensors file, but not one of ocplanner's (no readable `ocplanner` metadata); "
            "make it with `ocplanner train-planner`"
        ) from error
    parameters = sum(int(np.prod(shape)) for shape in shapes.values())
    return {
        "kind": kind,
        "format": header.get("format"),
        "parameters": parameters,
        "size": f"{path.stat().st_size / 1e6:.2f} MB",
        **config,
    }


def _table(path: Path, facts: Facts, whole: bool) -> Table:
    table = Table(title=str(path), title_justify="left", show_header=False)
    table.add_column(style="bold", no_wrap=True)
    table.add_column(overflow="fold")
    for name, value in facts.items():
        text = _plain(value)
        lines = text.count("\n") + 1
        if isinstance(value, dict) and lines > _LONGEST and not whole:
            text = f"{', '.join(value)} ({lines} lines: --all)"
        table.add_row(name, Text(text))
    return table


def _plain(value: Any, indent: str = "") -> str:
    if value is None or value in ([], {}, ""):
        return "none"
    if isinstance(value, dict):
        flat = "  ".join(f"{key} {item}" for key, item in value.items())
        if len(flat) <= 80 and not any(isinstance(item, dict | list) for item in value.values()):
            return flat
        return "\n".join(f"{indent}{key}: {_plain(item, indent + '  ').lstrip()}" for key, item in value.items())
    if isinstance(value, list):
        sentences = any(len(str(item)) > _SENTENCE for item in value)
        return ("\n" if sentences else ", ").join(_plain(item) for item in value)
    if isinstance(value, float):
        return f"{value:.6g}"
    return str(value)

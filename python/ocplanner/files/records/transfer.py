"""The result of a transfer, and ``matrix.json``, which gathers the results of many."""

import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Generic, Protocol, Self, TypeVar

from ocplanner.errors import ResultFileError
from ocplanner.files.records.episode import EpisodeResult
from ocplanner.files.storage import atomic_json
from ocplanner.settings import build

FORMAT = 2
"""Format 1 has no ``format``, ``privileged`` and ``planners``, and each setting is a key of its own."""


class Conditions(Protocol):
    """What a result file must know about the settings of its transfer; rooms above define them."""

    @classmethod
    def from_result(cls, content: Mapping[str, Any]) -> Self:
        """The settings that a result file of any format states.

        Raises:
            KeyError, TypeError, ValueError: a setting is missing, unknown or outside its domain.
        """
        ...

    def to_json(self) -> dict[str, Any]:
        """All settings as JSON types."""
        ...

    @property
    def names(self) -> tuple[str, ...]:
        """The follow mode and every setting that is not the default, for file names."""
        ...

    @property
    def texts(self) -> tuple[str, ...]:
        """The same for readers."""
        ...


Settings = TypeVar("Settings", bound=Conditions)


@dataclass(frozen=True)
class TransferRecord(Generic[Settings]):
    """Episodes of one planner on one robot.

    Attributes:
        task: name of the task.
        robot: name of the robot.
        observe: what the planner saw.
        visual: visual preset of its images; None in files that do not say.
        planner_visual: preset of the images that it was trained on, if known.
        patches: corrections of the robot's model that were applied.
        settings: the conditions of the transfer.
        privileged: inputs that a real robot does not have.
        planners: planner files, in the task's order, as they were named; empty in files of format 1.
        planner_sha256: hash of the planner file; of several files, their hashes joined by ``+``.
        planner_seed: training seed of the planner, if known.
        command: remakes this result.
        versions: installed versions by package.
        interval: 95 % Wilson interval of the success rate.
        runs: the episodes, by seed.
        path: the file that it was read from.
        original: content of a file of format 1, which does not state every setting: a matrix repeats it as it is.
    """

    task: str
    robot: str
    observe: str
    visual: str | None
    planner_visual: str | None
    patches: tuple[str, ...]
    settings: Settings
    privileged: tuple[str, ...]
    planners: tuple[str, ...] = field(compare=False)
    planner_sha256: str
    planner_seed: int | None
    command: str
    versions: Mapping[str, str]
    interval: tuple[float, float] = (0.0, 1.0)
    runs: tuple[EpisodeResult, ...] = ()
    path: Path = field(default=Path(), compare=False)
    original: Mapping[str, Any] | None = field(default=None, compare=False, repr=False)

    @property
    def episodes(self) -> int:
        """How many episodes were run."""
        return len(self.runs)

    @property
    def successes(self) -> int:
        """How many succeeded."""
        return sum(run.success for run in self.runs)

    @property
    def rate(self) -> float:
        """Success rate in [0, 1]."""
        return self.successes / self.episodes if self.episodes else 0.0

    @property
    def failures(self) -> Counter[str]:
        """Failed episodes by class."""
        return Counter(run.failure or "unclassified" for run in self.runs if not run.success)

    def episode(self, seed: int) -> EpisodeResult | None:
        """The episode of ``seed``, if it was run."""
        return next((run for run in self.runs if run.seed == seed), None)

    @property
    def conditions(self) -> tuple[Any, ...]:
        """Everything that decides how the episodes go, except the planner: results with equal conditions compare."""
        return self.task, self.robot, self.observe, self.patches, self.settings

    @property
    def identity(self) -> dict[str, Any]:
        """Everything that decides how the episodes go, as JSON types."""
        content = self.to_json()
        names = ("task", "robot", "observe", "visual", "patches", "settings", "planner_sha256")
        return {name: content[name] for name in names}

    @property
    def setting(self) -> str:
        """The conditions in words, such as ``gated, masked, no patches``."""
        follow, *others = self.settings.texts
        return ", ".join([follow, self.observe, *others])

    @property
    def title(self) -> str:
        """What was run, such as ``Square on Sawyer (gated, masked)``."""
        return f"{self.task} on {self.robot} ({self.setting})"

    @property
    def file_name(self) -> str:
        """Such as ``square_sawyer_gated_masked_0.json``, with every setting that is not the default before the seed."""
        follow, *others = self.settings.names
        seed = [] if self.planner_seed is None else [str(self.planner_seed)]
        return "_".join([self.task, self.robot, follow, self.observe, *others, *seed]).lower() + ".json"

    def to_json(self) -> dict[str, Any]:
        """The content of the result file."""
        return {
            "format": FORMAT,
            "task": self.task,
            "robot": self.robot,
            "observe": self.observe,
            "visual": self.visual,
            "planner_visual": self.planner_visual,
            "patches": list(self.patches),
            "settings": self.settings.to_json(),
            "privileged": list(self.privileged),
            "episodes": self.episodes,
            "successes": self.successes,
            "interval": list(self.interval),
            "failures": dict(self.failures),
            "planners": list(self.planners),
            "planner_sha256": self.planner_sha256,
            "planner_seed": self.planner_seed,
            "command": self.command,
            "versions": dict(self.versions),
            "runs": [run.to_json() for run in self.runs],
        }

    def save(self, path: str | Path) -> Path:
        """Write the result file, whole or not at all."""
        atomic_json(path, self.to_json())
        return Path(path)

    def __str__(self) -> str:
        """The line that the command prints."""
        low, high = self.interval
        line = f"{self.title}: {self.successes}/{self.episodes} succeeded, 95 % interval {low:.2f}-{high:.2f}"
        if self.failures:
            line += "; failed: " + ", ".join(f"{count} {name}" for name, count in sorted(self.failures.items()))
        return line


@dataclass(frozen=True)
class MatrixRecord(Generic[Settings]):
    """Transfers of one planner a task, or one planner an object of it, to several robots.

    Attributes:
        command: the command that added the latest cells; each cell names its own.
        cells: task by task, robot by robot, as far as they have been run.
    """

    command: str
    cells: tuple[TransferRecord[Settings], ...]

    def save(self, path: str | Path) -> Path:
        """Write ``matrix.json``, whole or not at all."""
        cells = [cell.to_json() if cell.original is None else cell.original for cell in self.cells]
        atomic_json(path, {"format": FORMAT, "command": self.command, "cells": cells})
        return Path(path)


def privileged_inputs(observe: str) -> tuple[str, ...]:
    """Inputs of a simulated transfer that a real robot does not have.

    Args:
        observe: what the planner sees.
    """
    return ("object pose", "hidden robot") if observe == "no-robot" else ("object pose",)


def is_transfer(content: Any) -> bool:
    """Whether parsed JSON is the result of a transfer, by its keys."""
    return isinstance(content, dict) and all(key in content for key in ("robot", "episodes", "runs"))


def is_matrix(content: Any) -> bool:
    """Whether parsed JSON is a matrix with at least one cell, by its keys."""
    cells = content.get("cells") if isinstance(content, dict) else None
    return isinstance(cells, list) and bool(cells) and all(is_transfer(cell) for cell in cells)


def read_transfer(path: str | Path, settings: type[Settings]) -> TransferRecord[Settings]:
    """Read one result file of any format.

    Args:
        path: the file.
        settings: class of the settings.

    Raises:
        ResultFileError: it is missing, damaged, of another kind or of a newer format.
    """
    return _transfer(Path(path), _content(Path(path)), settings)


def read_transfers(path: str | Path, settings: type[Settings]) -> tuple[TransferRecord[Settings], ...]:
    """Read the results in a file: one, or the cells of a matrix.

    Args:
        path: the file.
        settings: class of the settings.

    Raises:
        ResultFileError: it is missing, damaged, of another kind or of a newer format.
    """
    path = Path(path)
    content = _content(path)
    if "cells" not in content:
        return (_transfer(path, content, settings),)
    _check_format(path, content)
    if not isinstance(content["cells"], list):
        raise ResultFileError(f"{path} holds no transfer results: cells is no list")
    return tuple(_transfer(path, cell, settings) for cell in content["cells"])


def _content(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ResultFileError(f"cannot read {path}: {error}; run its transfer again") from error
    if not isinstance(content, dict):
        raise ResultFileError(f"{path} is no result of a transfer: it holds a {type(content).__name__}")
    return content


def _check_format(path: Path, content: Mapping[str, Any]) -> int:
    found = content.get("format", 1)
    if found not in range(1, FORMAT + 1):
        raise ResultFileError(f"{path} has format {found!r}, but this version reads 1 to {FORMAT}; update ocplanner")
    return found


def _transfer(path: Path, content: Any, settings: type[Settings]) -> TransferRecord[Settings]:
    if not isinstance(content, dict):
        raise ResultFileError(f"{path} holds no transfer results: a cell is a {type(content).__name__}")
    old = _check_format(path, content) == 1
    try:
        task, observe = str(content["task"]), str(content["observe"])
        low, high = map(float, content["interval"])
        result = TransferRecord(
            task=task,
            robot=str(content["robot"]),
            observe=observe,
            visual=content.get("visual"),
            planner_visual=content.get("planner_visual"),
            patches=tuple(map(str, content["patches"])),
            settings=settings.from_result(content),
            privileged=privileged_inputs(observe) if old else tuple(map(str, content["privileged"])),
            planners=() if old else tuple(map(str, content["planners"])),
            planner_sha256=str(content["planner_sha256"]),
            planner_seed=content["planner_seed"],
            command=str(content["command"]),
            versions={str(name): str(version) for name, version in content["versions"].items()},
            interval=(low, high),
            runs=tuple(build(EpisodeResult, run) for run in content["runs"]),
            path=path,
            original=content if old else None,
        )
        counted = int(content["successes"]), int(content["episodes"])
    except KeyError as error:
        raise ResultFileError(f"{path} is no result of a transfer: it lacks {error.args[0]}") from error
    except (TypeError, ValueError, AttributeError) as error:
        raise ResultFileError(f"{path} is damaged: {error}; run its transfer again") from error
    if counted != (result.successes, result.episodes):
        raise ResultFileError(
            f"{path} is damaged: it counts {counted[0]} successes of {counted[1]} episodes, but its runs have "
            f"{result.successes} of {result.episodes}; run its transfer again"
        )
    return result

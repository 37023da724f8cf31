"""Read zero-shot results (``transfer.json``) and group those that differ only in the planner's training seed."""

import json
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ocplanner.control.noisy_pose import PoseError
from ocplanner.errors import ResultFileError
from ocplanner.zero_shot.result import FAILURES

_REQUIRED = ("task", "robot", "follow", "observe", "episodes", "successes", "interval", "runs")


@dataclass(frozen=True)
class EpisodeRecord:
    """One episode: its seed, whether it succeeded, its control steps, and the failure class of a failed one."""

    seed: int
    success: bool
    steps: int
    failure: str | None


@dataclass(frozen=True)
class TransferRecord:
    """The content of one result file.

    ``interval`` is the 95 % Wilson interval of the success rate, ``planner_seed`` the training seed of the planner,
    ``mask_error`` the pixels by which masks of the robot were off, ``pose_error`` how wrong the object's pose was that
    was read, ``pose_filter`` the control steps over which it was averaged, ``foreign_visual`` the visual preset if the
    planner was trained on another.
    """

    path: Path
    task: str
    robot: str
    follow: str
    observe: str
    patches: tuple[str, ...]
    episodes: int
    successes: int
    interval: tuple[float, float]
    planner_sha256: str
    command: str
    versions: Mapping[str, str]
    mask_error: int
    pose_error: PoseError
    pose_filter: int
    planner_seed: int | None
    foreign_visual: str | None
    runs: tuple[EpisodeRecord, ...]

    @property
    def rate(self) -> float:
        """Success rate in [0, 1]."""
        return self.successes / self.episodes if self.episodes else 0.0

    @property
    def title(self) -> str:
        """What was run, such as ``Square on Sawyer (gated, masked)``."""
        return f"{self.task} on {self.robot} ({self.setting})"

    @property
    def setting(self) -> str:
        """How it was run, such as ``gated, masked``."""
        error = self.pose_error
        noisy, late = error.position_mm or error.rotation_deg, error.latency_steps
        noise = [f"pose noise {error.position_mm:g} mm {error.rotation_deg:g}°"] if noisy else []
        latency = [f"pose {late} step{'s' * (late > 1)} late"] if late else []
        mean = [f"averaged over {self.pose_filter} steps"] if self.pose_filter > 1 else []
        return ", ".join([self.exact_setting, *noise, *latency, *mean])

    @property
    def exact_setting(self) -> str:
        """How it was run, but for the error of the object's pose and what was done about it."""
        error = [f"mask {self.mask_error} px off"] if self.mask_error else []
        visual = [f"{self.foreign_visual} visuals"] if self.foreign_visual else []
        return ", ".join([self.follow, self.observe, *error, *visual])

    def failures(self) -> Counter[str]:
        """How many episodes failed in each class."""
        return Counter(run.failure or "unclassified" for run in self.runs if not run.success)

    def episode(self, seed: int) -> EpisodeRecord | None:
        """The episode of ``seed``, if it was run."""
        return next((run for run in self.runs if run.seed == seed), None)


@dataclass(frozen=True)
class TransferGroup:
    """Results of one task, robot, follower, observation and set of patches: one for each planner evaluated."""

    records: tuple[TransferRecord, ...]

    @property
    def title(self) -> str:
        """What was run."""
        return self.records[0].title

    @property
    def mean_rate(self) -> float:
        """Mean success rate over the planners."""
        return sum(record.rate for record in self.records) / len(self.records)

    def failures(self) -> Counter[str]:
        """Failure classes counted over all planners."""
        return sum((record.failures() for record in self.records), Counter())


def group_results(records: Iterable[TransferRecord]) -> list[TransferGroup]:
    """Group records that differ only in the planner, in the order in which each group first appears."""
    groups: dict[tuple[Any, ...], list[TransferRecord]] = {}
    for record in records:
        key = (record.task, record.robot, record.setting, record.patches)
        groups.setdefault(key, []).append(record)
    return [TransferGroup(tuple(members)) for members in groups.values()]


def failure_classes(groups: Sequence[TransferGroup]) -> list[str]:
    """The classes to show: the known ones in order, then any other that occurs."""
    found = {name for group in groups for name in group.failures()}
    return [*FAILURES, *sorted(found - set(FAILURES))]


def is_result(content: Any) -> bool:
    """Whether parsed JSON is a transfer result, by its keys."""
    return isinstance(content, dict) and all(key in content for key in ("robot", "episodes", "runs"))


def read_results(path: str | Path) -> list[TransferRecord]:
    """The transfer results in a JSON file: one, or the cells of a ``matrix.json``.

    Raises:
        ResultFileError: the file is missing or damaged, or lacks a key.
    """
    path = Path(path)
    try:
        content = json.loads(path.read_text())
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise ResultFileError(f"cannot read {path}: {error}") from error
    cells = content.get("cells") if isinstance(content, dict) and "cells" in content else [content]
    if not isinstance(cells, list) or not all(isinstance(cell, dict) for cell in cells):
        raise ResultFileError(f"{path} holds no transfer results")
    return [_parse(path, cell) for cell in cells]


def _parse(path: Path, content: dict[str, Any]) -> TransferRecord:
    missing = [key for key in _REQUIRED if key not in content]
    if missing:
        raise ResultFileError(f"{path} is no transfer result: it lacks {', '.join(missing)}")
    try:
        low, high = (float(bound) for bound in content["interval"])
        runs = tuple(
            EpisodeRecord(int(run["seed"]), bool(run["success"]), int(run["steps"]), run.get("failure"))
            for run in content["runs"]
        )
        return TransferRecord(
            path=path,
            task=str(content["task"]),
            robot=str(content["robot"]),
            follow=str(content["follow"]),
            observe=str(content["observe"]),
            patches=tuple(str(patch) for patch in content.get("patches", [])),
            episodes=int(content["episodes"]),
            successes=int(content["successes"]),
            interval=(low, high),
            planner_sha256=str(content.get("planner_sha256", "")),
            command=str(content.get("command", "")),
            versions={str(name): str(version) for name, version in content.get("versions", {}).items()},
            mask_error=int(content.get("mask_error", 0)),
            pose_error=PoseError(**content.get("pose_error", {})),
            pose_filter=int(content.get("pose_filter", 1)),
            planner_seed=None if content.get("planner_seed") is None else int(content["planner_seed"]),
            foreign_visual=_foreign_visual(content),
            runs=runs,
        )
    except (TypeError, ValueError, KeyError, AttributeError) as error:
        raise ResultFileError(f"{path} is damaged: {error!r}") from error


def _foreign_visual(content: dict[str, Any]) -> str | None:
    drawn, trained = content.get("visual"), content.get("planner_visual")
    return str(drawn) if trained is not None and drawn != trained else None

"""What a transfer gives: episodes one by one, the rate, and what it takes to run it again."""

import json
from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ocplanner.control.noisy_pose import PoseError
from ocplanner.errors import ResultFileError
from ocplanner.files.records.episode import EpisodeResult
from ocplanner.files.storage import atomic_json
from ocplanner.rollouts.intervals import wilson

FAILURES = (
    "missed grasp",
    "lost grasp",
    "not handed over",
    "slip",
    "stuck in transit",
    "not aligned",
    "not released",
    "time-out",
)
"""The classes of failed episodes, in the order in which an episode meets them."""


_PLAIN = (
    "task",
    "robot",
    "follow",
    "observe",
    "visual",
    "planner_visual",
    "control",
    "mask_error",
    "planner_sha256",
    "planner_seed",
    "command",
    "versions",
)


@dataclass(frozen=True)
class TransferResult:
    """Episodes of one planner on one robot.

    Attributes:
        task: name of the task.
        robot: name of the robot.
        follow: follow mode.
        observe: what the planner saw.
        visual: visual preset that its pictures were drawn with.
        planner_visual: the one that it was trained on, if known.
        control: who was asked to run the control loop.
        patches: corrections of the model that were on.
        mask_error: pixels by which masks were wrong.
        pose_error: how wrong the object's pose was that grasping and following read.
        pose_filter: control steps over which they averaged it, 1 for none.
        planner_sha256: of the planner file; of several, one an object, those of each, joined by ``+``.
        planner_seed: training seed of the planner, if known.
        command: remakes this result.
        versions: installed versions by package.
        runs: the episodes, by seed.
    """

    task: str
    robot: str
    follow: str
    observe: str
    visual: str
    planner_visual: str | None
    control: str
    patches: tuple[str, ...]
    mask_error: int
    pose_error: PoseError
    pose_filter: int
    planner_sha256: str
    planner_seed: int | None
    command: str
    versions: dict[str, str]
    runs: tuple[EpisodeResult, ...]

    @property
    def episodes(self) -> int:
        """How many episodes were run."""
        return len(self.runs)

    @property
    def successes(self) -> int:
        """How many succeeded."""
        return sum(run.success for run in self.runs)

    @property
    def interval(self) -> tuple[float, float]:
        """95 % Wilson interval of the success rate."""
        return wilson(self.successes, self.episodes)

    @property
    def failures(self) -> dict[str, int]:
        """Failed episodes by class."""
        return dict(Counter(run.failure for run in self.runs if run.failure is not None))

    def to_json(self) -> dict[str, Any]:
        """The content of a result file."""
        return {
            "task": self.task,
            "robot": self.robot,
            "follow": self.follow,
            "observe": self.observe,
            "visual": self.visual,
            "planner_visual": self.planner_visual,
            "control": self.control,
            "patches": list(self.patches),
            "mask_error": self.mask_error,
            "pose_error": asdict(self.pose_error),
            "pose_filter": self.pose_filter,
            "episodes": self.episodes,
            "successes": self.successes,
            "interval": list(self.interval),
            "failures": self.failures,
            "planner_sha256": self.planner_sha256,
            "planner_seed": self.planner_seed,
            "command": self.command,
            "versions": self.versions,
            "runs": [run.to_json() for run in self.runs],
        }

    @classmethod
    def load(cls, path: str | Path) -> "TransferResult":
        """Read a result file.

        Raises:
            ResultFileError: it is missing, damaged, or of another kind.
        """
        try:
            content = json.loads(Path(path).read_text(encoding="utf-8"))
            return cls(
                **{key: content[key] for key in _PLAIN},
                patches=tuple(content["patches"]),
                pose_error=PoseError(**content.get("pose_error", {})),
                pose_filter=content.get("pose_filter", 1),
                runs=tuple(EpisodeResult(**run) for run in content["runs"]),
            )
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            raise ResultFileError(f"{path} is no result of a transfer, or damaged: {error!r}") from error

    def save(self, path: str | Path) -> Path:
        """Write the result file, whole or not at all."""
        atomic_json(path, self.to_json())
        return Path(path)

    @property
    def file_name(self) -> str:
        """Such as ``square_sawyer_gated_masked_0.json``; names errors and a visual preset that is not the planner's."""
        error = [f"error{self.mask_error}"] if self.mask_error else []
        foreign = [] if self.visual == self.planner_visual else [self.visual]
        parts = [self.task, self.robot, self.follow, self.observe, *error, *self._sensing, *foreign]
        seed = [] if self.planner_seed is None else [str(self.planner_seed)]
        return "_".join([*parts, *seed]).lower() + ".json"

    @property
    def _sensing(self) -> tuple[str, ...]:
        return (*self.pose_error.labels, *([f"filter{self.pose_filter}"] if self.pose_filter > 1 else []))

    def __str__(self) -> str:
        """The line that the command prints."""
        low, high = self.interval
        setting = ", ".join([self.follow, self.observe, *self._sensing])
        lines = f"{self.task} on {self.robot} ({setting}): {self.successes}/{self.episodes}"
        lines += f" succeeded, 95 % interval {low:.2f}-{high:.2f}"
        if self.failures:
            lines += "; failed: " + ", ".join(f"{count} {name}" for name, count in sorted(self.failures.items()))
        return lines

"""What a transfer gives: episodes one by one, the rate, and what it takes to run it again."""

from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ocplanner.evaluation.intervals import wilson
from ocplanner.storage import atomic_json


@dataclass(frozen=True)
class Run:
    """One episode's outcome; see :class:`ocplanner.transfer.episode.Episode`."""

    seed: int
    success: bool
    steps: int
    failure: str | None
    released_by: str | None


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
        planner_sha256: of the planner file.
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
    planner_sha256: str
    planner_seed: int | None
    command: str
    versions: dict[str, str]
    runs: tuple[Run, ...]

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
            "episodes": self.episodes,
            "successes": self.successes,
            "interval": list(self.interval),
            "failures": self.failures,
            "planner_sha256": self.planner_sha256,
            "planner_seed": self.planner_seed,
            "command": self.command,
            "versions": self.versions,
            "runs": [asdict(run) for run in self.runs],
        }

    def save(self, path: str | Path) -> Path:
        """Write the result file, whole or not at all."""
        atomic_json(path, self.to_json())
        return Path(path)

    def __str__(self) -> str:
        """The line that the command prints."""
        low, high = self.interval
        lines = f"{self.task} on {self.robot} ({self.follow}, {self.observe}): {self.successes}/{self.episodes}"
        lines += f" succeeded, 95 % interval {low:.2f}-{high:.2f}"
        if self.failures:
            lines += "; failed: " + ", ".join(f"{count} {name}" for name, count in sorted(self.failures.items()))
        return lines


def result_name(
    task: str,
    robot: str,
    follow: str,
    observe: str,
    planner_seed: int | None,
    mask_error: int = 0,
    visual: str | None = None,
) -> str:
    """File name of a result, such as ``square_sawyer_gated_masked_0.json``; names ``visual`` if it is given."""
    error = [f"error{mask_error}"] if mask_error else []
    parts = [task, robot, follow, observe, *error, *([visual] if visual else [])]
    seed = [] if planner_seed is None else [str(planner_seed)]
    return "_".join([*parts, *seed]).lower() + ".json"

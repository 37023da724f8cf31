"""What an evaluation of policies gives: every episode of every checkpoint, and the two numbers that papers report."""

import json
from collections import Counter
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from ocplanner.errors import ResultFileError
from ocplanner.files.records.episode import EpisodeResult
from ocplanner.files.storage import atomic_json
from ocplanner.rollouts.intervals import wilson

_LAST = 5
_OF_LATER_FILES = ("seed_start", "horizon", "rewards")
"""Settings that the first files do not say."""


@dataclass(frozen=True)
class Checkpoint:
    """The episodes of one policy file.

    Attributes:
        step: training steps done.
        sha256: of the file.
        runs: the episodes, by seed.
    """

    step: int
    sha256: str
    runs: tuple[EpisodeResult, ...]

    @property
    def successes(self) -> int:
        """How many succeeded."""
        return sum(run.success for run in self.runs)

    @property
    def rate(self) -> float:
        """Share of episodes that succeeded."""
        return self.successes / len(self.runs)

    @property
    def failures(self) -> dict[str, int]:
        """Failed episodes by class, see :class:`ocplanner.policies.rollout.Outcome`."""
        return dict(Counter(run.failure for run in self.runs if run.failure is not None))

    @property
    def interval(self) -> tuple[float, float]:
        """95 % Wilson interval of the rate."""
        return wilson(self.successes, len(self.runs))


@dataclass(frozen=True)
class PolicyResult:
    """Episodes of the checkpoints of one training.

    Attributes:
        task: name of the task.
        robot: name of the robot.
        algorithm: ``bc``, ``bc-rnn`` or ``bcq``.
        training: its whole configuration.
        labels: how its hints were made, or None.
        planner_sha256: of the planner file that made them live, or None.
        episodes: of each checkpoint.
        checkpoints: in the order of training.
        command: remakes this result.
        versions: installed versions by package.
        seed_start: seed of the first episode; the others follow. None in files that do not say.
        horizon: control steps of an episode; None: the task's own, or a file that does not say.
        rewards: how ``ocplanner label`` made those that it learned from; None: recorded, unused, or not said.
    """

    task: str
    robot: str
    algorithm: str
    training: dict[str, Any]
    labels: dict[str, Any] | None
    planner_sha256: str | None
    episodes: int
    checkpoints: tuple[Checkpoint, ...]
    command: str
    versions: dict[str, str]
    seed_start: int | None = None
    horizon: int | None = None
    rewards: dict[str, Any] | None = None

    @property
    def best(self) -> float:
        """Success rate of the best checkpoint, as robomimic and the paper report; flatters the more there are."""
        return max(checkpoint.rate for checkpoint in self.checkpoints)

    @property
    def last_checkpoints(self) -> tuple[Checkpoint, ...]:
        """The last five, or all if there are fewer."""
        return self.checkpoints[-_LAST:]

    @property
    def last_five(self) -> float:
        """Mean success rate of the last five checkpoints, or of all if there are fewer."""
        return float(np.mean([checkpoint.rate for checkpoint in self.last_checkpoints]))

    def to_json(self) -> dict[str, Any]:
        """The content of a result file."""
        return {
            "task": self.task,
            "robot": self.robot,
            "algorithm": self.algorithm,
            "best": self.best,
            "last_five": self.last_five,
            "last_five_checkpoints": len(self.last_checkpoints),
            "episodes": self.episodes,
            "seed_start": self.seed_start,
            "horizon": self.horizon,
            "training": self.training,
            "labels": self.labels,
            "rewards": self.rewards,
            "planner_sha256": self.planner_sha256,
            "command": self.command,
            "versions": self.versions,
            "checkpoints": [
                {
                    "step": checkpoint.step,
                    "sha256": checkpoint.sha256,
                    "successes": checkpoint.successes,
                    "interval": list(checkpoint.interval),
                    "runs": [
                        {key: value for key, value in run.to_json().items() if key != "released_by"}
                        for run in checkpoint.runs
                    ],
                }
                for checkpoint in self.checkpoints
            ],
        }

    @classmethod
    def load(cls, path: str | Path) -> "PolicyResult":
        """Read a result file that :meth:`save` wrote.

        Raises:
            ResultFileError: it is missing, damaged, or no evaluation of a policy.
        """
        try:
            content = json.loads(Path(path).read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise ResultFileError(f"cannot read {path}: {error}; evaluate the policy again") from error
        try:
            kept = {field.name: content[field.name] for field in fields(cls) if field.name not in _OF_LATER_FILES}
            kept |= {name: content.get(name) for name in _OF_LATER_FILES}
            checkpoints = tuple(_checkpoint(entry) for entry in kept.pop("checkpoints"))
            if not checkpoints or any(not checkpoint.runs for checkpoint in checkpoints):
                raise ValueError("a checkpoint without episodes")
            if not all(isinstance(kept[name], dict) for name in ("training", "versions")):
                raise TypeError("training and versions must be objects")
            return cls(**kept, checkpoints=checkpoints)
        except (KeyError, TypeError, ValueError) as error:
            raise ResultFileError(
                f"{path} is no evaluation of a policy, or is damaged: {error!r}; make one with `ocplanner evaluate`"
            ) from error

    def save(self, path: str | Path) -> Path:
        """Write the result file, whole or not at all."""
        atomic_json(path, self.to_json())
        return Path(path)

    def __str__(self) -> str:
        """What the command prints: a line for each checkpoint, then the two numbers."""
        hint = "" if self.labels is None else " with hints"
        lines = [f"{self.algorithm}{hint} on {self.robot} {self.task}, {self.episodes} episodes a checkpoint"]
        for checkpoint in self.checkpoints:
            low, high = checkpoint.interval
            lines.append(
                f"step {checkpoint.step}: {checkpoint.successes}/{len(checkpoint.runs)} succeeded, "
                f"95 % interval {low:.2f}-{high:.2f}{_counted(checkpoint.failures)}"
            )
        if len(self.checkpoints) > 1:
            last = min(_LAST, len(self.checkpoints))
            lines.append(f"best {100 * self.best:.1f} %, mean of the last {last} {100 * self.last_five:.1f} %")
        return "\n".join(lines)


def _counted(failures: dict[str, int]) -> str:
    return "".join(f"; {count} {failure}" for failure, count in sorted(failures.items()))


def _checkpoint(content: dict[str, Any]) -> Checkpoint:
    runs = tuple(
        EpisodeResult(int(run["seed"]), bool(run["success"]), int(run["steps"]), run.get("failure"), None)
        for run in content["runs"]
    )
    return Checkpoint(int(content["step"]), str(content["sha256"]), runs)

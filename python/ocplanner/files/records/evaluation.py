"""The result of ``ocplanner evaluate``: every episode of every checkpoint, and the two rates that papers report."""

import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from ocplanner.errors import ResultFileError
from ocplanner.files.records.episode import MOST_EPISODES, EpisodeResult
from ocplanner.files.records.labels import LabelRecord
from ocplanner.files.storage import atomic_json
from ocplanner.settings import build, require, require_seed, to_dict

FORMAT = 2
"""Format 1 has no ``format``, ``privileged`` and ``settings``; some settings are keys of their own."""
_LAST = 5


@dataclass(frozen=True)
class EvaluationSettings:
    """How policies are evaluated.

    Raises:
        InvalidValueError: a number is less than 1.
    """

    episodes: int = 50
    """Episodes of each checkpoint."""
    last: int | None = None
    """Only the last so many checkpoints of a run folder."""
    seed_start: int = 20000
    """Seed of the first episode; the others follow."""
    horizon: int | None = None
    """Control steps of an episode instead of the task's."""
    visual: Literal["fast", "stock"] | None = None
    """How pictures are drawn, for a policy whose file does not say how those were that it learned from."""

    def __post_init__(self) -> None:
        """Check the numbers."""
        for name in ("episodes", "last", "horizon"):
            value = getattr(self, name)
            require(value is None or value >= 1, f"{name} is {value}, but must be at least 1")
        require(self.episodes <= MOST_EPISODES, f"episodes is {self.episodes}, but must be at most {MOST_EPISODES}")
        require_seed(self.seed_start, "seed_start")


@dataclass(frozen=True)
class CheckpointResult:
    """The episodes of one policy file.

    Attributes:
        step: training steps done.
        sha256: hash of the file.
        interval: 95 % Wilson interval of the success rate.
        runs: the episodes, by seed.
    """

    step: int
    sha256: str
    interval: tuple[float, float]
    runs: tuple[EpisodeResult, ...]

    def __post_init__(self) -> None:
        """Check that there is something to average."""
        require(len(self.runs) > 0, f"the checkpoint at step {self.step} has no episodes")

    @property
    def successes(self) -> int:
        """How many episodes succeeded."""
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
    def outcomes(self) -> np.ndarray:
        """(episodes,) bool: which of them succeeded."""
        return np.array([run.success for run in self.runs])


@dataclass(frozen=True)
class PolicyResult:
    """Episodes of the checkpoints of one training.

    Attributes:
        task: name of the task.
        robot: name of the robot.
        algorithm: that trained the policies.
        training: its whole configuration, :class:`ocplanner.policies.config.PolicyTraining` as plain values.
        labels: how the hints were made, or None.
        rewards: how the rewards were made that it learned from, if ``ocplanner label`` made them; None otherwise, and
            in files that do not say.
        planner_sha256: hash of the planner file that made the hints live, or None.
        settings: how it was evaluated. Files of format 1 do not say ``last``, and some not ``horizon``.
        privileged: inputs that a real robot does not have; empty in files of format 1.
        checkpoints: in the order of training.
        command: remakes this result.
        versions: installed versions by package.
    """

    task: str
    robot: str
    algorithm: str
    training: Mapping[str, Any]
    labels: LabelRecord | None
    rewards: LabelRecord | None
    planner_sha256: str | None
    settings: EvaluationSettings
    privileged: tuple[str, ...]
    checkpoints: tuple[CheckpointResult, ...]
    command: str
    versions: Mapping[str, str]

    def __post_init__(self) -> None:
        """Check that there is something to average."""
        require(len(self.checkpoints) > 0, "there are no checkpoints")

    @property
    def best(self) -> float:
        """Success rate of the best checkpoint, as robomimic and the paper report; flatters the more there are."""
        return max(checkpoint.rate for checkpoint in self.checkpoints)

    @property
    def last_checkpoints(self) -> tuple[CheckpointResult, ...]:
        """The last five, or all if there are fewer."""
        return self.checkpoints[-_LAST:]

    @property
    def last_five(self) -> float:
        """Mean success rate of the last five checkpoints, or of all if there are fewer."""
        return float(np.mean([checkpoint.rate for checkpoint in self.last_checkpoints]))

    @property
    def last_outcomes(self) -> np.ndarray:
        """(n,) bool: which episodes of the last five checkpoints succeeded; no two start from the same state."""
        return np.concatenate([checkpoint.outcomes for checkpoint in self.last_checkpoints])

    def to_json(self) -> dict[str, Any]:
        """The content of the result file."""
        content = to_dict(self)
        for entry, checkpoint in zip(content["checkpoints"], self.checkpoints):
            entry["successes"] = checkpoint.successes
            entry["runs"] = [
                {"seed": run.seed, "success": run.success, "steps": run.steps, "failure": run.failure}
                for run in checkpoint.runs
            ]
        rates = {"best": self.best, "last_five": self.last_five, "last_five_checkpoints": len(self.last_checkpoints)}
        return {"format": FORMAT, **rates, **content}

    @classmethod
    def load(cls, path: str | Path) -> "PolicyResult":
        """Read a result file of any format.

        Raises:
            ResultFileError: it is missing, damaged, of a newer format, or no evaluation of a policy.
        """
        try:
            content = json.loads(Path(path).read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise ResultFileError(f"cannot read {path}: {error}; evaluate the policy again") from error
        found = content.get("format", 1) if isinstance(content, dict) else None
        if isinstance(found, int) and found > FORMAT:
            raise ResultFileError(f"{path} has format {found}, but this version reads 1 to {FORMAT}; update ocplanner")
        try:
            result = build(cls, _from_format_1(content) if found == 1 else content, ignore_unknown=True)
            for entry, checkpoint in zip(content["checkpoints"], result.checkpoints):
                counted, step = entry["successes"], checkpoint.step
                right = counted == checkpoint.successes
                require(right, f"step {step} counts {counted} successes, but its runs have {checkpoint.successes}")
            return result
        except (AttributeError, IndexError, KeyError, TypeError, ValueError) as error:
            raise ResultFileError(
                f"{path} is no evaluation of a policy, or is damaged: {error}; make one with `ocplanner evaluate`"
            ) from error

    def save(self, path: str | Path) -> Path:
        """Write the result file, whole or not at all."""
        atomic_json(path, self.to_json())
        return Path(path)

    def __str__(self) -> str:
        """What the command prints: a line for each checkpoint, then the two rates."""
        hint = "" if self.labels is None else " with hints"
        episodes = len(self.checkpoints[0].runs)
        lines = [f"{self.algorithm}{hint} on {self.robot} {self.task}, {episodes} episodes a checkpoint"]
        for checkpoint in self.checkpoints:
            low, high = checkpoint.interval
            failures = "".join(f"; {count} {failure}" for failure, count in sorted(checkpoint.failures.items()))
            lines.append(
                f"step {checkpoint.step}: {checkpoint.successes}/{len(checkpoint.runs)} succeeded, "
                f"95 % interval {low:.2f}-{high:.2f}{failures}"
            )
        if len(self.checkpoints) > 1:
            last = len(self.last_checkpoints)
            lines.append(f"best {100 * self.best:.1f} %, mean of the last {last} {100 * self.last_five:.1f} %")
        return "\n".join(lines)


def is_evaluation(content: Any) -> bool:
    """Whether parsed JSON is an evaluation of a policy, by its keys."""
    return isinstance(content, dict) and all(key in content for key in ("algorithm", "training", "checkpoints"))


def _from_format_1(content: Mapping[str, Any]) -> dict[str, Any]:
    settings = {
        "episodes": content["episodes"],
        "seed_start": content["checkpoints"][0]["runs"][0]["seed"],
        "horizon": content.get("horizon"),
    }
    return {"rewards": None, **content, "settings": settings, "privileged": ()}

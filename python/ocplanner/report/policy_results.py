"""Read evaluations of policies, and group those that differ only in the training seed."""

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ocplanner.errors import ResultFileError
from ocplanner.policies.result import Checkpoint, PolicyResult
from ocplanner.rollouts.intervals import wilson

_OF_ONE_TRAINING = ("seed", "threads", "device")
"""Settings that may differ inside a cell."""


class PolicyKind(NamedTuple):
    """What a policy is in three words, such as ``BC-RNN``, ``image``, ``k = 5``; the hint is "" without one."""

    algorithm: str
    observations: str
    hint: str

    @property
    def variant(self) -> str:
        """The hint in words."""
        return f"hint {self.hint}" if self.hint else "no hint"

    def __str__(self) -> str:
        """All of it."""
        return ", ".join([self.algorithm, self.observations, self.variant])


def policy_kind(training: Mapping[str, Any], labels: Mapping[str, Any] | None = None) -> PolicyKind:
    """Name a policy by its training's configuration, and by how its hints were made where that is known."""
    cameras = (training.get("observation") or {}).get("cameras")
    hint = (training.get("network") or {}).get("hint")
    spoken = ""
    if hint:
        origin = "" if labels is None else f" from the {labels['settings']['hint_from']}"
        spoken = f"k = {', '.join(map(str, hint['horizons']))}{origin}{_use(hint)}"
    own = training.get("algorithm_settings") or training.get("bcq") or {}
    sampler = str(own.get("sampler"))
    algorithm = str(training.get("algorithm", "unknown")).upper() + {"gmm": "-GMM", "policy": "-BC"}.get(sampler, "")
    return PolicyKind(algorithm, "image" if cameras else "state", spoken)


def _use(hint: Mapping[str, Any]) -> str:
    """What is made of a hint, where that is not the paper's; files say nothing of what came after them."""
    words = [", steers" if hint.get("steers") else "", ", no pictures" if hint.get("instead_of_pictures") else ""]
    if hint.get("initial_weight", 1.0) != 1.0:
        words.append(f", weight {hint['initial_weight']:g}")
    if hint.get("residual_penalty"):
        words.append(f", penalty {hint['residual_penalty']:g}")
    return "".join(words)


@dataclass(frozen=True)
class PolicyRecord:
    """One evaluation file and what it holds."""

    path: Path
    result: PolicyResult
    kind: PolicyKind

    @property
    def seed(self) -> int:
        """The training seed."""
        return int(self.result.training.get("seed", 0))


@dataclass(frozen=True)
class PolicyCell:
    """Evaluations of one configuration: one for each training seed.

    Attributes:
        records: the evaluations, by seed.
        note: what sets the cell apart from others of its kind; "" if nothing needs to.
    """

    records: tuple[PolicyRecord, ...]
    note: str

    @property
    def kind(self) -> PolicyKind:
        """What all of its policies are."""
        return self.records[0].kind

    @property
    def variant(self) -> str:
        """What sets the cell apart from others of its algorithm and observations."""
        return self.kind.variant + (f" ({self.note})" if self.note else "")

    @property
    def best(self) -> np.ndarray:
        """(seeds,) success rates of each training's best checkpoint."""
        return np.array([record.result.best for record in self.records])

    @property
    def last_five(self) -> np.ndarray:
        """(seeds,) mean success rates of each training's last five checkpoints."""
        return np.array([record.result.last_five for record in self.records])

    def curve(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Steps (n,) that every training was evaluated at, success rates (n,), and 95 % intervals (n, 2).

        The rates and the Wilson intervals are those of the episodes of all trainings together.
        """
        by_step = [{one.step: one for one in record.result.checkpoints} for record in self.records]
        steps = sorted(set.intersection(*(set(found) for found in by_step)))
        counts = [_pooled([found[step] for found in by_step]) for step in steps]
        rates = [successes / episodes for successes, episodes in counts]
        return np.array(steps), np.array(rates), np.array([wilson(*count) for count in counts]).reshape(-1, 2)


def _pooled(checkpoints: Iterable[Checkpoint]) -> tuple[int, int]:
    found = list(checkpoints)
    return sum(one.successes for one in found), sum(len(one.runs) for one in found)


def is_evaluation(content: Any) -> bool:
    """Whether parsed JSON is an evaluation of a policy, by its keys."""
    return isinstance(content, dict) and all(key in content for key in ("algorithm", "training", "checkpoints"))


def read_evaluation(path: str | Path) -> PolicyRecord:
    """Read what ``ocplanner evaluate`` wrote.

    Raises:
        ResultFileError: the file is missing or damaged, or holds something else.
    """
    path = Path(path)
    result = PolicyResult.load(path)
    try:
        record = PolicyRecord(path, result, policy_kind(result.training, result.labels))
        _identity(record)
    except (KeyError, TypeError, AttributeError) as error:
        raise ResultFileError(f"{path} is damaged ({error!r}); evaluate the policy again") from error
    return record


def policy_cells(records: Iterable[PolicyRecord]) -> list[PolicyCell]:
    """Group records that differ only in the training seed: states before images, and no hint before hints.

    One evaluation that lies in two files counts once.
    """
    groups: dict[str, list[PolicyRecord]] = {}
    for record in {record.result.checkpoints: record for record in records}.values():
        groups.setdefault(json.dumps(_identity(record), sort_keys=True), []).append(record)
    members = [tuple(sorted(group, key=lambda record: record.seed)) for group in groups.values()]
    cells = [PolicyCell(group, _note(group, members)) for group in members]
    return sorted(cells, key=lambda cell: (cell.kind.observations != "state", cell.kind.algorithm, cell.kind.hint))


def _identity(record: PolicyRecord) -> dict[str, Any]:
    """Everything that decides how good a policy is, flat, but for the seed."""
    result = record.result
    labels, rewards = ({} if made is None else made["settings"] for made in (result.labels, result.rewards))
    training = {key: value for key, value in result.training.items() if key not in _OF_ONE_TRAINING}
    facts = {"task": result.task, "robot": result.robot, "planner": result.planner_sha256, "episodes": result.episodes}
    flat = _flat({**facts, **training, "labels": labels, "rewards": rewards})
    # Critics of another seed stand above another policy.
    return {key: value for key, value in flat.items() if not key.endswith("sampler_sha256")}


def _flat(values: Mapping[str, Any], above: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in values.items():
        if isinstance(value, Mapping):
            flat |= _flat(value, f"{above}{key} ")
        else:
            flat[above + key] = value
    return flat


def _note(group: tuple[PolicyRecord, ...], groups: Iterable[tuple[PolicyRecord, ...]]) -> str:
    alike = [_identity(other[0]) for other in groups if other[0].kind == group[0].kind]
    own = _identity(group[0])
    differing = [key for key in own if any(other.get(key) != own[key] for other in alike)]
    return ", ".join(f"{key} {own[key]}" for key in differing[:3])

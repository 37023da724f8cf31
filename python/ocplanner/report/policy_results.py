"""Evaluations of policies, grouped where they differ only in the training seed."""

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ocplanner.errors import ResultFileError
from ocplanner.files.records.evaluation import PolicyResult
from ocplanner.files.records.labels import LabelRecord
from ocplanner.policies.bcq_config import BCQConfig
from ocplanner.policies.config import HintConfig, PolicyTraining, training_from_dict
from ocplanner.rollouts.intervals import rate_interval
from ocplanner.settings import to_dict

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


def policy_kind(training: PolicyTraining, labels: LabelRecord | None = None) -> PolicyKind:
    """Name a policy by the settings of its training, and by how its hints were made where that is known."""
    hint, own = training.network.hint, training.algorithm_settings
    words = ""
    if hint is not None:
        origin = "" if labels is None else f" from the {labels.settings['hint_from']}"
        words = f"k = {', '.join(map(str, hint.horizons))}{origin}{_use(hint)}"
    sampler = {"gmm": "-GMM", "policy": "-BC"}.get(own.sampler, "") if isinstance(own, BCQConfig) else ""
    observations = "image" if training.observation.cameras else "state"
    return PolicyKind(training.algorithm.upper() + sampler, observations, words)


def _use(hint: HintConfig) -> str:
    """What is made of a hint, where that is not the paper's way."""
    words = [", steers" if hint.steers else "", ", no pictures" if hint.instead_of_pictures else ""]
    if hint.initial_weight != 1.0:
        words.append(f", weight {hint.initial_weight:g}")
    if hint.residual_penalty:
        words.append(f", penalty {hint.residual_penalty:g}")
    return "".join(words)


@dataclass(frozen=True)
class PolicyRecord:
    """One evaluation.

    Attributes:
        result: what its file holds.
        training: the settings of the training.
        kind: what the policies are.
    """

    result: PolicyResult
    training: PolicyTraining
    kind: PolicyKind

    @property
    def seed(self) -> int:
        """The training seed."""
        return self.training.seed


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

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the mean of ``last_five``, over trainings and episodes."""
        return rate_interval([record.result.last_outcomes for record in self.records])

    def curve(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Steps (n,) at which every training was evaluated, mean success rates (n,), and their 95 % intervals (n, 2).

        The interval of a single training is Wilson's, that of several is over trainings and episodes.
        """
        by_step = [{one.step: one for one in record.result.checkpoints} for record in self.records]
        steps = sorted(set.intersection(*(set(found) for found in by_step)))
        points = [[found[step] for found in by_step] for step in steps]
        rates = [float(np.mean([one.rate for one in point])) for point in points]
        intervals = [rate_interval([one.outcomes for one in point]) for point in points]
        return np.array(steps), np.array(rates), np.array(intervals).reshape(-1, 2)


def read_evaluation(path: str | Path) -> PolicyRecord:
    """Read what ``ocplanner evaluate`` wrote.

    Raises:
        ResultFileError: the file is missing or damaged, or holds something else.
    """
    result = PolicyResult.load(path)
    try:
        training = training_from_dict(result.training)
        record = PolicyRecord(result, training, policy_kind(training, result.labels))
        _identity(record)
    except (KeyError, TypeError, ValueError) as error:
        raise ResultFileError(f"{path} is damaged ({error}); evaluate the policy again") from error
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
    """Everything that decides how good a policy is, flat, except the seed."""
    result = record.result
    labels, rewards = ({} if made is None else made.settings for made in (result.labels, result.rewards))
    training = {key: value for key, value in to_dict(record.training).items() if key not in _OF_ONE_TRAINING}
    facts = {"task": result.task, "robot": result.robot, "planner": result.planner_sha256}
    flat = _flat({**facts, "episodes": result.settings.episodes, **training, "labels": labels, "rewards": rewards})
    # Critics of another seed choose among another policy's actions.
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

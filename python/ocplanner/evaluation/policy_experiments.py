"""The experiments behind Table 1: which policies are trained, with and without the plan as a hint, and how they do."""

from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from ocplanner.evaluation import reproduction
from ocplanner.evaluation.experiments import PlannerExperiment


class HintKind(NamedTuple):
    """How hints are made: how many planned steps ahead, and from where."""

    horizon_step: int
    hint_from: str


HINTS = {"": None, "k1": HintKind(1, "object"), "k5": HintKind(5, "plan")}
"""By the name in file names: none; the paper's; the five steps that agree best with recorded actions."""

PLANNER = PlannerExperiment()
"""Makes the hints: the one that transfers use."""

_CAMERAS = ("agentview", "robot0_eye_in_hand")


@dataclass(frozen=True)
class PolicyExperiment:
    """One policy to train on ``mask/train`` of Square PH with the ``cpu`` preset, and to evaluate."""

    algorithm: str
    observations: str
    hint: str = ""
    seed: int = 0

    @property
    def name(self) -> str:
        """The run folder's name and the result file's stem."""
        return "_".join((self.algorithm, self.observations, self.hint or "original", str(self.seed)))

    @property
    def kind(self) -> HintKind | None:
        """How its hints are made, or None."""
        return HINTS[self.hint]

    def result(self, results: Path) -> Path:
        """Where its evaluation is kept."""
        return results / "policies" / f"{self.name}.json"


def table1_experiments(seeds: Sequence[int]) -> tuple[PolicyExperiment, ...]:
    """Every cell of Table 1 for every seed, and the hint of a larger horizon beside the paper's."""
    cells = [(algorithm, "state", "") for algorithm in ("bc", "bc-rnn")]
    cells += [(algorithm, "image", hint) for algorithm in ("bc", "bc-rnn") for hint in ("", "k5", "k1")]
    return tuple(PolicyExperiment(*cell, seed) for seed in seeds for cell in cells)


def data(experiment: PolicyExperiment, source: Path, work: Path) -> Path:
    """The data set that a policy is trained on."""
    if experiment.observations == "state" and experiment.kind is None:
        return source
    return work / f"square_policy{'_' + experiment.hint if experiment.hint else ''}.hdf5"


def make_data(
    experiments: Iterable[PolicyExperiment], source: Path, work: Path, results: Path, workers: int
) -> Iterator[str]:
    """Render what the policies and the planner see, and label it; yields what was made."""
    wanted = tuple(experiments)
    base = data(PolicyExperiment("bc", "image"), source, work)
    if all(data(experiment, source, work) == source for experiment in wanted):
        return
    if not base.exists():
        flags = ["--observe", "full", "--cameras", *_CAMERAS, "--workers", str(workers)]
        reproduction.run_command(["render", str(source), str(base), *flags], work / "logs" / "render_policy.log")
        yield base.name
    pictures = work / "square_policy_masked.hdf5"
    if any(experiment.kind for experiment in wanted) and not pictures.exists():
        flags = ["--observe", "masked", "--silhouettes", "--workers", str(workers)]
        reproduction.run_command(["render", str(source), str(pictures), *flags], work / "logs" / "render_masked.log")
        yield pictures.name
    for hint, kind in HINTS.items():
        labelled = data(PolicyExperiment("bc", "image", hint), source, work)
        if kind is None or labelled.exists() or all(experiment.hint != hint for experiment in wanted):
            continue
        flags = ["--planner", str(PLANNER.file(results)), "--pictures", str(pictures)]
        flags += ["--horizon-step", str(kind.horizon_step), "--hint-from", kind.hint_from]
        reproduction.run_command(["label", str(base), str(labelled), *flags], work / "logs" / f"label_{hint}.log")
        yield labelled.name


def train_and_evaluate(
    experiment: PolicyExperiment, source: Path, work: Path, results: Path, episodes: int
) -> PolicyExperiment:
    """Train a policy and evaluate its checkpoints, unless its result is there; images: the last five checkpoints."""
    out = experiment.result(results)
    if out.exists():
        return experiment
    run, log = work / experiment.name, work / "logs" / f"{experiment.name}.log"
    if not (run / "policy.safetensors").exists():
        flags = ["--algorithm", experiment.algorithm, "--observations", experiment.observations]
        flags += ["--seed", str(experiment.seed)]
        if experiment.kind is not None:
            flags += ["--hint", "--hint-horizons", str(experiment.kind.horizon_step)]
        where = ["--data", str(data(experiment, source, work)), "--run", str(run)]
        reproduction.run_command(["train-policy", *where, *flags], log)
    flags = ["--episodes", str(episodes), "--out", str(out)]
    if experiment.observations == "image":
        flags += ["--last", "5"]
    if experiment.kind is not None:
        flags += ["--planner", str(PLANNER.file(results))]
    reproduction.run_command(["evaluate", "--policy", str(run), *flags], log)
    return experiment


def run_all(
    experiments: Iterable[PolicyExperiment], source: Path, work: Path, results: Path, episodes: int, workers: int
) -> Iterator[PolicyExperiment]:
    """Train and evaluate policies side by side, one thread each; yields each when it and those before it are done."""
    with ThreadPoolExecutor(workers) as pool:
        yield from pool.map(lambda one: train_and_evaluate(one, source, work, results, episodes), experiments)

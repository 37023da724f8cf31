"""The experiments behind Tables 1 and 2: which policies are trained, on what data, and how they do."""

from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from ocplanner.errors import OutputError
from ocplanner.files.records.evaluation import PolicyResult
from ocplanner.policies.config import HINT_KEY, POLICY_FILE, PROPRIOCEPTION
from ocplanner.reproduction import reproduction
from ocplanner.reproduction.experiments import PlannerExperiment

_USES = {
    "shifts": [],
    "replaces pictures": ["--hint-instead-of-pictures"],
    "steers": ["--hint-steers", "--hint-weight", "0.5"],
}
_NAMES = {"shifts": "", "replaces pictures": ", in place of pictures", "steers": ", steers by itself"}


class HintKind(NamedTuple):
    """How hints are made and used.

    Attributes:
        horizon_step: so many planned steps ahead.
        hint_from: where hints start, see ``ocplanner label``.
        use: what is made of it while the object is held: a key of ``_USES``.
    """

    horizon_step: int
    hint_from: str
    use: str = "shifts"

    @property
    def labels(self) -> str:
        """Names the labelled data set, which kinds that differ only in ``use`` share."""
        return f"k{self.horizon_step}-{self.hint_from}"

    @property
    def label_flags(self) -> list[str]:
        """Of ``ocplanner label``."""
        return ["--horizon-step", str(self.horizon_step), "--hint-from", self.hint_from]

    @property
    def training_flags(self) -> list[str]:
        """Of ``ocplanner train-policy``."""
        flags = ["--hint", *_USES[self.use]]
        return flags if self.use == "shifts" else [*flags, "--low-dim", *PROPRIOCEPTION, HINT_KEY]

    def __str__(self) -> str:
        """For tables."""
        return f"k = {self.horizon_step}, from the {self.hint_from}{_NAMES[self.use]}"


_WEIGHTS = {"exp": ["--a", "2500", "--b", "25", "--scale", "1"]}


class RewardKind(NamedTuple):
    """Which reward is learned from: how the plan's joins the recorded one, and its form.

    Attributes:
        mode: ``augment`` or ``only``, see ``ocplanner label``.
        form: with the paper's weights (``exp`` has its own, by which 2 cm count as much as 0.2 rad).
    """

    mode: str
    form: str

    @property
    def labels(self) -> str:
        """Names the labelled data set."""
        return f"{self.mode}-{self.form}"

    @property
    def label_flags(self) -> list[str]:
        """Of ``ocplanner label``."""
        return ["--no-hints", "--reward", self.mode, "--form", self.form, *_WEIGHTS.get(self.form, [])]

    @property
    def training_flags(self) -> list[str]:
        """Of ``ocplanner train-policy``: the file has the rewards."""
        return []

    def __str__(self) -> str:
        """For tables."""
        mode = "sparse and the plan's" if self.mode == "augment" else "the plan's alone"
        return mode if self.form == "penalty" else f"{mode}, {self.form}"


VARIANTS: dict[str, HintKind | RewardKind] = {
    "k1": HintKind(1, "object"),
    "k10": HintKind(10, "object", use="replaces pictures"),
    "k10s": HintKind(10, "object", use="steers"),
    "augment": RewardKind("augment", "penalty"),
    "only": RewardKind("only", "penalty"),
    "only-literal": RewardKind("only", "literal"),
    "augment-exp": RewardKind("augment", "exp"),
    "only-exp": RewardKind("only", "exp"),
}
"""By the name in file names. k1 is the paper's hint."""

PLANNER = PlannerExperiment()
"""Makes the hints and rewards: the one that transfers use."""

_CAMERAS = ("agentview", "robot0_eye_in_hand")
_ALGORITHM_FLAGS = {
    "bcq-gmm": ["--algorithm", "bcq", "--sampler", "gmm", "--steps", "20000"],
    "bcq-bc": ["--algorithm", "bcq"],
}
"""Of those that are no algorithm's name; a mixture has learned the recorded actions after as many steps as BC."""


@dataclass(frozen=True)
class PolicyExperiment:
    """One policy to train on ``mask/train`` of Square PH with the ``cpu`` preset, and to evaluate.

    Attributes:
        algorithm: ``bc``, ``bc-rnn``, ``bcq``, ``bcq-gmm``: BCQ with a mixture in the VAE's place, or ``bcq-bc``: BCQ's
            critics above the policy that ``bc`` trains with the same seed.
        observations: ``state`` or ``image``.
        variant: one of :data:`VARIANTS`, or "" for the recorded data alone.
        seed: of the training.
    """

    algorithm: str
    observations: str
    variant: str = ""
    seed: int = 0

    @property
    def name(self) -> str:
        """The run folder's name and the result file's stem."""
        return "_".join((self.algorithm, self.observations, self.variant or "original", str(self.seed)))

    @property
    def training_flags(self) -> list[str]:
        """Of ``ocplanner train-policy``."""
        algorithm = _ALGORITHM_FLAGS.get(self.algorithm, ["--algorithm", self.algorithm])
        seen = ["--observations", self.observations] if self.sampler is None else []
        added = [] if self.kind is None else self.kind.training_flags
        return [*algorithm, *seen, "--seed", str(self.seed), *added]

    @property
    def evaluation_flags(self) -> list[str]:
        """Of ``ocplanner evaluate``: how many of the last checkpoints, where not all."""
        if self.sampler is not None:
            return ["--last", "2"]
        return ["--last", "5"] if self.observations == "image" else []

    @property
    def sampler(self) -> "PolicyExperiment | None":
        """The policy that proposes actions to critics, where one is trained beforehand."""
        return PolicyExperiment("bc", self.observations, seed=self.seed) if self.algorithm == "bcq-bc" else None

    @property
    def kind(self) -> HintKind | RewardKind | None:
        """What the planner adds to the data."""
        return VARIANTS[self.variant] if self.variant else None

    def result(self, results: Path) -> Path:
        """Where its evaluation is kept."""
        return results / "policies" / f"{self.name}.json"


def table1_experiments(seeds: Sequence[int]) -> tuple[PolicyExperiment, ...]:
    """Every cell of Table 1 for every seed, and hints of larger horizons beside the paper's."""
    cells = [(algorithm, "state", "") for algorithm in ("bc", "bc-rnn")]
    cells += [(algorithm, "image", hint) for algorithm in ("bc", "bc-rnn") for hint in ("", "k10s", "k1")]
    cells += [("bc", "image", "k10")]
    return tuple(PolicyExperiment(*cell, seed) for seed in seeds for cell in cells)


def table2_experiments(seeds: Sequence[int]) -> tuple[PolicyExperiment, ...]:
    """Every cell of Table 2 for every seed; critics above BC with the bounded reward, and from states both signs."""
    rewards = {
        ("bcq", "state"): ("",),
        ("bcq", "image"): ("", "only", "augment"),
        ("bcq-gmm", "state"): ("", "only-exp"),
        ("bcq-bc", "state"): ("", "only-exp", "only", "only-literal"),
        ("bcq-bc", "image"): ("", "only-exp", "augment-exp"),
    }
    cells = [(*policy, reward) for policy, learned_from in rewards.items() for reward in learned_from]
    return tuple(PolicyExperiment(*cell, seed) for seed in seeds for cell in cells)


def data(experiment: PolicyExperiment, source: Path, work: Path) -> Path:
    """The data set that a policy is trained on."""
    kind = "policy" if experiment.observations == "image" else "state"
    if experiment.kind is not None:
        return work / f"square_{kind}_{experiment.kind.labels}.hdf5"
    return source if kind == "state" else work / "square_policy.hdf5"


def make_data(
    experiments: Iterable[PolicyExperiment], source: Path, work: Path, results: Path, workers: int
) -> Iterator[str]:
    """Render what the policies and the planner see, and label it; yields what was made."""
    wanted = tuple(experiments)
    base, pictures = data(PolicyExperiment("bc", "image"), source, work), work / "square_policy_masked.hdf5"
    if any(one.observations == "image" for one in wanted) and not base.exists():
        flags = ["--observe", "full", "--cameras", *_CAMERAS, "--workers", str(workers)]
        reproduction.run_command(["render", str(source), str(base), *flags], work / "logs" / "render_policy.log")
        yield base.name
    if any(one.variant for one in wanted) and not pictures.exists():
        flags = ["--observe", "masked", "--silhouettes", "--workers", str(workers)]
        reproduction.run_command(["render", str(source), str(pictures), *flags], work / "logs" / "render_masked.log")
        yield pictures.name
    for experiment in wanted:
        labelled = data(experiment, source, work)
        if experiment.kind is None or labelled.exists():
            continue
        unlabelled = base if experiment.observations == "image" else source
        flags = ["--planner", str(PLANNER.file(results)), "--pictures", str(pictures), *experiment.kind.label_flags]
        log = work / "logs" / f"label_{labelled.stem}.log"
        reproduction.run_command(["label", str(unlabelled), str(labelled), *flags], log)
        yield labelled.name


def missing_results(
    experiments: Iterable[PolicyExperiment], results: Path, episodes: int
) -> tuple[PolicyExperiment, ...]:
    """The experiments that have no result yet.

    Raises:
        ResultFileError: a result is damaged.
        OutputError: a result has another number of episodes a checkpoint.
    """
    missing = []
    for experiment in experiments:
        out = experiment.result(results)
        if not out.exists():
            missing.append(experiment)
        elif (found := PolicyResult.load(out).settings.episodes) != episodes:
            raise OutputError(
                f"{out} holds {found} episodes a checkpoint, not {episodes}; give the --episodes that made it, choose "
                "other --results, or delete it"
            )
    return tuple(missing)


def train(experiment: PolicyExperiment, source: Path, work: Path) -> Path:
    """Train a policy, unless it is there; its run folder. The one that proposes to critics must be there already."""
    run = work / experiment.name
    if not (run / POLICY_FILE).exists():
        flags = ["--data", str(data(experiment, source, work)), "--run", str(run), *experiment.training_flags]
        if experiment.sampler is not None:
            flags += ["--sampler-from", str(work / experiment.sampler.name)]
        reproduction.run_command(["train-policy", *flags], _log(experiment, work))
    return run


def train_and_evaluate(
    experiment: PolicyExperiment, source: Path, work: Path, results: Path, episodes: int
) -> PolicyExperiment:
    """Train a policy and evaluate its checkpoints, unless its result is there."""
    out = experiment.result(results)
    if out.exists():
        return experiment
    run = train(experiment, source, work)
    flags = ["--episodes", str(episodes), "--out", str(out), *experiment.evaluation_flags]
    if isinstance(experiment.kind, HintKind):
        flags += ["--planner", str(PLANNER.file(results))]
    reproduction.run_command(["evaluate", "--policy", str(run), *flags], _log(experiment, work))
    return experiment


def run_all(
    experiments: Iterable[PolicyExperiment], source: Path, work: Path, results: Path, episodes: int, workers: int
) -> Iterator[PolicyExperiment]:
    """Train and evaluate policies side by side, one thread each; yields each when it and those before it are done."""
    wanted = tuple(experiments)
    missing = [one.sampler for one in wanted if not one.result(results).exists()]
    samplers = dict.fromkeys(below for below in missing if below is not None)
    with ThreadPoolExecutor(workers) as pool:
        for _ in pool.map(lambda one: train(one, source, work), samplers):
            pass
        yield from pool.map(lambda one: train_and_evaluate(one, source, work, results, episodes), wanted)


def _log(experiment: PolicyExperiment, work: Path) -> Path:
    return work / "logs" / f"{experiment.name}.log"

"""The experiments behind ``results/``: which planners are trained and which arms they are tried on.

Each step is an ``ocplanner`` command of its own, so that every number can also be remade by hand; what is there
already is not done again.
"""

import json
import shutil
import subprocess
import sys
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path

from ocplanner.errors import OutputError
from ocplanner.storage import atomic_json, atomic_write
from ocplanner.versions import installed


@dataclass(frozen=True)
class PlannerExperiment:
    """One planner to train on ``mask/train`` of Square PH."""

    observe: str = "masked"
    horizon: int = 20
    outputs: str = "pose"
    seed: int = 0

    @property
    def name(self) -> str:
        """The run folder's name and the planner file's stem."""
        return f"square_{self.observe}_h{self.horizon}_{self.outputs}_{self.seed}"


@dataclass(frozen=True)
class TransferExperiment:
    """One planner on one arm, 100 episodes."""

    robot: str
    follow: str = "gated"
    observe: str = "masked"
    seed: int = 0
    mask_error: int = 0

    @property
    def name(self) -> str:
        """The result file's path below the results, without its ending."""
        stem = f"square_{self.robot.lower()}_{self.follow}_{self.observe}_{self.seed}"
        return f"mask_error/{stem}_{self.mask_error}px" if self.mask_error else f"transfer/{stem}"

    @property
    def planner(self) -> PlannerExperiment:
        """The planner it runs."""
        return PlannerExperiment(observe=self.observe, seed=self.seed)


OBSERVES = ("masked", "no-robot", "full")
ROBOTS = ("Sawyer", "UR5e", "Panda")


def planner_experiments(seeds: Sequence[int]) -> tuple[PlannerExperiment, ...]:
    """Every seed of the H = 20 pose planner for each kind of observation, and one of every other horizon and output.

    In the order of what matters: the default first, the upper bound and the plain images beside it, then the rest.
    """
    first, *rest = seeds
    experiments = [PlannerExperiment(seed=seed) for seed in seeds]
    experiments += [PlannerExperiment(observe=observe, seed=first) for observe in OBSERVES[1:]]
    experiments += [
        PlannerExperiment(horizon=horizon, outputs=outputs, seed=first)
        for horizon in (5, 20, 50)
        for outputs in ("pose", "position")
        if (horizon, outputs) != (20, "pose")
    ]
    experiments += [PlannerExperiment(observe=observe, seed=seed) for seed in rest for observe in OBSERVES[1:]]
    return tuple(experiments)


def transfer_experiments(seeds: Sequence[int]) -> tuple[TransferExperiment, ...]:
    """Every planner on every arm; the paper's ways of following and imperfect masks on Sawyer.

    In the order of what matters, like the planners.
    """
    first, *rest = seeds
    experiments = [TransferExperiment(robot, seed=seed) for seed in seeds for robot in ROBOTS]
    experiments += [TransferExperiment("Sawyer", follow=follow, seed=first) for follow in ("open-loop", "time")]
    experiments += [
        TransferExperiment(robot, observe=observe, seed=first) for observe in OBSERVES[1:] for robot in ROBOTS
    ]
    experiments += [TransferExperiment("Sawyer", seed=first, mask_error=pixels) for pixels in (1, 2, 3)]
    experiments += [
        TransferExperiment("Sawyer", follow=follow, seed=seed) for seed in rest for follow in ("open-loop", "time")
    ]
    experiments += [
        TransferExperiment(robot, observe=observe, seed=seed)
        for seed in rest
        for observe in OBSERVES[1:]
        for robot in ROBOTS
    ]
    return tuple(experiments)


def _run(arguments: list[str], log: Path) -> None:
    """Run one ``ocplanner`` command, its output in a log.

    Raises:
        OutputError: the command failed.
    """
    log.parent.mkdir(parents=True, exist_ok=True)
    with log.open("ab") as stream:
        done = subprocess.run(
            [sys.executable, "-m", "ocplanner", *arguments], stdout=stream, stderr=subprocess.STDOUT, check=False
        )
    if done.returncode:
        raise OutputError(f"'ocplanner {' '.join(arguments)}' failed with status {done.returncode}; see {log}")


def _images(work: Path, observe: str) -> Path:
    return work / f"square_{observe}.hdf5"


def render_images(data: Path, work: Path, workers: int) -> Iterator[str]:
    """Render the data set once for each kind of observation; yields what was made."""
    for observe in OBSERVES:
        target = _images(work, observe)
        if not target.exists():
            flags = ["--observe", observe, "--frames", "manipulation", "--workers", str(workers)]
            _run(["render", str(data), str(target), *flags], work / "logs" / f"render_{observe}.log")
            yield target.name


def train(experiment: PlannerExperiment, work: Path, results: Path) -> str:
    """Train one planner; copies the three-seed planners into the results."""
    run = work / experiment.name
    planner = run / "planner.safetensors"
    if not planner.exists():
        flags = ["--horizon", str(experiment.horizon), "--outputs", experiment.outputs, "--observe", experiment.observe]
        images = _images(work, experiment.observe)
        arguments = ["train-planner", "--data", str(images), "--run", str(run), *flags, "--seed", str(experiment.seed)]
        _run(arguments, work / "logs" / f"{experiment.name}.log")
    if (experiment.horizon, experiment.outputs) == (20, "pose"):
        results.joinpath("planners").mkdir(parents=True, exist_ok=True)
        with atomic_write(results / "planners" / f"{experiment.name}.safetensors") as temporary:
            shutil.copyfile(planner, temporary)
    return experiment.name


def transfer(experiment: TransferExperiment, work: Path, results: Path, episodes: int, workers: int) -> str:
    """Run one planner on one arm, unless its result file is there."""
    out = results / f"{experiment.name}.json"
    if not out.exists():
        planner = results / "planners" / f"{experiment.planner.name}.safetensors"
        flags = ["--robot", experiment.robot, "--follow", experiment.follow, "--observe", experiment.observe]
        flags += ["--episodes", str(episodes), "--seed-start", "10000", "--workers", str(workers)]
        if experiment.mask_error:
            flags += ["--mask-error", str(experiment.mask_error)]
        _run(
            ["transfer", "--planner", str(planner), *flags, "--out", str(out)], work / "logs" / f"{experiment.name}.log"
        )
    return experiment.name


def train_all(experiments: Iterable[PlannerExperiment], work: Path, results: Path, workers: int) -> Iterator[str]:
    """Train several planners side by side, one thread each; yields each name as it is done."""
    with ThreadPoolExecutor(workers) as pool:
        yield from pool.map(lambda experiment: train(experiment, work, results), experiments)


def held_out(experiments: Iterable[PlannerExperiment], work: Path, results: Path, command: str) -> Path:
    """Collect into ``heldout.json`` what each training measured on ``mask/valid``.

    One row for each planner, candidate (before and after fine-tuning) and arm shown; planners not yet trained are left
    out.
    """
    rows = []
    for experiment in experiments:
        if not (work / experiment.name / "planner.safetensors").exists():
            continue
        lines = (work / experiment.name / "metrics.jsonl").read_text().splitlines()
        final = [row for row in map(json.loads, lines) if row.get("stage") == "final"]
        rows += [{"planner": experiment.name, **asdict(experiment), **row} for row in final]
    out = results / "heldout.json"
    atomic_json(out, {"command": command, "data": "Square PH, mask/valid", "versions": installed(), "rows": rows})
    return out

"""Running the experiments: each step is an ``ocplanner`` command of its own, so that every number can also be remade by
hand; what is there already is not done again.
"""

import shutil
import subprocess
import sys
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from ocplanner.errors import OutputError
from ocplanner.files.storage import atomic_write
from ocplanner.planner.planner import FILE_NAME
from ocplanner.reproduction.experiments import PlannerExperiment, TransferExperiment


def run_command(arguments: list[str], log: Path) -> None:
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


def images(work: Path, observe: str) -> Path:
    """The rendered data set of one kind of observation."""
    return work / f"square_{observe}.hdf5"


def render_images(experiments: Iterable[PlannerExperiment], data: Path, work: Path, workers: int) -> Iterator[str]:
    """Render the data set once for each kind of observation that the planners see; yields what was made."""
    for observe in dict.fromkeys(experiment.observe for experiment in experiments):
        target = images(work, observe)
        if not target.exists():
            flags = ["--observe", observe, "--frames", "manipulation", "--workers", str(workers)]
            run_command(["render", str(data), str(target), *flags], work / "logs" / f"render_{observe}.log")
            yield target.name


def train(experiment: PlannerExperiment, work: Path) -> PlannerExperiment:
    """Train one planner, unless its run is finished."""
    run = work / experiment.name
    if not (run / FILE_NAME).exists():
        flags = ["--horizon", str(experiment.horizon), "--outputs", experiment.outputs, "--observe", experiment.observe]
        if experiment.channels:
            flags += ["--channels", *map(str, experiment.channels)]
        data = str(images(work, experiment.observe))
        arguments = ["train-planner", "--data", data, "--run", str(run), *flags, "--seed", str(experiment.seed)]
        run_command(arguments, work / "logs" / f"{experiment.name}.log")
    return experiment


def publish(experiment: PlannerExperiment, work: Path, results: Path) -> None:
    """Copy a trained planner into the results, if it is one that transfers run."""
    if experiment.transferred:
        with atomic_write(experiment.file(results)) as temporary:
            shutil.copyfile(work / experiment.name / FILE_NAME, temporary)


def transfer(experiment: TransferExperiment, work: Path, results: Path, episodes: int, workers: int) -> str:
    """Run one planner on one arm, unless its result file is there."""
    out = results / f"{experiment.name}.json"
    if not out.exists():
        planner = experiment.planner.file(results)
        flags = ["--robot", experiment.robot, "--follow", experiment.follow, "--observe", experiment.observe]
        flags += ["--episodes", str(episodes), "--seed-start", "10000", "--workers", str(workers)]
        if experiment.mask_error:
            flags += ["--mask-error", str(experiment.mask_error)]
        if experiment.pose_noise is not None:
            flags += ["--pose-noise", "{},{}".format(*experiment.pose_noise)]
            flags += ["--pose-filter", str(experiment.pose_filter)]
        run_command(
            ["transfer", "--planner", str(planner), *flags, "--out", str(out)], work / "logs" / f"{experiment.name}.log"
        )
    return experiment.name


def transfer_matrix(seed: int, work: Path, results: Path, episodes: int, workers: int) -> Path:
    """Run every task on every arm with the planners of a training seed, as far as it has not been done."""
    out = results / "matrix.json"
    flags = ["--planners", str(results / "planners"), "--planner-seed", str(seed), "--workers", str(workers)]
    flags += ["--episodes", str(episodes), "--seed-start", "10000", "--out", str(out)]
    run_command(["transfer", "--matrix", *flags], work / "logs" / "matrix.log")
    return out


def train_all(experiments: Iterable[PlannerExperiment], work: Path, workers: int) -> Iterator[PlannerExperiment]:
    """Train several planners side by side, one thread each; yields each one when it and those before it are done."""
    with ThreadPoolExecutor(workers) as pool:
        yield from pool.map(lambda experiment: train(experiment, work), experiments)

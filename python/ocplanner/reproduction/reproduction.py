"""Running the experiments: each step is an ``ocplanner`` command, so that every number can also be remade by hand.

A step whose file is there is not run again.
"""

import hashlib
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
from ocplanner.rollouts.settings import FIRST_EVALUATION_SEED
from ocplanner.zero_shot.result import read_result


def run_command(arguments: list[str], log: Path) -> None:
    """Run one ``ocplanner`` command and append its output to a log.

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
    """The rendered data set of one observation."""
    return work / f"square_{observe}.hdf5"


def render_images(experiments: Iterable[PlannerExperiment], data: Path, work: Path, workers: int) -> Iterator[str]:
    """Render the data set once for each observation of the planners; yields the names of new files."""
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
    """Copy a trained planner into the results, if transfers use it."""
    if experiment.transferred:
        with atomic_write(experiment.file(results)) as temporary:
            shutil.copyfile(work / experiment.name / FILE_NAME, temporary)


def transfer(experiment: TransferExperiment, work: Path, results: Path, episodes: int, workers: int) -> str:
    """Run one planner on one arm, unless its result file is there.

    Raises:
        ResultFileError: the result file is damaged.
        OutputError: it holds other episodes or those of another planner, or the transfer failed.
    """
    out, planner = results / f"{experiment.name}.json", experiment.planner.file(results)
    if out.exists():
        _check_kept(out, planner, episodes)
        return experiment.name
    flags = ["--robot", experiment.robot, "--follow", experiment.follow]
    flags += ["--episodes", str(episodes), "--seed-start", str(FIRST_EVALUATION_SEED), "--workers", str(workers)]
    if experiment.mask_error:
        flags += ["--mask-error", str(experiment.mask_error)]
    if experiment.pose_noise is not None:
        flags += ["--pose-noise", *map(str, experiment.pose_noise), "--pose-filter", str(experiment.pose_filter)]
    log = work / "logs" / f"{experiment.name}.log"
    run_command(["transfer", "--planner", str(planner), *flags, "--out", str(out)], log)
    return experiment.name


def _check_kept(out: Path, planner: Path, episodes: int) -> None:
    found = read_result(out)
    if [run.seed for run in found.runs] != list(range(FIRST_EVALUATION_SEED, FIRST_EVALUATION_SEED + episodes)):
        raise OutputError(
            f"{out} holds {found.episodes} episodes from seed {found.runs[0].seed} on, not {episodes} from "
            f"{FIRST_EVALUATION_SEED} on; give the --episodes that made it, choose other --results, or delete it"
        )
    if planner.exists() and hashlib.sha256(planner.read_bytes()).hexdigest() != found.planner_sha256:
        raise OutputError(
            f"{out} is of another planner than {planner}; delete it to run this one, or choose other --results"
        )


def transfer_matrix(seed: int, work: Path, results: Path, episodes: int, workers: int) -> Path:
    """Run the missing cells of every task on every arm, with the planners of one training seed."""
    out = results / "matrix.json"
    flags = ["--planners", str(results / "planners"), "--planner-seed", str(seed), "--workers", str(workers)]
    flags += ["--episodes", str(episodes), "--seed-start", str(FIRST_EVALUATION_SEED), "--out", str(out)]
    run_command(["matrix", *flags], work / "logs" / "matrix.log")
    return out


def train_all(experiments: Iterable[PlannerExperiment], work: Path, workers: int) -> Iterator[PlannerExperiment]:
    """Train several planners side by side, one thread each; yields each when it and those before it are done."""
    with ThreadPoolExecutor(workers) as pool:
        yield from pool.map(lambda experiment: train(experiment, work), experiments)

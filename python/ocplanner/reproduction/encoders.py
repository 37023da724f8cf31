"""The search for the smallest image encoder: which encoders are trained, and what is measured."""

import time
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from ocplanner.files.storage import atomic_json
from ocplanner.planner.config import EncoderType, Pool
from ocplanner.planner.planner import FILE_NAME, Planner
from ocplanner.reproduction import held_out, reproduction
from ocplanner.versions import installed

NAME = "encoders.json"
_PLANS_TIMED = 300


@dataclass(frozen=True)
class EncoderExperiment:
    """A planner of poses (H = 20, masked images) with one encoder; batches are the same for each encoder."""

    encoder: EncoderType = "small"
    channels: tuple[int, ...] = (8, 16, 32, 64)
    pool: Pool = "flatten"
    predictor_steps: int = 1500
    finetune_steps: int = 500
    seed: int = 0

    @property
    def name(self) -> str:
        """The run folder's name."""
        size = "resnet18" if self.encoder == "resnet18" else "-".join(map(str, self.channels))
        return f"{size}_{self.pool}_{self.predictor_steps + self.finetune_steps}_{self.seed}"

    @property
    def flags(self) -> list[str]:
        """The flags of ``ocplanner train-planner``."""
        flags = ["--encoder", self.encoder, "--pool", self.pool, "--seed", str(self.seed)]
        if self.encoder == "small":
            flags += ["--channels", *map(str, self.channels)]
        return [
            *flags,
            *("--predictor-steps", str(self.predictor_steps)),
            *("--finetune-steps", str(self.finetune_steps)),
        ]


def encoder_experiments(seeds: Iterable[int]) -> tuple[EncoderExperiment, ...]:
    """robomimic's ResNet18, then small trunks from narrow to wide, one of them with robomimic's keypoints.

    A ResNet18 takes an hour on one core, so all are trained for 2,000 steps (predictor and fine-tuning) instead of the
    default 5,000, and the ResNet18 with the first seed only. The three narrowest are also trained for all 5,000.
    """
    first, *rest = seeds
    trunks = [(8, 16, 32, 64), (12, 24, 48, 96), (16, 32, 64, 128), (24, 48, 96, 192)]
    experiments = [EncoderExperiment("resnet18", pool="spatial_softmax", seed=first)]
    experiments += [EncoderExperiment(channels=channels, seed=first) for channels in trunks]
    experiments.append(EncoderExperiment(channels=(16, 32, 64, 128), pool="spatial_softmax", seed=first))
    experiments += [
        EncoderExperiment(channels=channels, predictor_steps=3500, finetune_steps=1500, seed=first)
        for channels in trunks[:3]
    ]
    experiments += [EncoderExperiment(channels=channels, seed=seed) for seed in rest for channels in trunks]
    return tuple(experiments)


def train_encoders(experiments: Iterable[EncoderExperiment], work: Path, workers: int) -> Iterator[EncoderExperiment]:
    """Train the encoders whose runs are not finished, side by side with one thread each; yields each when done."""

    def train(experiment: EncoderExperiment) -> EncoderExperiment:
        run = work / "encoders" / experiment.name
        if not (run / FILE_NAME).exists():
            arguments = [
                "train-planner",
                "--data",
                str(reproduction.images(work, "masked")),
                "--run",
                str(run),
                *experiment.flags,
            ]
            reproduction.run_command(arguments, work / "logs" / f"encoder_{experiment.name}.log")
        return experiment

    with ThreadPoolExecutor(workers) as pool:
        yield from pool.map(train, experiments)


def write(experiments: Iterable[EncoderExperiment], work: Path, results: Path, command: str) -> Path:
    """Measure the planners whose runs are finished and write ``encoders.json``.

    Each row has the errors on ``mask/valid`` as recorded, the kept stage, the size of the planner file in bytes, and
    the median time in milliseconds of a plan from one image on one thread; all planners take turns.

    Raises:
        ModelFileError: a planner is damaged.
        OutputError: the file cannot be written.
    """
    done = [item for item in experiments if (work / "encoders" / item.name / FILE_NAME).exists()]
    planners = [Planner.load(work / "encoders" / item.name / FILE_NAME) for item in done]
    rows = []
    for experiment, milliseconds in zip(done, _time(planners), strict=True):
        run = work / "encoders" / experiment.name
        errors = next(row for row in held_out.final_errors(run) if row.kept and row.appearance == "source").to_json()
        size = (run / FILE_NAME).stat().st_size
        rows.append({"name": experiment.name, **asdict(experiment), "bytes": size, "plan_ms": milliseconds, **errors})
    content = {"command": command, "data": "Square PH, mask/valid", "versions": installed(), "rows": rows}
    atomic_json(results / NAME, content)
    return results / NAME


def _time(planners: list[Planner]) -> list[float]:
    rng = np.random.default_rng(0)
    seconds: list[list[float]] = [[] for _ in planners]
    for _ in range(_PLANS_TIMED):
        for planner, times in zip(planners, seconds):
            size = planner.header.image_size
            pictures = {name: rng.integers(0, 256, (1, size, size, 3), np.uint8) for name in planner.header.cameras}
            start = time.perf_counter()
            planner.plan(pictures)
            times.append(time.perf_counter() - start)
    return [round(1000 * float(np.median(times)), 4) for times in seconds]

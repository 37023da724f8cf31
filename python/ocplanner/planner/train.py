"""Training a planner: one call runs all stages, and a stopped run resumes and ends with the same weights."""

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import numpy as np
import torch

from ocplanner.demos.dataset import Demonstrations
from ocplanner.demos.picture_check import measured_visual
from ocplanner.demos.settings import DEFAULT_READING, ReadSettings
from ocplanner.envs import CONTROL_HZ
from ocplanner.errors import InvalidValueError, RenderingError, TrainingError
from ocplanner.files.records.metrics import HeldOutErrors, RunConfig, StepMetrics
from ocplanner.files.storage import locked
from ocplanner.planner.augment import observed
from ocplanner.planner.config import PlannerTraining
from ocplanner.planner.export import Provenance, export_planner
from ocplanner.planner.frames import DataSettings, Frames, data_settings, load_frames, split
from ocplanner.planner.metrics import PlanErrors
from ocplanner.planner.network import Normaliser, PlannerNetwork
from ocplanner.planner.planner import FILE_NAME
from ocplanner.planner.stages import STAGES, Material, Stage
from ocplanner.progress import TrainingProgress
from ocplanner.settings import to_dict
from ocplanner.training.memory import enough_memory, keep_freed_memory
from ocplanner.training.optimisation import BatchOrder, Optimisation
from ocplanner.training.run_folder import RunFolder, check_run_folder
from ocplanner.training.schedule import learning_rate

ORDER = tuple(stage.name for stage in STAGES)


def train_planner(config: PlannerTraining, data: Path, run: Path, reading: ReadSettings = DEFAULT_READING) -> Path:
    """Train on a rendered data set and write ``run/planner.safetensors``.

    Args:
        config: all settings; the same settings resume a stopped run.
        data: a robomimic HDF5 with images, see ``ocplanner render``.
        run: run folder, made if it does not exist.
        reading: how the data set is read.

    Returns:
        The planner file's path.

    Raises:
        DatasetError: the data set is damaged or lacks images.
        MismatchError: the data set was rendered for another observation or image size, its images are upside down, or
            another arm, gripper or scene was recorded than is simulated.
        TrainingError: a loss is not finite, or the run folder belongs to another training.
        OutputError: the folder cannot be written, is no folder for a run, or another process trains in it.
    """
    check_run_folder(run, [data])
    progress = TrainingProgress()
    with Demonstrations(data, reading=reading) as demos:
        settings = data_settings(demos, config)
        if settings.visual is None:
            settings = settings._replace(visual=_measured_visual(demos, config.cameras, progress.say))
        if settings.control_freq != CONTROL_HZ:
            progress.say(
                f"warning: recorded at {settings.control_freq:g} Hz, and so are the plans, but `ocplanner transfer` "
                f"carries out plans of {CONTROL_HZ:g} Hz alone"
            )
        parts = split(demos, config.seed)
        progress.say(f"{len(parts.train)} demonstrations to train on, {len(parts.valid)} held out ({parts.source})")
        train = load_frames(demos, parts.train, config, settings.object_name, progress.say)
        valid = load_frames(demos, parts.valid, config, settings.object_name, progress.say)
    progress.say(f"{len(train)} and {len(valid)} frames between grasp and release")
    return train_on_frames(config, train, valid, settings, run, progress)


def _measured_visual(demos: Demonstrations, cameras: Sequence[str], say: Callable[[str], None]) -> str | None:
    """The preset that pictures were drawn with of which the file does not say it."""
    try:
        visual = measured_visual(demos, cameras)
    except RenderingError as error:
        say(f"warning: the pictures were not compared with the simulated scene: {error}")
        return None
    if visual is None:
        say("warning: with which visual preset the pictures were drawn is neither on record nor to be seen")
    return visual


def train_on_frames(
    config: PlannerTraining,
    train: Frames,
    valid: Frames,
    settings: DataSettings,
    run: Path,
    progress: TrainingProgress | None = None,
) -> Path:
    """Train on frames that are already in memory; otherwise like :func:`train_planner`."""
    check_run_folder(run)
    keep_freed_memory()
    with locked(run), _threads(config.threads):
        folder = RunFolder(run)
        folder.claim(RunConfig(to_dict(config), {"train": train.digest(), "valid": valid.digest()}))
        try:
            return _Training(config, train, valid, settings, folder, progress or TrainingProgress()).run()
        finally:
            folder.close()


@contextmanager
def _threads(count: int) -> Iterator[None]:
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)


class _Training:
    def __init__(
        self,
        config: PlannerTraining,
        train: Frames,
        valid: Frames,
        settings: DataSettings,
        folder: RunFolder,
        progress: TrainingProgress,
    ) -> None:
        self.config, self.settings, self.folder, self.progress = config, settings, folder, progress
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(config.seed)
            network = PlannerNetwork(config.network, config.cameras)
        try:
            network.to(config.device).to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        except (RuntimeError, AssertionError) as error:
            raise InvalidValueError(f"device {config.device!r} cannot be used ({error}); use --device cpu") from error
        normaliser = Normaliser.fit(train.positions[:, 0])
        self.material = Material(config, network, normaliser, train, valid, settings.mask_rgb)
        self.seconds = 0.0

    @property
    def network(self) -> PlannerNetwork:
        return self.material.network

    def run(self) -> Path:
        latest = self.folder.load("latest")
        start = (0, 0)
        if latest is not None:
            tensors, facts = latest
            self._restore_network(tensors)
            start = (ORDER.index(facts["stage"]), int(facts["step"]))
            self.seconds = float(facts["seconds"])
            self.folder.rewind(ORDER, facts["stage"], start[1])
            self.progress.say(f"continuing {self.folder.path} at {facts['stage']} step {start[1]}")
        for index, kind in enumerate(STAGES):
            first = start[1] if index == start[0] else 0
            steps = getattr(self.config, kind.name).steps
            if index < start[0] or first >= steps:
                continue
            stage = kind(self.material)
            tensors = latest[0] if latest is not None and first > 0 else None
            self._run_stage(index, stage, first, tensors)
        return self._finish()

    # -- one stage -------------------------------------------------------------------------------------------------

    def _run_stage(self, index: int, stage: Stage, first: int, tensors: dict[str, torch.Tensor] | None) -> None:
        config = stage.config
        rate = partial(learning_rate, base=config.learning_rate, steps=config.steps, warmup=config.warmup)
        optimisation = Optimisation(stage.module, config, rate)
        if tensors is not None:
            optimisation.restore(tensors)
        order = BatchOrder(len(self.material.train), config.batch, (self.config.seed, index, 0))
        losses: list[float] = []
        started = time.monotonic() - self.seconds
        with self.progress.bar(stage.name, config.steps, first) as advance:
            for step in range(first, config.steps):
                losses.append(self._step(stage, optimisation, order, index, step))
                advance(losses[-1])
                done = step + 1
                last = done == config.steps
                self.seconds = time.monotonic() - started
                if last or done % self.config.validate_every == 0:
                    self._validate(stage, optimisation, done, float(np.mean(losses)))
                    losses.clear()
                if last:
                    optimisation.swap()
                    self._save(stage.name, stage, done, None)
                if last or done % self.config.checkpoint_every == 0:
                    self._save("latest", stage, done, None if last else optimisation)

    def _step(self, stage: Stage, optimisation: Optimisation, order: BatchOrder, index: int, step: int) -> float:
        rng = np.random.default_rng([self.config.seed, index, 1, step])
        stage.module.train()
        with enough_memory(order.batch):
            loss = stage.loss(order.rows(step), rng)
        value = float(loss.detach())
        if not math.isfinite(value):
            raise TrainingError(
                f"the {stage.name} loss is {value} at step {step + 1}; lower its learning rate "
                f"({stage.config.learning_rate:g}), or look for damaged poses in the data"
            )
        with enough_memory(order.batch):
            optimisation.step(loss, step)
        return value

    def _validate(self, stage: Stage, optimisation: Optimisation, step: int, loss: float) -> None:
        optimisation.swap()
        values = {"seconds": round(self.seconds, 1), "loss": loss, **stage.validate()}
        optimisation.swap()
        row = StepMetrics(stage.name, step, values)
        self.folder.record(row)
        self.progress.say(f"{row.stage}, step {row.step}: {summary(values)}")

    def _save(self, name: str, stage: Stage, step: int, optimisation: Optimisation | None) -> None:
        tensors = {f"network.{key}": value for key, value in self.network.state_dict().items()}
        if optimisation is not None:
            tensors |= dict(optimisation.state())
        self.folder.save(name, tensors, {"stage": stage.name, "step": step, "seconds": self.seconds})

    def _restore_network(self, tensors: dict[str, torch.Tensor]) -> None:
        state = self.network.state_dict()
        with torch.no_grad():
            for key, value in state.items():
                value.copy_(tensors[f"network.{key}"])

    # -- the end ---------------------------------------------------------------------------------------------------

    def _finish(self) -> Path:
        results, states = {}, {}
        for name in ("predictor", "finetune"):
            saved = self.folder.load(name)
            if saved is not None:
                states[name] = saved[0]
                self._restore_network(states[name])
                results[name] = self._appearances()
        kept = self._choose(results)
        for name, appearances in results.items():
            for appearance, errors in appearances.items():
                self.folder.record(HeldOutErrors(errors.as_row(), name, name == kept, appearance))
        self._restore_network(states[kept])
        held_out = {name: errors.as_row() for name, errors in results[kept].items()}
        provenance = Provenance(self.settings, self.material.normaliser, kept, held_out, self.material.train.digest())
        export_planner(self.network, self.config, provenance, self.folder.path / FILE_NAME, self._probe())
        self.progress.say(f"kept {kept}: held out, {summary(held_out['source'])}")
        return self.folder.path / FILE_NAME

    def _appearances(self) -> dict[str, PlanErrors]:
        valid = self.material.valid
        sets = {"source": valid}
        if all(camera.silhouettes is not None for camera in valid.cameras.values()):
            shown = {arm: valid.replace_masks(i) for i, arm in enumerate(self.settings.silhouettes)}
            sets |= {arm: frames for arm, frames in shown.items() if len(frames)}
        return {name: self.material.errors(self.material.plan(frames), frames) for name, frames in sets.items()}

    def _choose(self, results: dict[str, dict[str, PlanErrors]]) -> str:
        if self.config.keep != "better":
            return self.config.keep
        return min(results, key=lambda name: float(np.mean([_score(errors) for errors in results[name].values()])))

    def _probe(self) -> dict[str, np.ndarray]:
        valid, rows = self.material.valid, np.arange(min(4, len(self.material.valid)))
        return {name: observed(camera, rows, self.settings.mask_rgb) for name, camera in valid.cameras.items()}


def _score(errors: PlanErrors) -> float:
    """ADE in millimetres, plus the rotation error with a degree counted as a millimetre."""
    return errors.ade_mm + (errors.rotation_deg or 0.0)


def summary(values: Mapping[str, float]) -> str:
    """Losses and errors for people."""
    text = [f"loss {values['loss']:.4g}, held out {values['valid_loss']:.4g}"] if "loss" in values else []
    text.append(f"ADE {values['ade_mm']:.1f} mm, FDE {values['fde_mm']:.1f} mm")
    if "rotation_deg" in values:
        text.append(f"rotation {values['rotation_deg']:.1f} deg (median {values['rotation_median_deg']:.1f})")
    return ", ".join(text)

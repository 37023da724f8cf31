"""Training a policy: one loop for every algorithm, on one process or many; a stopped run continues to the same weights.

Lightning Fabric starts the processes and averages their gradients. Each process takes its share of every batch, so the
number of processes changes a run by rounding only (and by batch normalisation and crops with images).
"""

import math
import os
import time
from contextlib import ExitStack, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from lightning_fabric import Fabric
from torch.multiprocessing.spawn import ProcessException

from ocplanner.demos.action_frame import ActionFrame, check_deltas
from ocplanner.demos.control_frequency import control_frequency
from ocplanner.demos.dataset import Demonstrations
from ocplanner.demos.findings import of_gripper
from ocplanner.demos.live_object import check_live_object
from ocplanner.demos.object_sensors import OBJECT_SENSORS, object_order, sensors_of
from ocplanner.demos.picture_check import measured_visual
from ocplanner.demos.settings import DEFAULT_READING, ReadSettings
from ocplanner.demos.soundness import sound_names
from ocplanner.envs.tasks import tasks
from ocplanner.errors import (
    DatasetError,
    InvalidValueError,
    MismatchError,
    OcplannerError,
    RenderingError,
    TrainingError,
)
from ocplanner.files.records.labels import ActionScale, FrameName
from ocplanner.files.records.metrics import POLICY_STAGE, RunConfig, StepMetrics
from ocplanner.files.records.policy import PolicyHeader
from ocplanner.files.records.render import RenderRecord
from ocplanner.files.storage import locked, natural_key
from ocplanner.policies.action_range import ActionRange, range_of
from ocplanner.policies.action_samplers import TrainedPolicy
from ocplanner.policies.algorithms import find_algorithm
from ocplanner.policies.bcq import encoded
from ocplanner.policies.bcq_config import BCQConfig
from ocplanner.policies.bcq_network import BCQ
from ocplanner.policies.config import POLICY_FILE, PolicyTraining
from ocplanner.policies.data import Samples, check_demonstration, hint_horizons, load_samples
from ocplanner.policies.evaluable import ACTIONS_FAULT, Obstacle, obstacles
from ocplanner.policies.frozen_sampler import check_recorded
from ocplanner.policies.learner import Learner
from ocplanner.policies.network import make_network
from ocplanner.policies.observation import fit_encoders
from ocplanner.policies.policy import Policy, save_policy
from ocplanner.policies.transitions import load_transitions
from ocplanner.progress import TrainingProgress
from ocplanner.settings import require, to_dict
from ocplanner.training.memory import enough_memory, keep_freed_memory
from ocplanner.training.optimisation import BatchOrder
from ocplanner.training.run_folder import RunFolder, check_run_folder
from ocplanner.versions import installed

_USUAL_MASK = PolicyTraining.mask
"""Raw recordings have no masks, and their users name none."""

_CHECKPOINT_SECONDS = 30.0
"""The most that a kill loses, beside ``checkpoint_every``."""


class Recorded(NamedTuple):
    """What is learned from.

    Attributes:
        config: the settings, with the horizons of the data set's hints filled in.
        train: training steps.
        valid: held-out steps, or None.
        header: of the policies that will be trained on them, at step 0.
        warnings: what the user should know before the training.
    """

    config: PolicyTraining
    train: Samples
    valid: Samples | None
    header: PolicyHeader
    warnings: tuple[str, ...] = ()


def train_policy(
    config: PolicyTraining,
    data: Path,
    run: Path,
    processes: int = 1,
    sampler: Path | None = None,
    reading: ReadSettings = DEFAULT_READING,
) -> Path:
    """Train on a robomimic data set and write ``run/policy.safetensors``.

    Under ``torchrun`` the processes are those that it started, on one machine or several, and ``processes`` is ignored.

    Args:
        config: all settings; the same ones continue a stopped run.
        data: a robomimic HDF5; hints come from ``ocplanner label``, images from ``ocplanner render``.
        run: run folder, made when absent; on several machines it must be shared.
        processes: training processes on this machine: one a GPU, or CPU processes.
        sampler: file of the policy that proposes, if ``config`` is that of
            :func:`ocplanner.policies.frozen_sampler.frozen_sampler_training`.
        reading: how the data set is read.

    Returns:
        The policy file's path: the last weights (averaged ones with ``ema``). Earlier ones are in ``run/policies``.

    Raises:
        DatasetError: the data set is damaged or lacks an observation.
        MismatchError: it was labelled with hints of other horizons, or is of other actions than the sampler's.
        TrainingError: a loss is not finite, a process died, or the run folder belongs to another training.
        InvalidValueError: the batch cannot be shared out evenly, or the device cannot be used.
        OutputError: the folder cannot be written, or another process trains in it.
    """
    elastic = "TORCHELASTIC_RUN_ID" in os.environ
    world = int(os.environ["WORLD_SIZE"]) if elastic else processes
    if processes < 1 or config.batch % world:
        raise InvalidValueError(f"a batch of {config.batch} cannot be shared evenly by {world} processes; change one")
    check_run_folder(run, [data, sampler])
    fabric = _fabric(config, processes, elastic)
    try:
        outcome = fabric.launch(partial(_process, config=config, data=data, run=run, sampler=sampler, reading=reading))
    except ProcessException as error:
        raise TrainingError(f"a training process died: {str(error).strip().splitlines()[-1]}") from error
    if isinstance(outcome, OcplannerError):
        raise outcome
    return outcome


def _fabric(config: PolicyTraining, processes: int, elastic: bool) -> Fabric:
    machines = 1
    if elastic:
        processes = int(os.environ["LOCAL_WORLD_SIZE"])
        machines = int(os.environ["WORLD_SIZE"]) // processes
    strategy = "ddp" if elastic else "ddp_spawn" if processes > 1 else "auto"
    try:
        return Fabric(
            accelerator=config.device,
            devices=processes,
            num_nodes=machines,
            strategy=strategy,
            precision="bf16-mixed" if config.precision == "bfloat16" else "32-true",
        )
    except (RuntimeError, ValueError) as error:
        raise InvalidValueError(f"device {config.device!r} cannot be used ({error}); use --device cpu") from error


def _process(
    fabric: Fabric, config: PolicyTraining, data: Path, run: Path, sampler: Path | None, reading: ReadSettings
) -> Path | OcplannerError:
    """One process's training; errors for users come back as values, which survive the way between processes."""
    keep_freed_memory()
    before = torch.get_num_threads()
    torch.set_num_threads(config.threads)
    try:
        proposing = _proposing(config, sampler)
        recorded = read(config, data, reading)
        if proposing is not None:
            check_recorded(proposing, recorded.header, data)
        for warning in recorded.warnings:
            TrainingProgress(shown=fabric.global_rank == 0).say(f"warning: {warning}")
        folder = RunFolder(run)
        with ExitStack() as held:
            refused = _claim(held, folder, recorded) if fabric.global_rank == 0 else None
            refused = fabric.broadcast(refused)
            return refused or _Training(fabric, recorded, folder, proposing).run()
    except OcplannerError as error:
        return error
    finally:
        torch.set_num_threads(before)
        if torch.distributed.is_initialized():  # its threads would abort a process that ends with them
            torch.distributed.destroy_process_group()


def _claim(held: ExitStack, folder: RunFolder, recorded: Recorded) -> OcplannerError | None:
    """Lock the run folder until ``held`` closes; the error that forbids it is given, so that all processes stop."""
    try:
        held.enter_context(locked(folder.path))
        held.callback(folder.close)
        folder.claim(RunConfig(to_dict(recorded.config), recorded.header.data))
    except OcplannerError as error:
        return error
    return None


def read(config: PolicyTraining, data: Path, reading: ReadSettings = DEFAULT_READING) -> Recorded:
    """The demonstrations to train on, and ``mask/valid`` where there is one.

    Raises:
        DatasetError: the data set is damaged, has no such mask, or lacks an observation.
        MismatchError: it was labelled with hints of other horizons, or another arm, gripper or scene was recorded than
            is simulated.
    """
    with Demonstrations(data, reading=reading) as demos:
        hint = config.network.hint
        if hint is not None:
            hint = replace(hint, horizons=hint_horizons(demos, hint.horizons))
            config = replace(config, network=replace(config.network, hint=hint))
        check = partial(check_demonstration, demos=demos, config=config)
        names, held_out = _parts(demos, config)
        names = sound_names(demos, names, check, _say)
        held_out = sound_names(demos, held_out, check, _say) if held_out else []
        check_deltas(demos)
        frame, scale, actions_fault = _actions(demos)
        ranges = None if frame is not None else range_of([demos[name].actions for name in names])
        train = _load(demos, names, config, ranges)
        valid = _load(demos, held_out, config, ranges) if held_out else None
        known = "object" in config.observation.low_dim and demos.env_name in OBJECT_SENSORS
        order = object_order(demos, names[0]) if known else None
        sensors = None if order is None else sensors_of(demos.env_name, order)
        if sensors is not None and demos.env_name in {task.env_name for task in tasks().values()}:
            check_live_object(demos, names[0], sensors)
        else:
            with suppress(DatasetError):  # states that cannot be simulated are not learned from
                demos.compare_world(demos[names[0]])
        render, warnings = _drawn(demos, names, config)
        warnings += of_gripper(demos)
        header = PolicyHeader(
            task=demos.task_name,
            environment=demos.env_name or None,
            robots=tuple(demos.robots),
            object_layout=order,
            object_sensors=sensors,
            action_frame=frame,
            action_scale=scale,
            action_range=ranges,
            control_freq=control_frequency(demos, names[0]),
            render=render,
            labels=demos.label_record if config.reads_hints else None,
            rewards=demos.label_record if find_algorithm(config.algorithm).rewards else None,
            low_dim=train.low_dim.shape[1],
            actions=train.actions.shape[1],
            algorithm=config.algorithm,
            seed=config.seed,
            step=0,
            training=to_dict(config),
            data=train.digest(),
            versions=installed(),
        )
        warnings += _refused(obstacles(header, config), demos, actions_fault)
        return Recorded(config, train, valid, header, tuple(warnings))


def _say(line: str) -> None:
    TrainingProgress().say(line)


def _load(demos: Demonstrations, names: list[str], config: PolicyTraining, ranges: ActionRange | None) -> Samples:
    samples = load_samples(demos, names, config, ranges)
    if not find_algorithm(config.algorithm).rewards:
        return samples
    return replace(samples, transitions=load_transitions(demos, names, config))


def _actions(demos: Demonstrations) -> tuple[FrameName, ActionScale, None] | tuple[None, None, str]:
    """Frame and scale of the actions; None and the reason where they are no end-effector deltas of one arm."""
    try:
        with ActionFrame(demos) as frame:
            return frame.name, frame.scale, None
    except MismatchError as error:
        return None, None, str(error).partition(";")[0]


def _parts(demos: Demonstrations, config: PolicyTraining) -> tuple[list[str], list[str]]:
    """The demonstrations to train on, and those held out; none are if it trains on all of them."""
    if config.mask is None:
        return list(demos.names), []
    if config.mask == _USUAL_MASK and not demos.mask_names:
        _say(f"{demos.path} has no masks: training on every demonstration, none is held out")
        return list(demos.names), []
    names = demos.mask(config.mask)
    held_out = demos.mask("valid") if "valid" in demos.mask_names else []
    both = sorted({*names} & {*held_out}, key=natural_key)
    if both:
        raise DatasetError(
            f"{demos.path}: mask/{config.mask} and mask/valid share {', '.join(both[:3])}: losses on mask/valid would "
            "not be held-out ones; mend the masks, or train on every demonstration without them (--mask all)"
        )
    return names, held_out


def _drawn(demos: Demonstrations, names: list[str], config: PolicyTraining) -> tuple[RenderRecord | None, list[str]]:
    """How the pictures that are learned from were drawn, as far as the file says or they show, and warnings."""
    cameras, rendered = config.observation.cameras, demos.render_record
    if not cameras:
        return rendered, []
    try:
        visual = measured_visual(demos, cameras, names)
    except RenderingError as error:
        return rendered, [f"the pictures were not compared with the simulated scene: {error}"]
    if rendered is not None and rendered.visual is not None:
        return rendered, []
    if visual is not None:
        return replace(rendered or RenderRecord(), visual=visual), []
    return rendered, [
        "with which visual preset the pictures were drawn is neither on record nor to be seen: `ocplanner evaluate` "
        "will ask for it (--visual)"
    ]


def _refused(found: list[Obstacle], demos: Demonstrations, actions_fault: str | None) -> list[str]:
    """A warning of what ``ocplanner evaluate`` will refuse, where no setting can mend it.

    Raises:
        MismatchError: other settings can mend all that it would refuse.
    """
    if not found:
        return []
    if all(obstacle.chosen for obstacle in found):
        raise MismatchError(f"{demos.path}: `ocplanner evaluate` would refuse the policy: {_joined(found)}")
    if actions_fault is not None:
        own = actions_fault.removeprefix(f"{demos.path}: ")
        found = [one._replace(fault=own) if one.fault == ACTIONS_FAULT else one for one in found]
    return [f"`ocplanner evaluate` will refuse this policy: {_joined(found)}"]


def _joined(found: list[Obstacle]) -> str:
    return ". Also: ".join(map(str, found))


def _proposing(config: PolicyTraining, sampler: Path | None) -> Policy | None:
    """The trained policy that proposes to the critics, if the configuration names one."""
    own = config.algorithm_settings
    wanted = own.sampler_sha256 if isinstance(own, BCQConfig) else None
    if sampler is None:
        require(wanted is None, f"the policy with hash {wanted} proposes: give its file as sampler")
        return None
    policy = Policy.load(sampler)
    if policy.sha256 != wanted:
        raise MismatchError(f"{sampler} has hash {policy.sha256}, but {wanted} is to propose; give that policy")
    for part in ("observation", "network"):
        if getattr(config, part) != getattr(policy.training, part):
            raise MismatchError(f"what is seen and the networks are those of {policy.path}: change no {part} settings")
    return policy


class _Training:
    def __init__(self, fabric: Fabric, recorded: Recorded, folder: RunFolder, proposing: Policy | None = None) -> None:
        config = recorded.config
        self.fabric, self.config, self.recorded, self.folder = fabric, config, recorded, folder
        self.progress = TrainingProgress(shown=self.first)
        self.train, self.valid = recorded.train, recorded.valid
        network = make_network(config, recorded.header.low_dim, recorded.header.actions)
        if proposing is None:
            fit_encoders(network, recorded.train.low_dim)
        elif isinstance(network, BCQ) and isinstance(network.sampler, TrainedPolicy):
            network.sampler.actor.load_state_dict(proposing.network.state_dict())
            self._encode(network, proposing)
        if config.observation.cameras:
            network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        network.to(fabric.device)
        self.learner: Learner = find_algorithm(config.algorithm).learner(fabric, config, network)
        self.seconds = 0.0
        self._sums: dict[str, float] = {}
        self._summed = 0

    @property
    def first(self) -> bool:
        return self.fabric.global_rank == 0

    def run(self) -> Path:
        first = self._resume()
        order = BatchOrder(len(self.train), self.config.batch, (self.config.seed, 0))
        started, since = time.monotonic() - self.seconds, (first, time.monotonic())
        saved = time.monotonic()
        with self.progress.bar(self.config.algorithm, self.config.steps, first) as advance:
            for step in range(first, self.config.steps):
                seen = self._step(order.rows(step), step)
                for name, value in seen.items():
                    self._sums[name] = self._sums.get(name, 0.0) + value
                self._summed += 1
                advance(seen["loss"])
                done = step + 1
                last = done == self.config.steps
                self.seconds = time.monotonic() - started
                if last or done % self.config.validate_every == 0:
                    speed = (done - since[0]) / (time.monotonic() - since[1])
                    self._report(done, {name: total / self._summed for name, total in self._sums.items()}, speed)
                    self._sums, self._summed = {}, 0
                    since = (done, time.monotonic())
                if last or done % self.config.save_every == 0:
                    self._save_policy(self.folder.path / "policies" / f"step_{done:07d}.safetensors", done)
                due = time.monotonic() - saved > _CHECKPOINT_SECONDS
                if last or due or done % self.config.checkpoint_every == 0:
                    self._save_checkpoint(done)
                    saved = time.monotonic()
        policy = self.folder.path / POLICY_FILE
        self._save_policy(policy, self.config.steps)
        return policy

    def _encode(self, network: BCQ, proposing: Policy) -> None:
        self.progress.say(f"encoding the data as {proposing.path} sees them")
        network.to(self.fabric.device)
        self.train = encoded(self.train, self.config, network, self.fabric.device)
        if self.valid is not None:
            self.valid = encoded(self.valid, self.config, network, self.fabric.device)
        fit_encoders(network.critics, self.train.low_dim)

    # -- one step --------------------------------------------------------------------------------------------------

    def _step(self, rows: np.ndarray, step: int) -> dict[str, float]:
        train = self.train
        with enough_memory(self.config.batch):
            seen = self.learner.step(train, rows, step)
        numbers = torch.stack(list(seen.values()))
        if self.fabric.world_size > 1:
            numbers = self.fabric.all_reduce(numbers, reduce_op="mean")
        values = dict(zip(seen, numbers.tolist()))  # type: ignore[union-attr]
        for name, value in values.items():
            if not math.isfinite(value):
                raise TrainingError(
                    f"the {name} is {value} at step {step + 1}, batch: {train.named(rows)}; lower the learning rate "
                    f"({self.config.learning_rate:g}), or look for damaged numbers in these demonstrations"
                )
        return values

    # -- what is written, by the first process alone ---------------------------------------------------------------

    def _report(self, step: int, seen: dict[str, float], speed: float) -> None:
        if not self.first:
            return
        values = {"seconds": round(self.seconds, 1), **seen}
        values |= {"learning_rate": self.config.rate(step - 1), "steps_per_second": speed}
        text = f"step {step} of {self.config.steps}: loss {seen['loss']:.4g}"
        if self.valid is not None:
            self.learner.swap()
            values |= {f"valid_{name}": value for name, value in self.learner.held_out(self.valid).items()}
            self.learner.swap()
            text += f", held out {values['valid_loss']:.4g}"
        self.folder.record(StepMetrics(POLICY_STAGE, step, values))
        left = (self.config.steps - step) / speed
        self.progress.say(f"{text}, {speed:.1f} steps/s, {left / 60:.1f} minutes left")

    def _save_policy(self, path: Path, step: int) -> None:
        if not self.first:
            return
        self.learner.swap()
        save_policy(self.learner.network, replace(self.recorded.header, step=step), path)
        self.learner.swap()

    def _save_checkpoint(self, step: int) -> None:
        if self.first:
            tensors = {f"network.{name}": value for name, value in self.learner.network.state_dict().items()}
            tensors |= dict(self.learner.state())
            facts = {"step": step, "seconds": self.seconds, "sums": self._sums, "summed": self._summed}
            self.folder.save("latest", tensors, facts)

    def _resume(self) -> int:
        latest = self.folder.load("latest")
        if latest is None:
            return 0
        tensors, facts = latest
        with torch.no_grad():
            for name, value in self.learner.network.state_dict().items():
                value.copy_(tensors[f"network.{name}"])
        self.learner.restore(tensors)
        self.seconds = float(facts["seconds"])
        self._sums, self._summed = dict(facts.get("sums", {})), int(facts.get("summed", 0))
        step = int(facts["step"])
        if self.first:
            self.folder.rewind((POLICY_STAGE,), POLICY_STAGE, step)
            self.progress.say(f"continuing {self.folder.path} at step {step} of {self.config.steps}")
        return step

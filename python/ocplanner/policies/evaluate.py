"""Success rates of policies by robomimic's protocol: fresh episodes for every checkpoint, stopped at success."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import torch

from ocplanner.envs.environment import make_env
from ocplanner.errors import MismatchError, ModelFileError
from ocplanner.files.journal import Journal
from ocplanner.files.records.episode import EpisodeResult
from ocplanner.files.records.evaluation import CheckpointResult, EvaluationSettings, PolicyResult
from ocplanner.files.records.labels import LabelRecord
from ocplanner.files.records.render import RenderRecord
from ocplanner.files.storage import check_output, locked
from ocplanner.guidance.live_hint import LiveHint, check_planner
from ocplanner.planner.planner import Planner
from ocplanner.policies.evaluable import check_evaluable
from ocplanner.policies.policy import Policy
from ocplanner.policies.rollout import PolicyRollout
from ocplanner.rollouts.episodes import run_episodes
from ocplanner.rollouts.intervals import wilson
from ocplanner.rollouts.settings import WorkerSettings
from ocplanner.settings import require
from ocplanner.versions import installed, running_command

OnEpisode = Callable[[Path, EpisodeResult], None]
"""Called with the checkpoint and each episode."""


@dataclass(frozen=True)
class EvaluationJob:
    """What a worker needs to run any of the episodes.

    Attributes:
        policies: the policy files, one for each checkpoint, all of one training.
        planner: the planner's file, for policies that read hints.
        settings: numbers of episodes, seeds and steps.
    """

    policies: tuple[Path, ...]
    planner: Path | None
    settings: EvaluationSettings

    @property
    def seeds(self) -> range:
        """Of all episodes: those of a checkpoint follow those of the one before."""
        first = self.settings.seed_start
        return range(first, first + self.settings.episodes * len(self.policies))

    def path_of(self, seed: int) -> Path:
        """The policy that plays this seed."""
        return self.policies[(seed - self.settings.seed_start) // self.settings.episodes]


class EvaluationWorker:
    """Runs the episodes of a job in one process. Policies are loaded when their first episode comes."""

    def __init__(self, job: EvaluationJob) -> None:
        self.job = job
        policy = Policy.load(job.policies[0])
        seen, render = policy.training.observation, policy.header.render or RenderRecord()
        self.env = make_env(
            policy.header.task,
            policy.header.robots[0],
            cameras=seen.cameras,
            image_size=seen.image_size,
            visual=render.visual or job.settings.visual or "fast",  # the last where no picture is read
            observe=render.observe,
            control_freq=policy.header.control_freq,
        )
        self._planner = None if job.planner is None else Planner.load(job.planner)
        self._loaded: tuple[Path, PolicyRollout] | None = None

    def play(self, seed: int) -> EpisodeResult:
        """Run one episode of the checkpoint that the seed belongs to."""
        path = self.job.path_of(seed)
        if self._loaded is None or self._loaded[0] != path:
            self._loaded = (path, self._rollout(Policy.load(path)))
        before = torch.get_num_threads()
        torch.set_num_threads(1)  # one small batch at a time is too little to share out
        try:
            outcome = self._loaded[1].play(seed, self.job.settings.horizon)
        finally:
            torch.set_num_threads(before)
        return EpisodeResult(seed, outcome.success, outcome.steps, outcome.failure)

    def close(self) -> None:
        """Free the simulation."""
        self.env.close()

    def _rollout(self, policy: Policy) -> PolicyRollout:
        hint = None
        if policy.training.reads_hints and self._planner is not None:
            hint = LiveHint(self.env, self._planner, _labels(policy))
        return PolicyRollout(self.env, policy, hint)


def evaluate_policy(
    policy: str | Path,
    planner: str | Path | None = None,
    settings: EvaluationSettings | None = None,
    *,
    workers: WorkerSettings | None = None,
    out: str | Path | None = None,
    overwrite: bool = False,
    on_episode: OnEpisode | None = None,
) -> PolicyResult:
    """Run a policy, or every checkpoint of a training, on the arm and task of its data set.

    Each checkpoint meets episodes of its own, and another training's checkpoints meet the same ones.

    Args:
        policy: a policy file, or the run folder of ``ocplanner train-policy``: then all of its ``policies/``.
        planner: the planner that the data set was labelled with, for a policy that reads hints.
        settings: numbers of episodes, seeds and steps.
        workers: where episodes run; the result does not depend on it.
        out: result file; with it, an evaluation that was stopped goes on where it was.
        overwrite: replace ``out`` if it is there.
        on_episode: called with the checkpoint and each episode, those of an earlier run included.

    Raises:
        ModelFileError: a file is missing or no policy, or no planner.
        MismatchError: the policy cannot act here, or the planner is not that of its hints.
        InvalidValueError: ``last`` is given for a single policy.
        OutputError: ``out`` cannot be written, is there already, or holds episodes of another evaluation.
        RenderingError: the policy sees images, and there is no working headless OpenGL.
    """
    settings, workers = settings or EvaluationSettings(), workers or WorkerSettings()
    alone = settings.last is None or Path(policy).is_dir()
    require(alone, f"last is {settings.last}, but {policy} is a single policy: give a run folder, or drop last")
    paths = checkpoints(Path(policy), settings.last)
    policies = [Policy.load(path) for path in paths]
    first = policies[0]
    check_evaluable(first)
    _check_visual(first, settings)
    if first.training.reads_hints != (planner is not None):
        raise MismatchError(
            f"{first.path} reads hints: give the planner of its data set (--planner)"
            if first.training.reads_hints
            else f"{first.path} reads no hints: drop the planner (--planner)"
        )
    loaded = None if planner is None else Planner.load(planner)
    if loaded is not None:
        check_planner(loaded, _labels(first))
    absolute = None if planner is None else Path(planner).absolute()
    job = EvaluationJob(tuple(path.absolute() for path in paths), absolute, settings)
    if out is None:
        runs = _play(job, workers, None, on_episode)
    else:
        out = Path(out)
        check_output(out, overwrite, "JSON result", (*paths, loaded and loaded.path))
        with locked(out):
            journal = Journal(_journal(out), _identity(job, policies, loaded))
            runs = _play(job, workers, journal, on_episode)
    result = PolicyResult(
        task=first.header.task,
        robot=first.header.robots[0],
        algorithm=first.training.algorithm,
        training=first.header.training,
        labels=first.header.labels,
        rewards=first.header.rewards,
        planner_sha256=None if loaded is None else loaded.sha256,
        settings=settings,
        privileged=_privileged(first, loaded),
        checkpoints=tuple(
            _checkpoint(one, [runs[seed] for seed in job.seeds if job.path_of(seed) == path])
            for path, one in zip(job.policies, policies)
        ),
        command=running_command(),
        versions=installed(),
    )
    if isinstance(out, Path):
        result.save(out)
        _journal(out).unlink(missing_ok=True)
    return result


def checkpoints(path: Path, last: int | None = None) -> list[Path]:
    """The policy files of a run folder by their steps, only the ``last`` so many if given; or the one file.

    Raises:
        ModelFileError: there is none.
    """
    if not path.is_dir():
        return [path]
    folder = path if path.name == "policies" else path / "policies"
    found = sorted(folder.glob("step_*.safetensors"))
    if not found:
        raise ModelFileError(
            f"{path} holds no policies/step_*.safetensors; give a policy file or the run folder of "
            "`ocplanner train-policy`"
        )
    return found[-(last or 0) :]


def _check_visual(policy: Policy, settings: EvaluationSettings) -> None:
    cameras = policy.training.observation.cameras
    recorded = None if policy.header.render is None else policy.header.render.visual
    unread = settings.visual is not None and not cameras
    require(not unread, f"visual is {settings.visual}, but {policy.path} reads no pictures: drop --visual")
    if recorded is not None and settings.visual not in (None, recorded):
        raise MismatchError(
            f"{policy.path} learned from {recorded} pictures, not {settings.visual} ones: drop --visual"
        )
    if cameras and recorded is None and settings.visual is None:
        raise MismatchError(
            f"{policy.path} does not say with which visual preset the pictures were drawn that it learned from: say it "
            "with --visual fast or --visual stock (robosuite's own)"
        )


def _journal(out: Path) -> Path:
    return out.with_name(f"{out.name}.journal")


def _labels(policy: Policy) -> LabelRecord:
    labels = policy.header.labels
    if labels is None:
        raise MismatchError(f"{policy.path}: its hints were not made by `ocplanner label`; they cannot be made live")
    return labels


def _privileged(policy: Policy, planner: Planner | None) -> tuple[str, ...]:
    """Hints need the object's pose too: it tells whether the object is held, and where it is."""
    posed = planner is not None or "object" in policy.training.observation.low_dim
    hidden = planner is not None and planner.header.observe == "no-robot"
    return (*(["object pose"] if posed else []), *(["hidden robot"] if hidden else []))


def _checkpoint(policy: Policy, runs: Sequence[EpisodeResult]) -> CheckpointResult:
    interval = wilson(sum(run.success for run in runs), len(runs))
    return CheckpointResult(policy.header.step, policy.sha256, interval, tuple(runs))


def _identity(job: EvaluationJob, policies: Sequence[Policy], planner: Planner | None) -> dict[str, Any]:
    return {
        "policies": [policy.sha256 for policy in policies],
        "planner_sha256": None if planner is None else planner.sha256,
        "first_seed": job.settings.seed_start,
        "episodes": job.settings.episodes,
        "horizon": job.settings.horizon,
        **({} if job.settings.visual is None else {"visual": job.settings.visual}),
        "versions": installed(),
    }


def _play(
    job: EvaluationJob, workers: WorkerSettings, journal: Journal | None, on_episode: OnEpisode | None
) -> dict[int, EpisodeResult]:
    runs = {} if journal is None else {seed: run for seed, run in journal.runs.items() if seed in job.seeds}
    if on_episode is not None:
        for seed, run in runs.items():
            on_episode(job.path_of(seed), run)
    left = [seed for seed in job.seeds if seed not in runs]
    for seed, run in run_episodes(partial(EvaluationWorker, job), EvaluationWorker.play, left, workers):
        runs[seed] = run
        if journal is not None:
            journal.add(run)
        if on_episode is not None:
            on_episode(job.path_of(seed), run)
    return runs

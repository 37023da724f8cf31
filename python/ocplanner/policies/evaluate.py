"""Success rates of policies by robomimic's protocol: fresh episodes for every checkpoint, stopped at success."""

import shlex
import sys
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
from ocplanner.files.records.labels import LabelRecord
from ocplanner.files.storage import check_free, locked
from ocplanner.guidance.live_hint import LiveHint, check_planner
from ocplanner.planner.planner import Planner
from ocplanner.policies.policy import Policy
from ocplanner.policies.result import Checkpoint, PolicyResult
from ocplanner.policies.rollout import PolicyRollout
from ocplanner.rollouts.episodes import run_episodes
from ocplanner.rollouts.settings import WorkerSettings
from ocplanner.settings import build, require
from ocplanner.versions import installed


@dataclass(frozen=True)
class PolicyScenario:
    """What one worker needs to run any of the episodes.

    Attributes:
        policies: the policy files, one a checkpoint, all of one training.
        planner: the planner's file, for policies that read hints.
        first_seed: seed of the first checkpoint's first episode.
        episodes: of each checkpoint; their seeds follow one another through all checkpoints.
        horizon: control steps of an episode; the task's own if None.
    """

    policies: tuple[Path, ...]
    planner: Path | None
    first_seed: int
    episodes: int
    horizon: int | None

    def path_of(self, seed: int) -> Path:
        """The policy that plays this seed."""
        return self.policies[(seed - self.first_seed) // self.episodes]


class PolicyStage:
    """A scenario set up in a process; policies are loaded when their first episode comes."""

    def __init__(self, scenario: PolicyScenario) -> None:
        self.scenario = scenario
        policy = Policy.load(scenario.policies[0])
        seen, render = policy.training.observation, policy.config["render"] or {}
        self.env = make_env(
            policy.config["task"],
            policy.config["robots"][0],
            cameras=seen.cameras,
            image_size=seen.image_size,
            visual=render.get("visual", "fast"),
            observe=render.get("observe", "full"),
        )
        self._planner = None if scenario.planner is None else Planner.load(scenario.planner)
        self._loaded: tuple[Path, PolicyRollout] | None = None

    def play(self, seed: int) -> EpisodeResult:
        """Run one episode of the checkpoint that the seed belongs to."""
        path = self.scenario.path_of(seed)
        if self._loaded is None or self._loaded[0] != path:
            self._loaded = (path, self._rollout(Policy.load(path)))
        before = torch.get_num_threads()
        torch.set_num_threads(1)  # one small batch at a time is too little to share out
        try:
            outcome = self._loaded[1].play(seed, self.scenario.horizon)
        finally:
            torch.set_num_threads(before)
        return EpisodeResult(seed, outcome.success, outcome.steps, outcome.failure, None)

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
    *,
    episodes: int = 50,
    last: int | None = None,
    seed_start: int = 20000,
    horizon: int | None = None,
    workers: int = 1,
    ray: str | None = None,
    out: str | Path | None = None,
    overwrite: bool = False,
    command: str | None = None,
    on_episode: Callable[[Path, EpisodeResult], None] | None = None,
) -> PolicyResult:
    """Run a policy, or every checkpoint of a training, on the arm and task of its data set.

    Args:
        policy: a policy file, or the run folder of ``ocplanner train-policy``: then all of its ``policies/``.
        planner: the planner that the data set was labelled with, for a policy that reads hints.
        episodes: for each checkpoint.
        last: of a run folder, only the last so many checkpoints.
        seed_start: seed of the first episode; all others follow, so that every checkpoint meets episodes of its own,
            and another training's checkpoints the same ones.
        horizon: control steps of an episode; the task's own if not given.
        workers: processes; the result does not depend on it.
        ray: address of a Ray cluster for the workers; see :func:`ocplanner.rollouts.episodes.run_episodes`.
        out: result file; with it, an evaluation that was stopped goes on where it was.
        overwrite: replace ``out`` if it is there.
        command: what remakes the result; the running command if not given.
        on_episode: called with the checkpoint and each episode, those of an earlier run included.

    Raises:
        ModelFileError: a file is missing or no policy, or no planner.
        MismatchError: the policy cannot act here, or the planner is not that of its hints.
        InvalidValueError: a number is out of range.
        OutputError: ``out`` cannot be written, is there already, or holds episodes of another evaluation.
        RenderingError: the policy sees images, and there is no working headless OpenGL.
    """
    for name, value in {"episodes": episodes, "last": last, "horizon": horizon}.items():
        require(value is None or value >= 1, f"{name} {value} must be at least 1")
    require(last is None or Path(policy).is_dir(), f"last {last}: {policy} is a single policy; give a run folder")
    paths = checkpoints(Path(policy))[-(last or 0) :]
    policies = [Policy.load(path) for path in paths]
    for one in policies:
        one.check_setup()
    scenario = PolicyScenario(
        tuple(path.absolute() for path in paths),
        None if planner is None else Path(planner).absolute(),
        seed_start,
        episodes,
        horizon,
    )
    hinted = policies[0].training.reads_hints
    if hinted != (planner is not None):
        raise MismatchError(
            f"{policies[0].path} reads hints: give the planner of its data set (--planner)"
            if hinted
            else f"{policies[0].path} reads no hints, so it needs no planner"
        )
    loaded = None if planner is None else Planner.load(planner)
    if loaded is not None:
        check_planner(loaded, _labels(policies[0]))
    seeds = range(seed_start, seed_start + episodes * len(paths))
    identity = _identity(scenario, policies, loaded)
    if out is None:
        runs = _play(scenario, seeds, workers, ray, None, on_episode)
    else:
        out = Path(out)
        check_free(out, overwrite)
        with locked(out):
            journal = Journal(out.with_name(f"{out.name}.journal"), identity)
            runs = _play(scenario, seeds, workers, ray, journal, on_episode)
    result = PolicyResult(
        task=str(policies[0].config["task"]),
        robot=str(policies[0].config["robots"][0]),
        algorithm=policies[0].training.algorithm,
        training=policies[0].config["training"],
        labels=policies[0].config["labels"],
        rewards=policies[0].config.get("rewards"),
        planner_sha256=identity["planner_sha256"],
        episodes=episodes,
        seed_start=seed_start,
        horizon=horizon,
        checkpoints=tuple(
            Checkpoint(
                step=int(one.config["step"]),
                sha256=one.sha256,
                runs=tuple(runs[seed] for seed in seeds if scenario.path_of(seed) == path),
            )
            for path, one in zip(scenario.policies, policies)
        ),
        command=command or shlex.join([Path(sys.argv[0]).name if sys.argv else "ocplanner", *sys.argv[1:]]),
        versions=installed(),
    )
    if isinstance(out, Path):
        result.save(out)
        out.with_name(f"{out.name}.journal").unlink(missing_ok=True)
    return result


def checkpoints(path: Path) -> list[Path]:
    """The policy files of a run folder by their steps, or the one file.

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
    return found


def _labels(policy: Policy) -> LabelRecord:
    labels = policy.config["labels"]
    if labels is None:
        raise MismatchError(f"{policy.path}: its hints were not made by `ocplanner label`; they cannot be made live")
    return build(LabelRecord, labels, ignore_unknown=True)


def _identity(scenario: PolicyScenario, policies: Sequence[Policy], planner: Planner | None) -> dict[str, Any]:
    return {
        "policies": [policy.sha256 for policy in policies],
        "planner_sha256": None if planner is None else planner.sha256,
        "first_seed": scenario.first_seed,
        "episodes": scenario.episodes,
        "horizon": scenario.horizon,
        "versions": installed(),
    }


def _play(
    scenario: PolicyScenario,
    seeds: range,
    workers: int,
    ray: str | None,
    journal: Journal | None,
    on_episode: Callable[[Path, EpisodeResult], None] | None,
) -> dict[int, EpisodeResult]:
    runs = {} if journal is None else {seed: run for seed, run in journal.runs.items() if seed in seeds}
    if on_episode is not None:
        for seed, run in runs.items():
            on_episode(scenario.path_of(seed), run)
    left = [seed for seed in seeds if seed not in runs]
    for seed, run in run_episodes(partial(PolicyStage, scenario), PolicyStage.play, left, WorkerSettings(workers, ray)):
        runs[seed] = run
        if journal is not None:
            journal.add(run)
        if on_episode is not None:
            on_episode(scenario.path_of(seed), run)
    return runs

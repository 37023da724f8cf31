"""One zero-shot episode in simulation: the executor's run, the simulator's verdict, and why it failed."""

import contextlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from ocplanner.control.arm import Reading, WorkCell
from ocplanner.control.arm_program import HorizonReached
from ocplanner.control.executor import UNPLANNED_PHASES, Executor, PlanSource
from ocplanner.control.noisy_pose import NoisyPoseCell, PoseError
from ocplanner.control.pose_filter import FilteredArm
from ocplanner.control.settings import ControlSettings
from ocplanner.envs.environment import ManipulationEnv
from ocplanner.geometry.rotation import angle_between

_SLIPPED = 0.8  # rad: an object that has turned farther in the grip has slipped
_AT_THE_GOAL = 0.03  # m: an object that is nearer to where the plans end was only not let go of
_STUCK, _STUCK_STEPS = 0.03, 60  # m: an object that stayed within this horizontally over the last steps is stuck


@dataclass
class Trace:
    """What happened, step by step, for videos and for telling failures apart."""

    readings: list[Reading] = field(default_factory=list)
    phases: list[str] = field(default_factory=list)
    plans: list[tuple[int, np.ndarray]] = field(default_factory=list)
    objects: list[str] = field(default_factory=list)
    """Name of the active object."""

    def followed_plans(self) -> list[np.ndarray | None]:
        """The plan in force at each step, (H, 3) world, metres; None in phases that follow none."""
        plans, followed, current = dict(self.plans), [], None
        for step, phase in enumerate(self.phases):
            current = plans.get(step, current)
            followed.append(None if phase in UNPLANNED_PHASES else current)
        return followed


@dataclass(frozen=True)
class Episode:
    """The outcome of an episode.

    Attributes:
        seed: of the reset.
        success: the object is at the goal, and the follower itself ended the episode: by letting go, or by keeping
            the object up where the task wants that.
        steps: control steps used.
        failure: one of :data:`ocplanner.zero_shot.result.FAILURES`, or None.
        released_by: ``"follower"``, or None if it never let go (nor kept the object where that is the end).
        trace: the steps.
        failed_with: the active object when a task with several objects failed, or None.
    """

    seed: int
    success: bool
    steps: int
    failure: str | None
    released_by: str | None
    trace: Trace
    failed_with: str | None = None


def run_episode(
    env: ManipulationEnv,
    planner: PlanSource | Mapping[str, PlanSource],
    seed: int,
    settings: ControlSettings | None = None,
    *,
    observe: Callable[[ManipulationEnv], dict[str, np.ndarray]] = ManipulationEnv.observe,
    pose_error: PoseError = PoseError(),  # noqa: B008
    pose_filter: int = 1,
    on_step: Callable[[], None] | None = None,
) -> Episode:
    """Run one episode.

    Args:
        env: the arm before its task, observing as the planner was trained to.
        planner: anything with ``plan(images)``, for the task's first object; or one for each by the object's name, and
            of an object that several arms carry one for the part of each, see
            :attr:`ocplanner.envs.tasks.ObjectSpec.parts`. Objects without a planner are left alone.
        seed: of the reset, and of the noise of the objects' poses.
        settings: every number of the control laws.
        observe: takes the planner's pictures of the environment, (h, w, 3) uint8 by camera.
        pose_error: how wrong the object poses are that the arms grasp and follow by. The verdict stays exact.
        pose_filter: average those poses over so many control steps, see
            :class:`ocplanner.control.pose_filter.FilteredArm`; 1 for none.
        on_step: called after every control step (recording frames).
    """
    trace = Trace()

    def note(reading: Reading) -> None:
        trace.readings.append(reading)
        trace.phases.append(executor.progress.phase)
        trace.objects.append(executor.progress.spec.name)
        if on_step is not None:
            on_step()

    env.reset(seed)
    planners = planner if isinstance(planner, Mapping) else {env.task.object().name: planner}
    cell: WorkCell = env
    if pose_error != PoseError():
        cell = NoisyPoseCell(env, [spec.name for spec in env.task.objects], pose_error, seed)
    executor = Executor(
        cell,
        [spec for spec in env.task.objects if set(spec.parts) <= planners.keys()],
        planners,
        partial(observe, env),
        settings or ControlSettings(),
        env.horizon,
        sense=None
        if pose_filter == 1
        else partial(FilteredArm, steps=pose_filter, latency_steps=pose_error.latency_steps),
        on_step=note,
    )
    with contextlib.suppress(HorizonReached):
        executor.run()
    trace.plans = executor.plans
    success = executor.finished and env.success()
    failure = None if success else _why(env, executor, trace)
    return Episode(
        seed=seed,
        success=success,
        steps=executor.program.steps,
        failure=failure,
        released_by="follower" if executor.finished else None,
        trace=trace,
        failed_with=executor.progress.spec.name if failure is not None and len(env.task.objects) > 1 else None,
    )


def _why(env: ManipulationEnv, executor: Executor, trace: Trace) -> str:
    """The class of a failure; looks at contacts, which no decision does."""
    progress = executor.progress
    if executor.finished:
        return "not aligned"
    if progress.phase == "go":
        return "time-out"
    if progress.phase == "hand over":
        return "not handed over"
    if not progress.held_once:
        return "missed grasp"
    fell = progress.lost or progress.phase in ("recover", "grasp")
    if fell or not env.in_contact(progress.spec.name, progress.arm):
        return "lost grasp"
    now = executor.program.read()
    if progress.grip is not None:
        before = progress.grip.eef.rotation.T @ progress.grip.object.rotation
        if angle_between(before, now.eef.rotation.T @ now.object.rotation) > _SLIPPED:
            return "slip"
    goal = None if progress.follower is None else progress.follower.goal
    if goal is not None:
        return "not released" if np.linalg.norm(now.object.position - goal.position) < _AT_THE_GOAL else "not aligned"
    recent = np.array([reading.object.position[:2] for reading in trace.readings[-_STUCK_STEPS:]])
    return "stuck in transit" if np.ptp(recent, axis=0).max() < _STUCK else "time-out"

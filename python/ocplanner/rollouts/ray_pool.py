"""Episodes in actors of a Ray cluster."""

import os
import pickle
from typing import Any

from ocplanner.errors import ClusterError, OcplannerError
from ocplanner.rollouts.pool import EPISODE, Task, TaskResult
from ocplanner.rollouts.ray_cluster import connect
from ocplanner.rollouts.worker import limit_renderer_threads, worker_error
from ocplanner.versions import installed

_STARTS = 3
_ENVIRONMENT = ("MUJOCO_GL", "PYOPENGL_PLATFORM", "OCPLANNER_SIMD")
_EXACT = ("ocplanner", "robosuite", "mujoco", "numpy")


class RayPool:
    """Actors of one processor core each; see :class:`ocplanner.rollouts.pool.WorkerPool`.

    While the cluster has no room for an actor, the other actors do the work.

    Args:
        task: what each actor runs; it and the results must be picklable.
        workers: number of actors.
        address: see :func:`ocplanner.rollouts.ray_cluster.connect`.

    Raises:
        VersionError: Ray is not installed.
        ClusterError: no cluster answers at the address.
    """

    def __init__(self, task: Task, workers: int, address: str) -> None:
        self._ray, self._connected_here = connect(address, workers)
        self._task = self._ray.cloudpickle.dumps(task)
        self._environment = {name: os.environ[name] for name in _ENVIRONMENT if name in os.environ}
        self._actor: Any = self._ray.remote(num_cpus=1, max_restarts=0, max_task_retries=0)(_Worker)
        self._starting: dict[Any, Any] = {}
        self._idle: list[Any] = []
        self._busy: dict[Any, tuple[Any, int]] = {}
        self._failed_starts = 0
        for _ in range(workers):
            self._start_actor()

    def submit(self, seed: int) -> bool:
        """Start an episode on an idle actor."""
        if not self._idle:
            return False
        actor = self._idle.pop()
        self._busy[actor.run.remote(seed)] = (actor, seed)
        return True

    def wait(self) -> list[TaskResult]:
        """Wait until an episode has ended or an actor is ready.

        Raises:
            ClusterError: actors do not start, or start on a machine with other versions.
        """
        (reference, *_), _ = self._ray.wait([*self._starting, *self._busy], num_returns=1)
        if reference in self._starting:
            self._use_actor(reference)
            return []
        return [self._read(reference)]

    def close(self) -> None:
        """Stop the actors, and close the connection if this pool opened it."""
        for actor in (*self._starting.values(), *self._idle, *(actor for actor, _ in self._busy.values())):
            self._ray.kill(actor)
        if self._connected_here:
            self._ray.shutdown()

    def _start_actor(self) -> None:
        actor = self._actor.remote(self._task, self._environment)
        self._starting[actor.versions.remote()] = actor

    def _use_actor(self, reference: Any) -> None:
        actor = self._starting.pop(reference)
        try:
            theirs = self._ray.get(reference)
        except self._ray.exceptions.RayError as error:
            self._failed_starts += 1
            if self._failed_starts >= _STARTS:
                raise ClusterError(f"workers do not start on the Ray cluster: {error}") from error
            self._start_actor()
            return
        ours = installed()
        if differing := [name for name in _EXACT if theirs.get(name) != ours.get(name)]:
            self._ray.kill(actor)
            found = ", ".join(f"{name} {theirs.get(name)} instead of {ours.get(name)}" for name in differing)
            raise ClusterError(
                f"a machine of the Ray cluster has {found}: results would depend on where an episode runs; "
                "install the same versions on all machines"
            )
        self._failed_starts = 0
        self._idle.append(actor)

    def _read(self, reference: Any) -> TaskResult:
        actor, seed = self._busy.pop(reference)
        try:
            result: TaskResult = self._ray.get(reference)
        except self._ray.exceptions.RayTaskError as error:  # the result cannot be pickled
            return TaskResult(seed, error=worker_error(EPISODE.format(seed), error.cause))
        except self._ray.exceptions.RayError as error:
            self._ray.kill(actor)
            self._start_actor()
            return TaskResult(seed, crash=str(error))
        self._idle.append(actor)
        return result


class _Worker:
    """Runs in an actor."""

    def __init__(self, task: bytes, environment: dict[str, str]) -> None:
        # Before the task is unpickled, which may import mujoco.
        os.environ.update(environment)
        limit_renderer_threads()
        self._pickled = task
        self._tasks: list[Task] = []

    def versions(self) -> dict[str, str]:
        return installed()

    def run(self, seed: int) -> TaskResult:
        try:
            if not self._tasks:
                self._tasks.append(pickle.loads(self._pickled))  # noqa: S301 - written by the pool
            return TaskResult(seed, self._tasks[0].run(seed))
        except OcplannerError as error:
            return TaskResult(seed, error=error)
        except Exception as error:
            return TaskResult(seed, error=worker_error(EPISODE.format(seed), error))

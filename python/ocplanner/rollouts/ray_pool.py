"""Episodes in actors of a Ray cluster."""

import os
import pickle
from collections.abc import Callable
from typing import Any

from ocplanner.errors import ClusterError, OcplannerError
from ocplanner.rollouts.pool import Ended
from ocplanner.rollouts.ray_cluster import connect
from ocplanner.versions import installed

_STARTS = 3
_ENVIRONMENT = ("MUJOCO_GL", "PYOPENGL_PLATFORM", "OCPLANNER_SIMD")
_EXACT = ("ocplanner", "robosuite", "mujoco", "numpy")


class RayCrew:
    """Actors of one processor core each; see :class:`ocplanner.rollouts.pool.Crew`.

    An actor that the cluster has no room for yet gets no episode, so that the others do the work.

    Args:
        make: makes what an episode needs; picklable.
        episode: runs one episode; picklable, and so is its result.
        workers: actors.
        address: see :func:`ocplanner.rollouts.ray_cluster.connect`.

    Raises:
        VersionError: Ray is not installed.
        ClusterError: there is no cluster at the address.
    """

    def __init__(self, make: Callable[[], Any], episode: Callable[[Any, int], Any], workers: int, address: str) -> None:
        self._ray, self._connected_here = connect(address, workers)
        self._job = self._ray.cloudpickle.dumps((make, episode))
        self._environment = {name: os.environ[name] for name in _ENVIRONMENT if name in os.environ}
        self._actor: Any = self._ray.remote(num_cpus=1, max_restarts=0, max_task_retries=0)(_Worker)
        self._starting: dict[Any, Any] = {}
        self._idle: list[Any] = []
        self._busy: dict[Any, tuple[Any, int]] = {}
        self._failed_starts = 0
        for _ in range(workers):
            self._recruit()

    def hand_out(self, seed: int) -> bool:
        """Give an episode to an actor that is up and idle."""
        if not self._idle:
            return False
        actor = self._idle.pop()
        self._busy[actor.play.remote(seed)] = (actor, seed)
        return True

    def collect(self) -> list[Ended]:
        """Wait until an episode has ended or an actor is up.

        Raises:
            ClusterError: actors do not start, or on a machine with other versions.
        """
        (reference, *_), _ = self._ray.wait([*self._starting, *self._busy], num_returns=1)
        if reference in self._starting:
            self._welcome(reference)
            return []
        return [self._read(reference)]

    def close(self) -> None:
        """End the actors, and the connection if it was made for them."""
        for actor in (*self._starting.values(), *self._idle, *(actor for actor, _ in self._busy.values())):
            self._ray.kill(actor)
        if self._connected_here:
            self._ray.shutdown()

    def _recruit(self) -> None:
        actor = self._actor.remote(self._job, self._environment)
        self._starting[actor.versions.remote()] = actor

    def _welcome(self, reference: Any) -> None:
        actor = self._starting.pop(reference)
        try:
            theirs = self._ray.get(reference)
        except self._ray.exceptions.RayError as error:
            self._failed_starts += 1
            if self._failed_starts >= _STARTS:
                raise ClusterError(f"workers do not start on the Ray cluster: {error}") from error
            self._recruit()
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

    def _read(self, reference: Any) -> Ended:
        actor, seed = self._busy.pop(reference)
        try:
            kind, value = self._ray.get(reference)
        except self._ray.exceptions.RayError as error:
            self._ray.kill(actor)  # it may still be there: an error not on purpose ends a local worker, too
            self._recruit()
            return Ended(seed, death=str(error))
        self._idle.append(actor)
        return Ended(seed, error=value) if kind == "error" else Ended(seed, value)


class _Worker:
    """What runs in an actor."""

    def __init__(self, job: bytes, environment: dict[str, str]) -> None:
        # Before the job is read, which may import mujoco. Mesa's software renderer would start a thread a core.
        os.environ.update(environment)
        os.environ.setdefault("LP_NUM_THREADS", "1")
        self._job = job
        self._context: Any = None
        self._episode: Any = None

    def versions(self) -> dict[str, str]:
        return installed()

    def play(self, seed: int) -> tuple[str, Any]:
        try:
            if self._episode is None:
                make, episode = pickle.loads(self._job)  # noqa: S301 - written by the crew
                self._context, self._episode = make(), episode
            return "result", self._episode(self._context, seed)
        except OcplannerError as error:
            return "error", error

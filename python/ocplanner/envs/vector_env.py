"""A Gymnasium vector environment whose environments run in worker processes.

>>> import gymnasium, ocplanner                                                      # doctest: +SKIP
>>> envs = gymnasium.make_vec("ocplanner/Square-v0", num_envs=8, robot="UR5e", workers=4)   # doctest: +SKIP
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from typing import Any

import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space, concatenate, create_empty_array

from ocplanner.errors import InvalidValueError, ShapeError, UnknownNameError, WorkerError
from ocplanner.rollouts.worker import Worker, serve
from ocplanner.settings import require_seed

_TRIES = 3

Order = tuple[int, str, Any]
"""Which environment, which method of :class:`_Place`, and its argument."""


@dataclass
class _Episode:
    """What determines an environment's present state."""

    seed: int
    actions: list[np.ndarray] = field(default_factory=list)


class ProcessVectorEnv(VectorEnv[dict[str, np.ndarray], np.ndarray, np.ndarray]):
    """``num_envs`` copies of :class:`ocplanner.envs.gymnasium_env.GymnasiumEnv` in worker processes.

    The spaces are those of one environment, batched. Results depend only on seeds and actions, not on ``workers``. A
    dead worker is replaced; the new one replays its episodes from their seeds.

    :meth:`step` resets an environment whose episode has ended: it ignores the action and returns the first observation
    with reward 0 (``AutoresetMode.NEXT_STEP``, the default of Gymnasium's own vector environments). So the last
    observation of an episode is returned like any other, and a step costs a worker one physics step or one reset, never
    both.

    Args:
        num_envs: number of environments.
        task: task name.
        workers: number of processes, at most ``num_envs``; by default one for each processor core.
        render_mode: ``"rgb_array"`` or None.
        **options: as for :class:`ocplanner.envs.gymnasium_env.GymnasiumEnv`.

    Raises:
        InvalidValueError: ``num_envs`` or ``workers`` is not positive.
        UnknownNameError: a name is not known.
        WorkerError: a worker raised an unexpected exception, or died three times on the same call.
    """

    def __init__(
        self, num_envs: int, task: str, workers: int | None = None, render_mode: str | None = None, **options: Any
    ) -> None:
        workers = min(num_envs, os.cpu_count() or 1) if workers is None else min(workers, num_envs)
        if num_envs < 1 or workers < 1:
            raise InvalidValueError(f"num_envs and workers must be at least 1, not {num_envs} and {workers}")
        if render_mode not in (None, "rgb_array"):
            raise UnknownNameError("render mode", str(render_mode), ("rgb_array",))
        self.num_envs = num_envs
        self.render_mode = render_mode
        self.metadata = {"render_modes": ["rgb_array"], "render_fps": 20, "autoreset_mode": AutoresetMode.NEXT_STEP}
        self._options = {"task": task, "render_mode": render_mode, **options}
        self._episodes: list[_Episode | None] = [None] * num_envs
        self._draws: list[np.random.Generator] = [seeding.np_random()[0] for _ in range(num_envs)]
        self._over = np.zeros(num_envs, dtype=np.bool_)
        self._observations: list[Any] = [None] * num_envs
        self._workers = [Worker(_work, self._options) for _ in range(workers)]
        spaces = self._ask([(index, "spaces", None) for index in range(num_envs)])
        self.single_observation_space, self.single_action_space = spaces[0]
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Start an episode in every environment.

        Args:
            seed: the seed of the first environment, from which the others count on; or one for each. A seed fixes an
                environment's episode and the following ones without a seed.
            options: ``{"reset_mask": (num_envs,) bool}`` restarts only the chosen ones.

        Raises:
            ShapeError: the seeds or the mask do not have one entry for each environment.
        """
        seeds = [seed + index for index in range(self.num_envs)] if isinstance(seed, int | np.integer) else seed
        for each in seeds or ():
            if each is not None:
                require_seed(each)
        mask = np.asarray((options or {}).get("reset_mask", np.ones(self.num_envs, dtype=np.bool_)))
        if mask.shape != (self.num_envs,) or mask.dtype != np.bool_:
            raise ShapeError(f"reset_mask must be ({self.num_envs},) bool, not {mask.shape} {mask.dtype}")
        if seeds is not None and len(seeds) != self.num_envs:
            raise ShapeError(f"{self.num_envs} environments need {self.num_envs} seeds, not {len(seeds)}")
        indices = [int(index) for index in np.flatnonzero(mask)]
        answers = self._ask([self._begin(index, None if seeds is None else seeds[index]) for index in indices])
        infos: dict[str, Any] = {}
        for index, (observation, info) in zip(indices, answers):
            self._observations[index], self._over[index] = observation, False
            infos = self._add_info(infos, info, index)
        return self._batch(), infos

    def step(
        self, actions: np.ndarray
    ) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Advance every environment 0.05 s, or reset it if its episode has ended.

        Args:
            actions: (num_envs, 7) in [-1, 1].

        Raises:
            ShapeError: the actions have a wrong shape.
            InvalidValueError: an action is not finite, or an environment has not been reset.
        """
        actions = np.array(actions, dtype=np.float32)
        if actions.shape != self.action_space.shape:
            raise ShapeError(f"actions have shape {actions.shape}, expected {self.action_space.shape}")
        if not np.isfinite(actions).all():
            raise InvalidValueError("actions must be finite; some are NaN or infinite")
        if any(episode is None for episode in self._episodes):
            raise InvalidValueError("an environment has no episode yet: call reset() before step()")
        fresh = self._over.copy()
        orders = [
            self._begin(index, None) if fresh[index] else (index, "step", action)
            for index, action in enumerate(actions)
        ]
        answers = self._ask(orders)
        rewards = np.zeros(self.num_envs)
        terminations, truncations = np.zeros((2, self.num_envs), dtype=np.bool_)
        infos: dict[str, Any] = {}
        for index, answer in enumerate(answers):
            if fresh[index]:
                self._observations[index], info = answer
            else:
                self._observations[index], rewards[index], terminations[index], truncations[index], info = answer
            infos = self._add_info(infos, info, index)
        self._over = terminations | truncations
        return self._batch(), rewards, terminations, truncations, infos

    def render(self) -> tuple[np.ndarray, ...] | None:
        """A (360, 480, 3) uint8 picture of each environment; None without a render mode."""
        if self.render_mode is None:
            return None
        return tuple(self._ask([(index, "render", None) for index in range(self.num_envs)]))

    def close_extras(self, *, busy: bool = False) -> None:
        """Stop the worker processes."""
        for worker in self.__dict__.pop("_workers", []):
            worker.stop(busy=busy)

    def _begin(self, index: int, seed: int | None) -> Order:
        """The order for a new episode. Seeds are drawn here, as a single environment draws them; workers have none."""
        if seed is not None:
            self._draws[index] = seeding.np_random(int(seed))[0]
        return index, "begin", int(self._draws[index].integers(2**31)) if seed is None else int(seed)

    def _batch(self) -> dict[str, np.ndarray]:
        empty = create_empty_array(self.single_observation_space, self.num_envs)
        return concatenate(self.single_observation_space, self._observations, empty)  # pyright: ignore

    def _ask(self, orders: Sequence[Order]) -> list[Any]:
        """Have the workers carry out orders, and record what restores their environments if a worker dies."""
        if self.closed:
            raise InvalidValueError("the vector environment is closed; make another one")
        shares: dict[int, list[Order]] = {}
        for order in orders:
            shares.setdefault(order[0] % len(self._workers), []).append(order)
        answers: dict[int, Any] = {}
        try:
            for number, share in shares.items():
                self._workers[number].send(share)
            for number, share in shares.items():
                answers.update(zip((order[0] for order in share), self._answers(number, share)))
        except BaseException:
            # The other workers' answers are still in the pipes, so no further question can be asked.
            self.close(busy=True)
            raise
        for index, verb, argument in orders:
            if verb == "begin":
                self._episodes[index] = _Episode(argument)
            elif verb == "step" and (episode := self._episodes[index]) is not None:
                episode.actions.append(argument)
        return [answers[order[0]] for order in orders]

    def _answers(self, number: int, share: list[Order]) -> list[Any]:
        for _ in range(_TRIES):
            try:
                return self._workers[number].receive()[-len(share) :]
            except EOFError:
                self._workers[number].join()
                self._workers[number] = Worker(_work, self._options)
                self._workers[number].send([*self._history(number), *share])
        raise WorkerError(
            f"a worker of {self.num_envs} environments died {_TRIES} times on the same call; if it never started, put "
            "the code of your script under 'if __name__ == \"__main__\":', because workers import the script"
        )

    def _history(self, number: int) -> list[Order]:
        indices = range(number, self.num_envs, len(self._workers))
        return [(index, "restore", episode) for index in indices if (episode := self._episodes[index]) is not None]


class _Place:
    """One environment in a worker."""

    def __init__(self, options: dict[str, Any]) -> None:
        from ocplanner.envs.gymnasium_env import GymnasiumEnv

        self.env = GymnasiumEnv(**options)

    def spaces(self, _: None) -> tuple[Any, Any]:
        return self.env.observation_space, self.env.action_space

    def begin(self, seed: int) -> tuple[Any, dict[str, Any]]:
        return self.env.reset(seed=seed)

    def step(self, action: np.ndarray) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        return self.env.step(action)

    def restore(self, episode: _Episode) -> None:
        """Replay an episode without observing it."""
        self.env.env.reset(episode.seed)
        for action in episode.actions:
            self.env.env.step(action)

    def render(self, _: None) -> np.ndarray | None:
        return self.env.render()


def _work(channel: Connection, options: dict[str, Any]) -> None:
    places: dict[int, _Place] = {}

    def carry_out(orders: list[Order]) -> list[Any]:
        answers = []
        for index, verb, argument in orders:
            if index not in places:
                places[index] = _Place(options)
            answers.append(getattr(places[index], verb)(argument))
        return answers

    try:
        serve(channel, carry_out, "a worker of the vector environment")
    finally:
        for place in places.values():
            place.env.close()

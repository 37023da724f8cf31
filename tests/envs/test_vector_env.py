"""Many environments at once: Gymnasium's interface, whatever happens to the workers."""

import os
import signal
from collections.abc import Iterator
from contextlib import closing, contextmanager
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from ocplanner.envs.vector_env import ProcessVectorEnv
from ocplanner.errors import InvalidValueError, ShapeError, UnknownNameError, WorkerError

OPTIONS: dict[str, Any] = {"observe": "masked", "image_size": 24, "horizon": 5}
STEPS = 9


def make(mode: str, num_envs: int = 3, **options: Any) -> VectorEnv:
    return gymnasium.make_vec("ocplanner/Lift-v0", num_envs, mode, **{**OPTIONS, **options})


def actions(envs: VectorEnv) -> Iterator[np.ndarray]:
    rng = np.random.default_rng(0)
    for _ in range(STEPS):
        yield rng.uniform(-1, 1, envs.action_space.shape).astype(np.float32)


def play(envs: VectorEnv, kill_before: tuple[int, ...] = ()) -> list[tuple[Any, ...]]:
    """Everything that comes out of two episodes of five steps; the last environment keeps its own seeds."""
    seeds = [7, 7, None][: envs.num_envs]
    seen: list[tuple[Any, ...]] = [envs.reset(seed=11), envs.reset(seed=seeds)]
    for number, action in enumerate(actions(envs)):
        if number in kill_before:
            worker = envs.unwrapped._workers[0]
            os.kill(worker.pid, signal.SIGKILL)
        seen.append(envs.step(action))
    return seen


def flat(value: Any) -> list[Any]:
    if isinstance(value, dict):
        return [item for key in sorted(value) for item in (key, *flat(value[key]))]
    return [item for part in value for item in flat(part)] if isinstance(value, tuple | list) else [value]


def assert_same(one: list[Any], other: list[Any]) -> None:
    one, other = flat(one), flat(other)
    assert len(one) == len(other)
    for a, b in zip(one, other):
        np.testing.assert_array_equal(a, b)


@contextmanager
def no_process_left() -> Iterator[list[int]]:
    """Ids of processes that must be gone afterwards."""
    pids: list[int] = []
    yield pids
    assert pids
    assert not [pid for pid in pids if os.path.exists(f"/proc/{pid}")]


@pytest.fixture(scope="module")
def undisturbed() -> list[tuple[Any, ...]]:
    with closing(make("sync")) as envs:
        return play(envs)


@pytest.mark.parametrize("workers", [1, 2])
def test_the_workers_give_what_gymnasium_gives_one_after_the_other(undisturbed, workers):
    with no_process_left() as pids, closing(make("vector_entry_point", workers=workers)) as envs:
        pids += [worker.pid for worker in envs.unwrapped._workers]
        assert len(pids) == workers
        assert_same(play(envs), undisturbed)
    rewards, terminations, truncations = (np.array([step[part] for step in undisturbed[2:]]) for part in (1, 2, 3))
    assert truncations.sum(1).tolist() == [0, 0, 0, 0, 3, 0, 0, 0, 0]
    assert not rewards.any()
    assert not terminations.any()


def test_gymnasiums_own_processes_give_the_same(undisturbed):
    with closing(make("async", vector_kwargs={"context": "spawn"})) as envs:
        assert_same(play(envs), undisturbed)


def test_killed_workers_change_nothing(undisturbed):
    """Killed in the first episode, before the reset after it, and in the second, which the new process never began."""
    with no_process_left() as pids, closing(make("vector_entry_point", workers=2)) as envs:
        pids.append(envs.unwrapped._workers[0].pid)
        assert_same(play(envs, kill_before=(2, 5, 8)), undisturbed)
        assert envs.unwrapped._workers[0].pid != pids[0]
        pids += [worker.pid for worker in envs.unwrapped._workers]


def test_spaces_and_what_learners_read():
    with closing(make("vector_entry_point", num_envs=2, workers=8, render_mode="rgb_array")) as envs:
        single = gymnasium.make("ocplanner/Lift-v0", **OPTIONS)
        assert envs.single_observation_space == single.observation_space
        assert envs.single_action_space == single.action_space
        assert envs.observation_space == batch_space(single.observation_space, 2)
        assert envs.action_space == batch_space(single.action_space, 2)
        single.close()
        assert envs.metadata["autoreset_mode"] == AutoresetMode.NEXT_STEP
        assert len(envs.unwrapped._workers) == 2
        with pytest.raises(InvalidValueError, match=r"call reset\(\)"):
            envs.step(envs.action_space.sample())
        observations, infos = envs.reset(seed=3)
        assert observations in envs.observation_space
        assert infos["success"].tolist() == [False, False]
        assert infos["_success"].tolist() == [True, True]
        first, second = envs.render()
        assert first.shape == (360, 480, 3)
        assert (first != second).any()
        moved = envs.step(envs.action_space.sample())[0]
        again, infos = envs.reset(seed=[3, None], options={"reset_mask": np.array([True, False])})
        assert infos["_success"].tolist() == [True, False]
        for key, value in again.items():
            np.testing.assert_array_equal(value[0], observations[key][0])
            np.testing.assert_array_equal(value[1], moved[key][1])
        for wrong, error, message in (
            ({"seed": [1, 2, 3]}, ShapeError, "2 seeds, not 3"),
            ({"options": {"reset_mask": np.array([1, 0])}}, ShapeError, "reset_mask"),
        ):
            with pytest.raises(error, match=message):
                envs.reset(**wrong)
        with pytest.raises(ShapeError, match=r"\(3, 7\), expected \(2, 7\)"):
            envs.step(np.zeros((3, 7)))
        with pytest.raises(InvalidValueError, match="finite"):
            envs.step(np.full((2, 7), np.nan))
    with pytest.raises(InvalidValueError, match="closed"):
        envs.reset()


def test_seeds_follow_from_the_first():
    with closing(make("vector_entry_point", num_envs=1, cameras=())) as envs:
        follow = [envs.reset(seed=seed)[0]["object_position"].tolist() for seed in (5, None, None, 5, None)]
        assert envs.render() is None
    assert follow[:2] == follow[3:]
    assert len({str(position) for position in follow}) == 3


@pytest.mark.parametrize(
    ("wrong", "error", "message"),
    [
        ({"robot": "Sawyr"}, UnknownNameError, "known: .*Sawyer"),
        ({"render_mode": "human"}, UnknownNameError, "rgb_array"),
        ({"workers": 0}, InvalidValueError, "at least 1"),
        ({"nonsense": 1}, WorkerError, "a worker of the vector environment failed: TypeError: .*nonsense"),
    ],
)
def test_bad_arguments_are_told(wrong, error, message):
    with pytest.raises(error, match=message):
        make("vector_entry_point", **wrong)


def test_a_call_that_always_kills_is_given_up(monkeypatch):
    envs = ProcessVectorEnv(1, "Lift", cameras=())
    receive = type(envs._workers[0]).receive

    def killing(worker):
        os.kill(worker.pid, signal.SIGKILL)
        while True:  # an answer may have been on its way already; in the end the pipe is found broken
            receive(worker)

    with no_process_left() as pids:
        pids.append(envs._workers[0].pid)
        monkeypatch.setattr(type(envs._workers[0]), "receive", killing)
        with pytest.raises(WorkerError, match="died 3 times"):
            envs.reset(seed=0)
    assert envs.closed

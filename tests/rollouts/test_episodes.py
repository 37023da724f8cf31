import os
import signal
from functools import partial
from pathlib import Path

import pytest

from ocplanner.errors import InvalidValueError, MismatchError, WorkerError
from ocplanner.rollouts.episodes import run_episodes


def make() -> int:
    return 7


def episode(context: int, seed: int) -> int:
    return context * seed


def dies_once(folder: Path, context: int, seed: int) -> int:
    """The first try of seed 2 kills its process; later ones find the trace of that."""
    mark = folder / "died"
    if seed == 2 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return context * seed


def dies_always(context: int, seed: int) -> int:
    os.kill(os.getpid(), signal.SIGKILL)
    return 0


def refuses(context: int, seed: int) -> int:
    raise MismatchError("no")


@pytest.mark.parametrize("workers", [1, 2])
def test_results_do_not_depend_on_the_workers(workers):
    assert dict(run_episodes(make, episode, range(5), workers)) == {seed: 7 * seed for seed in range(5)}


def test_a_crashed_worker_is_replaced_and_its_episode_redone(tmp_path):
    results = dict(run_episodes(make, partial(dies_once, tmp_path), range(4), 2))
    assert results == {seed: 7 * seed for seed in range(4)}
    assert (tmp_path / "died").exists()


@pytest.mark.parametrize("workers", [0, -3])
def test_there_must_be_a_worker(workers):
    with pytest.raises(InvalidValueError, match=f"workers is {workers}"):
        list(run_episodes(make, episode, [0], workers))


def test_an_episode_that_always_kills_is_given_up():
    with pytest.raises(WorkerError, match="seed 0"):
        list(run_episodes(make, dies_always, [0], 2))


@pytest.mark.parametrize("workers", [1, 2])
def test_an_error_of_an_episode_comes_through(workers):
    with pytest.raises(MismatchError):
        list(run_episodes(make, refuses, [0, 1], workers))

import os
import signal
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from ocplanner.errors import InvalidValueError, MismatchError, WorkerError
from ocplanner.rollouts.episodes import run_episodes
from ocplanner.rollouts.settings import WorkerSettings

TWO = WorkerSettings(workers=2)


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


def fails(folder: Path, context: int, seed: int) -> int:
    """Raises what no episode should, and leaves a trace of every try."""
    (folder / f"{seed}-{len(list(folder.iterdir()))}").touch()
    return {}["a mistake"]


def keeps_open(context: int, seed: int) -> Any:
    """A result that cannot be pickled."""
    return open(os.devnull)


def no_context() -> None:
    raise ZeroDivisionError("a mistake")


def renderer_threads(context: int, seed: int) -> str | None:
    return os.environ.get("LP_NUM_THREADS")


@pytest.mark.parametrize("workers", [1, 2])
def test_results_do_not_depend_on_the_workers(workers):
    results = dict(run_episodes(make, episode, range(5), WorkerSettings(workers)))
    assert results == {seed: 7 * seed for seed in range(5)}


def test_a_crashed_worker_is_replaced_and_its_episode_redone(tmp_path):
    results = dict(run_episodes(make, partial(dies_once, tmp_path), range(4), TWO))
    assert results == {seed: 7 * seed for seed in range(4)}
    assert (tmp_path / "died").exists()


@pytest.mark.parametrize("workers", [0, -3])
def test_there_must_be_a_worker(workers):
    with pytest.raises(InvalidValueError, match=f"workers is {workers}"):
        WorkerSettings(workers)


def test_an_episode_that_always_kills_is_given_up():
    with pytest.raises(WorkerError, match="seed 0 killed its worker 3 times"):
        list(run_episodes(make, dies_always, [0], TWO))


@pytest.mark.parametrize("workers", [1, 2])
def test_an_error_of_an_episode_comes_through(workers):
    with pytest.raises(MismatchError):
        list(run_episodes(make, refuses, [0, 1], WorkerSettings(workers)))


def test_an_unexpected_exception_of_a_worker_is_reported_once_with_its_traceback(tmp_path, capfd):
    with pytest.raises(WorkerError) as caught:
        list(run_episodes(make, partial(fails, tmp_path), [4], TWO))
    assert str(caught.value) == "the episode of seed 4 failed: KeyError: 'a mistake'"
    assert len(list(tmp_path.iterdir())) == 1
    assert "in fails\n" in caught.value.__notes__[0]
    assert capfd.readouterr().err == ""


def test_an_unexpected_exception_in_this_process_is_itself(tmp_path):
    with pytest.raises(KeyError, match="a mistake"):
        list(run_episodes(make, partial(fails, tmp_path), [4]))


@pytest.mark.parametrize(("makes", "plays"), [(no_context, episode), (make, keeps_open)])
def test_neither_a_failed_start_nor_an_unpicklable_result_is_a_crash(makes, plays):
    with pytest.raises(WorkerError, match=r"seed 3 failed: (ZeroDivisionError: a mistake|TypeError: cannot pickle)"):
        list(run_episodes(makes, plays, [3], TWO))


@pytest.mark.parametrize(("chosen", "used"), [(None, "1"), ("3", "3")])
def test_the_software_renderer_of_a_worker_uses_one_thread_unless_told_otherwise(monkeypatch, chosen, used):
    monkeypatch.delenv("LP_NUM_THREADS", raising=False)
    if chosen is not None:
        monkeypatch.setenv("LP_NUM_THREADS", chosen)
    assert dict(run_episodes(make, renderer_threads, [0], TWO)) == {0: used}

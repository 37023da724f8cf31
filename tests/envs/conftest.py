"""Environments are costly to make: each arm's is made once and shared by the tests of a process."""

import functools
from collections.abc import Callable, Iterator

import pytest

from ocplanner.envs import ManipulationEnv, make_env


@pytest.fixture(scope="session")
def shared_env() -> Iterator[Callable[..., ManipulationEnv]]:
    """``shared_env("Square", "Panda", visual="fast")``: an environment to reset, not to close."""
    made = []

    @functools.cache
    def make(task: str = "Square", robot: str = "Panda", visual: str = "fast") -> ManipulationEnv:
        made.append(make_env(task, robot, visual=visual))
        return made[-1]

    yield make
    for env in made:
        env.close()

"""Timing several implementations of one job against each other."""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

_FEWEST_ROUNDS = 15
_WARM_UPS = 3


@dataclass(frozen=True)
class Timing:
    """Seconds of one call: the median and the quartiles around it."""

    median: float
    quartiles: tuple[float, float]
    rounds: int


def interleaved(
    sides: dict[str, Callable[[], object]], seconds: float, *, repeat: int = 1, pause: float = 0.0, seed: int = 0
) -> dict[str, Timing]:
    """Let the sides take turns, in a new random order each round, so that any disturbance of the machine hits them all.

    Args:
        sides: name -> what to time.
        seconds: how long to make rounds; at least 15 are made.
        repeat: calls timed together, for calls too short for the clock. Figures are for one call.
        pause: seconds of sleep before each timing, in which another side's spinning threads come to rest.
        seed: seed of the order.
    """
    for act in sides.values():
        for _ in range(_WARM_UPS):
            act()
    rng = np.random.default_rng(seed)
    times: dict[str, list[float]] = {name: [] for name in sides}
    end = time.perf_counter() + seconds
    rounds = 0
    while rounds < _FEWEST_ROUNDS or time.perf_counter() < end:
        for name in rng.permutation(list(sides)):
            act = sides[name]
            if pause:
                time.sleep(pause)
            start = time.perf_counter()
            for _ in range(repeat):
                act()
            times[name].append((time.perf_counter() - start) / repeat)
        rounds += 1
    return {
        name: Timing(float(np.median(values)), tuple(np.quantile(values, (0.25, 0.75)).tolist()), rounds)
        for name, values in times.items()
    }

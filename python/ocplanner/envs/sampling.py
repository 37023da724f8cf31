"""robosuite's observables advanced over a whole control step at once.

Users who attach the native loop to a robosuite environment of their own need it for the observations of ``step``. While
robosuite updates every observable in every physics substep, each is measured only once in its sampling period. Here the
substeps with a measurement are found first, and the simulation runs from one to the next.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

from robosuite.utils.observables import NO_DELAY


class _Schedule(NamedTuple):
    """One observable's updates over several substeps."""

    samples: tuple[int, ...]
    """The substeps, counted from 1, with a measurement."""
    time_since_last_sample: float
    sampled: bool
    regular: bool
    """Whether robosuite would not warn."""


def advance_observables(env: Any, advance: Callable[[int], object], substeps: int) -> None:
    """Run physics substeps and leave the observables of an environment as robosuite's own loop would.

    Args:
        env: a robosuite environment.
        advance: runs that many substeps of its physics.
        substeps: how many.
    """
    observables = [observable for observable in env._observables.values() if observable._enabled]
    step = env.model_timestep
    schedules = [
        _schedule(
            observable._time_since_last_sample,
            observable._sampled,
            observable._sampling_timestep,
            observable._current_delay,
            step,
            substeps,
        )
        for observable in observables
    ]
    plain = all(observable._delayer is NO_DELAY and observable._current_delay == 0.0 for observable in observables)
    if not plain or not all(schedule.regular for schedule in schedules):
        for _ in range(substeps):
            advance(1)
            env._update_observables()
        return

    done = 0
    for substep in sorted({substep for schedule in set(schedules) for substep in schedule.samples}):
        advance(substep - done)
        done = substep
        for observable, schedule in zip(observables, schedules):
            if substep in schedule.samples:
                observable.update(timestep=0.0, obs_cache=env._obs_cache, force=True)
    advance(substeps - done)
    for observable, schedule in zip(observables, schedules):
        observable._time_since_last_sample = schedule.time_since_last_sample
        observable._sampled = schedule.sampled


@lru_cache(maxsize=1024)
def _schedule(
    time_since_last_sample: float, sampled: bool, period: float, delay: float, step: float, substeps: int
) -> _Schedule:
    """What ``Observable.update`` would do in each substep, with the same floating-point sums."""
    samples = []
    regular = True
    for substep in range(1, substeps + 1):
        time_since_last_sample += step
        if not sampled and period - delay >= time_since_last_sample:
            samples.append(substep)
            sampled = True
        if time_since_last_sample >= period:
            regular &= sampled
            time_since_last_sample %= period
            sampled = False
    return _Schedule(tuple(samples), time_since_last_sample, sampled, regular)

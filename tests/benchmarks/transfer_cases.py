"""Whole zero-shot episodes: the grasp, the planner's pictures every fourth step, the plans, the release.

A committed planner drives a Sawyer on Square; it was trained on masked pictures in the ``fast`` preset.
"""

import os
import time
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from sim_measured import SimMeasured
from turns import taking_turns

from ocplanner.files.records.episode import EpisodeResult
from ocplanner.rollouts.episodes import run_episodes
from ocplanner.rollouts.settings import WorkerSettings
from ocplanner.zero_shot.settings import TransferConfig
from ocplanner.zero_shot.setup import EpisodeRunner, TransferSetup

_PLANNER = Path("results/planners/square_masked_h20_pose_0.safetensors")
_ROBOT = "Sawyer"
_FIRST_SEED = 20_000


class Episodes:
    """Plays episodes of one transfer."""

    def __init__(self, setup: TransferSetup) -> None:
        self._runner = EpisodeRunner(setup)

    def prepare(self, index: int) -> None:
        """Nothing: the reset is part of an episode."""

    def act(self, index: int) -> EpisodeResult:
        """One whole episode."""
        return self._runner.play(_FIRST_SEED + index)


def whole_episode(episodes: int) -> SimMeasured:
    """Everything on, against robosuite's control loop and pictures around the same planner.

    The planner was not trained on the stock pictures, so the two sides' episodes need not be equally long: the rates of
    control steps are in the row too.
    """
    ours = TransferSetup.of(_PLANNER, _ROBOT)
    config = TransferConfig(visual="stock", allow_mismatch=True, control_loop="stock")
    stock = TransferSetup.of(_PLANNER, _ROBOT, config)
    played = taking_turns({"ours": partial(Episodes, ours), "robosuite": partial(Episodes, stock)}, episodes)
    seconds = {name: float(np.mean([turn.wall for turn in turns])) for name, turns in played.items()}
    steps = {name: float(np.mean([turn.value.steps for turn in turns])) for name, turns in played.items()}
    a_step = {name: seconds[name] / steps[name] for name in played}
    return SimMeasured(
        seconds,
        "s an episode",
        f"mean of the wall clock over {episodes} episodes",
        {
            "steps": steps,
            "successes": {name: sum(turn.value.success for turn in turns) for name, turns in played.items()},
            "ratio_a_control_step": {"robosuite": round(a_step["robosuite"] / a_step["ours"], 2)},
            "minutes_of_100_episodes_extrapolated": {
                name: round(100 * value / 60, 2) for name, value in seconds.items()
            },
        },
    )


class _Span(NamedTuple):
    process: int
    start: float
    end: float
    processor: float
    steps: int


def two_workers(episodes: int, rounds: int = 2) -> SimMeasured:
    """Control steps of two worker processes against one, both through :func:`run_episodes`, in turns.

    A worker's start and first episode (OpenGL, caches) do not count; the wait for the last episode does. Beside it
    stands what the processor time of all threads would give if each worker had a core to itself: other processes
    disturb that less.
    """
    make = partial(EpisodeRunner, TransferSetup.of(_PLANNER, _ROBOT))
    seconds: dict[str, list[float]] = {"ours": [], "one worker": []}
    processor: dict[str, list[float]] = {"ours": [], "one worker": []}
    for _ in range(rounds):
        for name, workers in (("one worker", 1), ("ours", 2)):
            seeds = range(_FIRST_SEED, _FIRST_SEED + episodes)
            spans = [span for _, span in run_episodes(make, _span, seeds, WorkerSettings(workers))]
            seconds[name].append(_seconds_a_step(spans))
            processor[name].append(_processor_seconds_a_step(spans))
    return SimMeasured(
        {name: float(np.mean(values)) for name, values in seconds.items()},
        "control steps/s",
        f"wall clock of {rounds} times {episodes} episodes",
        {"processor_time_ratio": {"one worker": round(2 * sum(processor["one worker"]) / sum(processor["ours"]), 2)}},
    )


def _span(runner: EpisodeRunner, seed: int) -> _Span:
    start = time.monotonic()  # the same clock in all processes
    processor = time.process_time()
    run = runner.play(seed)
    return _Span(os.getpid(), start, time.monotonic(), time.process_time() - processor, run.steps)


def _seconds_a_step(spans: list[_Span]) -> float:
    counted = _warm(spans)
    duration = max(span.end for span in counted) - min(span.start for span in counted)
    return duration / sum(span.steps for span in counted)


def _processor_seconds_a_step(spans: list[_Span]) -> float:
    counted = _warm(spans)
    return sum(span.processor for span in counted) / sum(span.steps for span in counted)


def _warm(spans: list[_Span]) -> list[_Span]:
    """All but the first episode of each process."""
    first = {span.process: min(other.start for other in spans if other.process == span.process) for span in spans}
    return [span for span in spans if span.start > first[span.process]]

"""Timing sides that cannot share a process because each needs OpenGL to itself: each gets one, and they take turns."""

import multiprocessing
import time
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any, Protocol

import numpy as np


class Player(Protocol):
    """One side, made in its own process."""

    def prepare(self, index: int) -> None:
        """Do what turn ``index`` needs before it is timed."""
        ...

    def act(self, index: int) -> Any:
        """Do what is timed. The result must pickle."""
        ...


@dataclass(frozen=True)
class Turn:
    """One timed call: wall-clock seconds, processor seconds of all threads, and the call's result."""

    wall: float
    processor: float
    value: Any


def taking_turns(
    sides: dict[str, Callable[[], Player]], turns: int, calls: int = 1, seed: int = 0
) -> dict[str, list[Turn]]:
    """Let the sides take ``turns`` turns of ``calls`` calls, one side at a time, in a new random order each round.

    Args:
        sides: name -> what creates the player; picklable.
        turns: turns per side. One more comes first and is not counted.
        calls: calls per turn. At the start of a turn a side must fill the processor's caches again.
        seed: seed of the order.

    Returns:
        Name -> the calls in order, with the same indices for all sides.
    """
    spawn = multiprocessing.get_context("spawn")
    channels: dict[str, Connection] = {}
    processes = []
    for name, make in sides.items():
        channels[name], theirs = spawn.Pipe()
        processes.append(spawn.Process(target=_play, args=(theirs, make), daemon=True))
        processes[-1].start()
        theirs.close()
    rng = np.random.default_rng(seed)
    played: dict[str, list[Turn]] = {name: [] for name in sides}
    try:
        for turn in range(-1, turns):
            indices = range(max(turn, 0) * calls, (max(turn, 0) + 1) * calls)
            for name in rng.permutation(list(sides)):
                channels[name].send(indices)
                done = channels[name].recv()
                played[name] += done if turn >= 0 else []
    finally:
        for channel, process in zip(channels.values(), processes):
            channel.close()
            process.join()
    return played


def _play(channel: Connection, make: Callable[[], Player]) -> None:
    player = make()
    while True:
        try:
            indices = channel.recv()
        except EOFError:
            return
        channel.send([_timed(player, index) for index in indices])


def _timed(player: Player, index: int) -> Turn:
    player.prepare(index)
    wall, processor = time.perf_counter(), time.process_time()
    value = player.act(index)
    return Turn(time.perf_counter() - wall, time.process_time() - processor, value)

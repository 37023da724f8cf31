"""What a transfer gives: episodes one by one, the success rate, and what it takes to run it again."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import TypeAlias

from ocplanner.files.records.episode import EpisodeResult
from ocplanner.files.records.transfer import MatrixRecord, TransferRecord, read_transfer, read_transfers
from ocplanner.rollouts.intervals import wilson
from ocplanner.zero_shot.settings import TransferConfig

TransferResult: TypeAlias = TransferRecord[TransferConfig]
Matrix: TypeAlias = MatrixRecord[TransferConfig]

FAILURES = (
    "missed grasp",
    "lost grasp",
    "not handed over",
    "slip",
    "stuck in transit",
    "not aligned",
    "not released",
    "time-out",
)
"""The classes of failed episodes, in the order in which an episode meets them."""


def with_episodes(result: TransferResult, runs: Iterable[EpisodeResult]) -> TransferResult:
    """A result with these episodes and the interval of their success rate."""
    runs = tuple(runs)
    return replace(result, runs=runs, interval=wilson(sum(run.success for run in runs), len(runs)))


def read_result(path: str | Path) -> TransferResult:
    """Read one result file, as :func:`ocplanner.files.records.transfer.read_transfer` does."""
    return read_transfer(path, TransferConfig)


def read_results(path: str | Path) -> tuple[TransferResult, ...]:
    """Read a result file or the cells of a matrix, as :func:`ocplanner.files.records.transfer.read_transfers` does."""
    return read_transfers(path, TransferConfig)

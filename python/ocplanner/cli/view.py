"""``ocplanner view``."""

import contextlib
import shlex
import sys
import threading
from dataclasses import dataclass, field
from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from ocplanner.errors import MismatchError, ResultFileError
from ocplanner.rollouts.settings import FIRST_EVALUATION_SEED
from ocplanner.zero_shot.settings import TransferConfig

if TYPE_CHECKING:
    from ocplanner.files.records.episode import EpisodeResult
    from ocplanner.report.viewer import Playback
    from ocplanner.zero_shot.result import TransferResult


@dataclass(frozen=True)
class View:
    """Show a zero-shot episode in three dimensions, in the browser: robot, objects, planned and achieved path, time.

    Given a planner file, it runs an episode. Given a result of `ocplanner transfer`, it runs one of its episodes again
    under the result's own conditions; a note says if the episode ends differently. Needs viser: pip install
    'ocplanner[viewer]'. Ctrl-C ends it.
    """

    source: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="PLANNER-or-RESULT")]
    """Planner file (.safetensors) or the run folder that it is in, or result file of `ocplanner transfer` (.json)."""
    planner: tuple[Path, ...] = ()
    """The planner file of a result, or those of all its task's objects. Default: the files that the result names."""
    seed: int | None = None
    """Seed of the episode. Default: 10000; for a result its first failure, if any, else its first episode."""
    robot: str = "Sawyer"
    """The arm; ignored for a result, which names its own."""
    config: Annotated[TransferConfig, tyro.conf.OmitArgPrefixes] = field(default_factory=TransferConfig)
    """Ignored for a result, which states its own conditions."""
    host: str = "127.0.0.1"
    """Address to listen on; 0.0.0.0 lets other machines look, too."""
    port: int = 8080
    """Port to listen on; 0 takes any free one."""

    def run(self) -> None:
        """Record the episode, say where it is shown, and serve until interrupted."""
        from ocplanner.report.viewer import Viewer, load_viser

        load_viser()  # an error here must come before the episode
        playback = self.playback()
        with Viewer(playback, self.host, self.port) as viewer:
            sys.stdout.write(f"{playback.title}: {playback.outcome}\n{viewer.address} (Ctrl-C ends it)\n")
            sys.stdout.flush()
            with contextlib.suppress(KeyboardInterrupt):
                threading.Event().wait()

    def playback(self) -> "Playback":
        """The episode to show.

        Raises:
            ResultFileError: the result is damaged, or does not name its planner.
            MismatchError: it is of another planner, or of no episode with this seed.
            ModelFileError: the planner cannot be read.
        """
        from ocplanner.report.viewer import record_playback
        from ocplanner.zero_shot.setup import TransferSetup

        if self.source.suffix == ".json":
            return self._again()
        setup = TransferSetup.of((self.source, *self.planner), self.robot, self.config)
        return record_playback(setup, FIRST_EVALUATION_SEED if self.seed is None else self.seed)

    def _again(self) -> "Playback":
        from ocplanner.report.viewer import record_playback
        from ocplanner.zero_shot.result import read_results
        from ocplanner.zero_shot.setup import TransferSetup
        from ocplanner.zero_shot.task_planners import TaskPlanners

        result, *others = read_results(self.source)
        if others:
            raise ResultFileError(f"{self.source} holds {1 + len(others)} results; give a file with one")
        named = self.planner or result.planners or _planners_in(result.command)
        if not named:
            raise ResultFileError(f"{self.source} does not name its planner; name it with --planner")
        planners = TaskPlanners.of(named)
        if planners.sha256 != result.planner_sha256:
            raise MismatchError(f"{planners} is not the planner of {self.source}; name that one with --planner")
        recorded = self._episode(result)
        playback = record_playback(TransferSetup.of(planners, result.robot, result.settings), recorded.seed)
        ended = "success" if recorded.success else str(recorded.failure)
        if (ended, recorded.steps) != (playback.outcome, len(playback)):
            sys.stderr.write(
                f"note: {self.source} says '{ended}' after {recorded.steps} steps, here it is '{playback.outcome}' "
                f"after {len(playback)}: another version of the package or another processor\n"
            )
        return playback

    def _episode(self, result: "TransferResult") -> "EpisodeResult":
        """The episode of the seed, or the first failure, or the first success."""
        if self.seed is None:
            return min(result.runs, key=lambda run: run.success)
        found = result.episode(self.seed)
        if found is None:
            first, last = result.runs[0].seed, result.runs[-1].seed
            raise MismatchError(f"{self.source} has episodes {first} to {last}, not {self.seed}")
        return found


def _planners_in(command: str) -> tuple[str, ...]:
    """The planner files that a command names; results of format 1 name them nowhere else."""
    words = shlex.split(command)
    after = words[words.index("--planner") + 1 :] if "--planner" in words else []
    return tuple(takewhile(lambda word: not word.startswith("--"), after))


COMMAND = View

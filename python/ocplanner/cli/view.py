"""``ocplanner view``."""

import contextlib
import sys
import threading
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from ocplanner.errors import MismatchError, ResultFileError

if TYPE_CHECKING:
    from ocplanner.report.viewer import Playback


@dataclass(frozen=True)
class View:
    """Show a zero-shot episode in three dimensions, in the browser: robot, objects, planned and achieved path, time.

    Of a planner file an episode is run; of a result of `ocplanner transfer` one of its episodes is run again, and a
    note says if it does not come out as it did then. Needs viser: pip install 'ocplanner[viewer]'. Ctrl-C ends it.
    """

    source: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="PLANNER-or-RESULT")]
    """Planner file (.safetensors) or the run folder that it is in, or result file of `ocplanner transfer` (.json)."""
    planner: tuple[Path, ...] = ()
    """The planner file of a result, or those of all its task's objects. Default: what the result's command names."""
    seed: int | None = None
    """Seed of the episode. Default: 10000, or a result's first failure, if any, else its first episode."""
    robot: str = "Sawyer"
    """The arm; of a result its own."""
    follow: Literal["gated", "time", "open-loop"] = "gated"
    """How the plan is followed; of a result its own."""
    host: str = "127.0.0.1"
    """Address to listen on; 0.0.0.0: other machines may look, too."""
    port: int = 8080
    """Port to listen on; 0: any that is free."""

    def run(self) -> None:
        """Record the episode, say where it is shown, and serve until interrupted."""
        from ocplanner.report.viewer import Viewer, load_viser

        load_viser()  # before an episode is run in vain
        playback = self.playback()
        with Viewer(playback, self.host, self.port) as viewer:
            sys.stdout.write(f"{playback.title}: {playback.outcome}\n{viewer.address} (Ctrl-C ends it)\n")
            sys.stdout.flush()
            with contextlib.suppress(KeyboardInterrupt):
                threading.Event().wait()

    def playback(self) -> "Playback":
        """The episode to show.

        Raises:
            ResultFileError: the result is damaged, or does not say which planner it is of.
            MismatchError: it is of another planner, or of no episode with this seed.
            ModelFileError: the planner cannot be read.
        """
        from ocplanner.report.viewer import record_playback
        from ocplanner.zero_shot.task_planners import TaskPlanners

        if self.source.suffix != ".json":
            seed = 10000 if self.seed is None else self.seed
            return record_playback(TaskPlanners.of((self.source, *self.planner)), self.robot, seed, follow=self.follow)
        return self._again()

    def _again(self) -> "Playback":
        from ocplanner.report.results import read_results
        from ocplanner.report.viewer import record_playback
        from ocplanner.zero_shot.task_planners import TaskPlanners

        record, *others = read_results(self.source)
        if others:
            raise ResultFileError(f"{self.source} holds {1 + len(others)} results; give a file with one")
        words = record.command.split()
        after = words[words.index("--planner") + 1 :] if "--planner" in words else []
        named = list(takewhile(lambda word: not word.startswith("--"), after))
        if not self.planner and not named:
            raise ResultFileError(f"{self.source} does not say which planner it is of; name it with --planner")
        planner = TaskPlanners.of(self.planner or named)
        if planner.sha256 != record.planner_sha256:
            raise MismatchError(f"{planner} is not the planner of {self.source}; name that one with --planner")
        seeds = [run.seed for run in record.runs]
        if self.seed is not None and self.seed not in seeds:
            raise MismatchError(f"{self.source} has episodes {seeds[0]} to {seeds[-1]}, not {self.seed}")
        failed = [run.seed for run in record.runs if not run.success]
        seed = self.seed if self.seed is not None else [*failed, *seeds][0]
        playback = record_playback(planner, record.robot, seed, follow=record.follow, patches=record.patches)
        (run,) = [run for run in record.runs if run.seed == seed]
        recorded = "success" if run.success else str(run.failure)
        if (recorded, run.steps) != (playback.outcome, len(playback)):
            sys.stderr.write(
                f"note: {self.source} says '{recorded}' after {run.steps} steps, here it is '{playback.outcome}' after "
                f"{len(playback)}: other versions or another processor, or masks or poses were wrong on purpose\n"
            )
        return playback


COMMAND = View

"""``ocplanner evaluate``."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console
from rich.progress import Progress

from ocplanner.files.records.evaluation import EvaluationSettings
from ocplanner.progress import counting_columns
from ocplanner.rollouts.settings import WorkerSettings


@dataclass(frozen=True)
class Evaluate:
    """Run trained policies on the arm and the task of their data set and count successes, as robomimic does.

    Stop it whenever you like: the same command goes on where it was.
    """

    policy: Path
    """Policy file (.safetensors), or the run folder of `ocplanner train-policy`: every checkpoint in its policies/."""
    planner: Path | None = None
    """The planner that the data set was labelled with; for policies that read hints."""
    settings: Annotated[EvaluationSettings, tyro.conf.arg(name="")] = field(default_factory=EvaluationSettings)
    workers: Annotated[WorkerSettings, tyro.conf.arg(name="")] = field(default_factory=WorkerSettings)
    out: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Result file. Default: evaluation.json in the run folder, or beside the policy file by its name."""
    overwrite: bool = False
    """Replace the result file if it is there."""

    def run(self) -> None:
        """Evaluate with a progress bar."""
        from ocplanner.files.records.episode import EpisodeResult
        from ocplanner.policies.evaluate import checkpoints, evaluate_policy

        episodes, paths = self.settings.episodes, checkpoints(self.policy, self.settings.last)
        beside = self.policy.with_name(f"{self.policy.stem}_evaluation.json")
        out = self.out or (self.policy / "evaluation.json" if self.policy.is_dir() else beside)
        console = Console()
        successes: dict[Path, list[bool]] = {}
        with Progress(*counting_columns(), console=console, disable=not console.is_terminal) as progress:
            bar = progress.add_task("evaluating", total=episodes * len(paths))

            def count(path: Path, run: EpisodeResult) -> None:
                seen = successes.setdefault(path, [])
                seen.append(run.success)
                progress.update(bar, advance=1, description=f"{path.stem}: {sum(seen)} of {len(seen)}")
                if not console.is_terminal and len(seen) == episodes:
                    console.print(f"{path.stem}: {sum(seen)}/{len(seen)}")

            result = evaluate_policy(
                self.policy,
                self.planner,
                self.settings,
                workers=self.workers,
                out=out,
                overwrite=self.overwrite,
                on_episode=count,
            )
        console.print(str(result), soft_wrap=True)
        console.print(f"{out}", soft_wrap=True)


COMMAND = Evaluate

"""``ocplanner label``."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console

from ocplanner.guidance.hints import Origin
from ocplanner.guidance.settings import Form, RewardMode
from ocplanner.progress import demonstrations_bar


@dataclass(frozen=True)
class Label:
    """Write a planner's hints and dense rewards into a copy of a data set with images.

    Stop it whenever you like: the same command goes on where it was.
    """

    source: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="DATA")]
    """robomimic data set with the images that the planner was trained on, unless --pictures has them."""
    target: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="OUT")]
    """File to make: a copy with labels."""
    planner: Path
    """Planner file (.safetensors)."""
    pictures: Path | None = None
    """Another rendering of the same demonstrations, drawn as the planner was trained."""
    hints: bool = True
    """Write obs/ocp_hint and obs/ocp_plan."""
    horizon_step: tuple[int, ...] = (1,)
    """Planned steps that hints point to: 1 is the next, the paper's; several are stacked."""
    hint_from: Origin = "object"
    """Where hints start: at the object's real pose, or at the plan's first step."""
    reward: RewardMode = "off"
    """Add the plan's reward to the recorded one, put it in its place, or leave rewards alone."""
    form: Form = "penalty"
    """Form of the plan's reward; literal is the paper's equation as printed."""
    a: float = 0.003
    """Weight of the position term, 1/m^2."""
    b: float = 0.003
    """Weight of the rotation term."""
    gamma: float = 0.99
    """The learner's discount; for the form potential."""
    scale: float = 2.5e-4
    """The weighted error at which the form exp has fallen to 1/e."""
    batch: int = 64
    """Images planned at a time."""
    threads: int = 1
    """Threads of the planner."""
    limit: int | None = None
    """Label the first so many demonstrations only."""
    overwrite: bool = False
    """Replace the target if it is there."""

    def run(self) -> None:
        """Label with a progress bar."""
        from ocplanner.demos.dataset import Demonstrations
        from ocplanner.guidance.dataset import label_dataset
        from ocplanner.guidance.labels import LabelSettings
        from ocplanner.guidance.settings import RewardConfig
        from ocplanner.planner.planner import Planner

        settings = LabelSettings(
            hints=self.hints,
            horizon_steps=self.horizon_step,
            hint_from=self.hint_from,
            reward=self.reward,
            reward_config=RewardConfig(self.a, self.b, self.form, self.gamma, self.scale),
            batch=self.batch,
        )
        planner = Planner.load(self.planner)
        with Demonstrations(self.source) as demos:
            total = len(demos.names[: self.limit])
        console = Console(stderr=True)
        with demonstrations_bar("labelling", total, console) as advance:
            path = label_dataset(
                self.source,
                self.target,
                planner,
                settings,
                pictures=self.pictures,
                threads=self.threads,
                limit=self.limit,
                overwrite=self.overwrite,
                progress=advance,
            )
        written = [*(["hints"] if self.hints else []), *([f"rewards ({self.reward})"] if self.reward != "off" else [])]
        console.print(f"wrote {path}: {total} demonstration{'s' * (total != 1)} with {' and '.join(written)}")


COMMAND = Label

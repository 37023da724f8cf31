"""Settings of collecting and rendering data sets. This module loads neither the simulator nor torch."""

from dataclasses import asdict, dataclass
from typing import Literal

from ocplanner.envs.robots import robot as robot_spec
from ocplanner.envs.tasks import task as task_spec
from ocplanner.envs.visuals import MASK_RGB, Observe, Visual
from ocplanner.errors import InvalidValueError
from ocplanner.files.records.render import RenderRecord
from ocplanner.rollouts.settings import FIRST_EVALUATION_SEED
from ocplanner.settings import build, require, require_choice, require_names
from ocplanner.versions import installed

Flaw = Literal["early-release", "misjudged-goal"]
"""How an expert fails, see :func:`ocplanner.collection.attempts.attempt`."""

FrameChoice = Literal["all", "manipulation"]

SEEDS_EACH = 1000
"""Attempts that one seed of a collection stands for."""

_MOST_NOISE = 5.0
_MOST_PIXELS = 2048
_DEFAULT_SILHOUETTES = ("IIWA", "Kinova3")


@dataclass(frozen=True)
class CollectSettings:
    """Which demonstrations are recorded.

    Raises:
        UnknownNameError: no such task, robot or flaw.
        InvalidValueError: a number is out of range.
    """

    task: str = "Square"
    """The task."""
    robot: str = "Panda"
    """The arm."""
    episodes: int = 100
    """Successful demonstrations to record (with --flaw: failures); other attempts are left out and counted."""
    flaw: Flaw | None = None
    """Record failures instead: the expert lets go on the way, or puts the object down beside its goal."""
    noise: float = 1.0
    """How much demonstrations differ in path and tremor: 1 about as much as people's, 0 not at all."""
    seed: int = 0
    """0 to 9: which thousand of attempts. Seeds from 10000 on are kept for evaluation."""

    def __post_init__(self) -> None:
        """Check names and numbers."""
        task_spec(self.task)
        robot_spec(self.robot)
        if self.flaw is not None:
            require_choice("flaw", self.flaw, Flaw)
        most = FIRST_EVALUATION_SEED // SEEDS_EACH - 1
        require(0 <= self.seed <= most, f"seed is {self.seed}, but must be 0 to {most}")
        require(1 <= self.episodes <= SEEDS_EACH, f"episodes is {self.episodes}, but must be 1 to {SEEDS_EACH}")
        require(0.0 <= self.noise <= _MOST_NOISE, f"noise is {self.noise}, but must be 0 to {_MOST_NOISE:g}")

    @property
    def first_seed(self) -> int:
        """Seed of the first attempt."""
        return self.seed * SEEDS_EACH


@dataclass(frozen=True)
class RenderSettings:
    """What is drawn.

    Raises:
        UnknownNameError: a name is not known.
        InvalidValueError: a number is out of range, or silhouettes are asked for without masks.
    """

    observe: Observe = "masked"
    """What the images show: everything, the robot painted flat, or no robot at all."""
    cameras: tuple[str, ...] = ("agentview",)
    """Cameras to render."""
    size: int = 84
    """Width and height, pixels."""
    visual: Visual = "fast"
    """Visual preset: lean pictures, or robosuite's own."""
    silhouettes: tuple[str, ...] | None = None
    """Arms whose masks are added to masked images, for augmentation. Default: IIWA and Kinova3."""
    silhouette_stride: int = 1
    """Draw silhouettes for every so many-th frame only."""
    frames: FrameChoice = "all"
    """Render all frames, or only those in which the robot manipulates an object; the others are black."""

    def __post_init__(self) -> None:
        """Check names and numbers."""
        require_choice("observation", self.observe, Observe)
        require_choice("choice of frames", self.frames, FrameChoice)
        require_choice("visual preset", self.visual, Visual)
        require_names("cameras", self.cameras)
        for name in require_names("silhouettes", self.silhouettes or ()):
            robot_spec(name)
        if self.silhouettes and self.observe != "masked":
            raise InvalidValueError(f"silhouettes need observe=masked, not observe={self.observe}")
        require(bool(self.cameras), "no camera to render; name at least one")
        require(1 <= self.size <= _MOST_PIXELS, f"size is {self.size}, but must be 1 to {_MOST_PIXELS}")
        require(self.silhouette_stride >= 1, f"silhouette_stride is {self.silhouette_stride}, but must be at least 1")

    @property
    def silhouette_arms(self) -> tuple[str, ...]:
        """The arms whose silhouettes are drawn: those named, or the default for masked images."""
        if self.silhouettes is not None:
            return self.silhouettes
        return _DEFAULT_SILHOUETTES if self.observe == "masked" else ()

    def record(self) -> RenderRecord:
        """What is stored with the data set."""
        resolved = {"silhouettes": self.silhouette_arms, "mask_rgb": MASK_RGB, "versions": installed()}
        return build(RenderRecord, {**asdict(self), **resolved})

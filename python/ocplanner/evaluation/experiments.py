"""The experiments behind ``results/``: which planners are trained and which arms they are tried on."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class PlannerExperiment:
    """One planner to train on ``mask/train`` of Square PH."""

    observe: str = "masked"
    horizon: int = 20
    outputs: str = "pose"
    seed: int = 0
    channels: tuple[int, ...] = ()
    """Of the encoder; the preset's if empty. Not in the name: give other encoders folders of their own."""

    @property
    def name(self) -> str:
        """The run folder's name and the planner file's stem."""
        return f"square_{self.observe}_h{self.horizon}_{self.outputs}_{self.seed}"

    @property
    def transferred(self) -> bool:
        """Whether transfers run it, so that its planner file belongs to the results."""
        return (self.horizon, self.outputs) == (20, "pose")

    def file(self, results: Path) -> Path:
        """The planner file among the results."""
        return results / "planners" / f"{self.name}.safetensors"


@dataclass(frozen=True)
class TransferExperiment:
    """One planner on one arm, 100 episodes."""

    robot: str
    follow: str = "gated"
    observe: str = "masked"
    seed: int = 0
    mask_error: int = 0

    @property
    def name(self) -> str:
        """The result file's path below the results, without its ending."""
        stem = f"square_{self.robot.lower()}_{self.follow}_{self.observe}_{self.seed}"
        return f"mask_error/{stem}_{self.mask_error}px" if self.mask_error else f"transfer/{stem}"

    @property
    def planner(self) -> PlannerExperiment:
        """The planner it runs."""
        return PlannerExperiment(observe=self.observe, seed=self.seed)


OBSERVES = ("masked", "no-robot", "full")
ROBOTS = ("Sawyer", "UR5e", "Panda")


def planner_experiments(seeds: Sequence[int]) -> tuple[PlannerExperiment, ...]:
    """Every seed of the H = 20 pose planner for each kind of observation, and one of every other horizon and output.

    In the order of what matters: the default first, the upper bound and the plain images beside it, then the rest.
    """
    first, *rest = seeds
    experiments = [PlannerExperiment(seed=seed) for seed in seeds]
    experiments += [PlannerExperiment(observe=observe, seed=first) for observe in OBSERVES[1:]]
    experiments += [
        PlannerExperiment(horizon=horizon, outputs=outputs, seed=first)
        for horizon in (5, 20, 50)
        for outputs in ("pose", "position")
        if (horizon, outputs) != (20, "pose")
    ]
    experiments += [PlannerExperiment(observe=observe, seed=seed) for seed in rest for observe in OBSERVES[1:]]
    return tuple(experiments)


def transfer_experiments(seeds: Sequence[int]) -> tuple[TransferExperiment, ...]:
    """Every planner on every arm; the paper's ways of following and imperfect masks on Sawyer.

    In the order of what matters, like the planners.
    """
    first, *rest = seeds
    experiments = [TransferExperiment(robot, seed=seed) for seed in seeds for robot in ROBOTS]
    experiments += [TransferExperiment("Sawyer", follow=follow, seed=first) for follow in ("open-loop", "time")]
    experiments += [
        TransferExperiment(robot, observe=observe, seed=first) for observe in OBSERVES[1:] for robot in ROBOTS
    ]
    experiments += [TransferExperiment("Sawyer", seed=first, mask_error=pixels) for pixels in (1, 2, 3)]
    experiments += [
        TransferExperiment("Sawyer", follow=follow, seed=seed) for seed in rest for follow in ("open-loop", "time")
    ]
    experiments += [
        TransferExperiment(robot, observe=observe, seed=seed)
        for seed in rest
        for observe in OBSERVES[1:]
        for robot in ROBOTS
    ]
    return tuple(experiments)

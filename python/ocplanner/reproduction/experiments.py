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
    """Channels of the encoder; empty: the preset's. The name does not contain them: use another results folder."""

    @property
    def name(self) -> str:
        """The run folder's name and the planner file's stem."""
        return f"square_{self.observe}_h{self.horizon}_{self.outputs}_{self.seed}"

    @property
    def transferred(self) -> bool:
        """Whether transfers use it, so that its planner file belongs to the results."""
        return (self.horizon, self.outputs) == (20, "pose")

    def file(self, results: Path) -> Path:
        """The planner file among the results."""
        return results / "planners" / f"{self.name}.safetensors"


@dataclass(frozen=True)
class TransferExperiment:
    """One planner on one arm.

    Attributes:
        robot: name of the arm.
        follow: follow mode.
        observe: what the planner sees.
        seed: training seed of the planner.
        mask_error: pixels by which masks are wrong.
        pose_noise: standard deviations of the object's pose, mm and degrees, in an experiment with pose noise.
        pose_filter: control steps over which that pose is averaged.
    """

    robot: str
    follow: str = "gated"
    observe: str = "masked"
    seed: int = 0
    mask_error: int = 0
    pose_noise: tuple[int, int] | None = None
    pose_filter: int = 1

    @property
    def name(self) -> str:
        """The result file's path below the results, without its ending."""
        stem = f"square_{self.robot.lower()}_{self.follow}_{self.observe}_{self.seed}"
        if self.pose_noise is not None:
            noise = "{}mm{}deg".format(*self.pose_noise)
            return f"pose_noise/{stem}_{noise}_filter{self.pose_filter}"
        return f"mask_error/{stem}_{self.mask_error}px" if self.mask_error else f"transfer/{stem}"

    @property
    def planner(self) -> PlannerExperiment:
        """The planner it runs."""
        return PlannerExperiment(observe=self.observe, seed=self.seed)


OBSERVES = ("masked", "no-robot", "full")
ROBOTS = ("Sawyer", "UR5e", "Panda")


POSE_NOISE_MM, POSE_NOISE_DEG = (0, 2, 5, 10), (0, 2, 5)
POSE_FILTER_STEPS = 8


def planner_experiments(seeds: Sequence[int]) -> tuple[PlannerExperiment, ...]:
    """Every seed of the H = 20 pose planner for each observation, and one seed of every other horizon and output.

    Ordered by importance: first the default, then the upper bound and the plain images, then the rest.
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
    """Every planner on every arm; the paper's follow modes and imperfect masks on Sawyer.

    Ordered by importance, like the planners.
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


def pose_noise_experiments(seed: int) -> tuple[TransferExperiment, ...]:
    """Every size of pose noise on Sawyer with the filter; position noise alone also without it."""
    filtered = [
        TransferExperiment("Sawyer", seed=seed, pose_noise=(millimetres, degrees), pose_filter=POSE_FILTER_STEPS)
        for degrees in POSE_NOISE_DEG
        for millimetres in POSE_NOISE_MM
    ]
    as_read = [TransferExperiment("Sawyer", seed=seed, pose_noise=(millimetres, 0)) for millimetres in POSE_NOISE_MM]
    return (*filtered, *as_read)

"""The paper's Figures 4 to 8 from planners trained on Square PH; missing planners, images and videos are made first."""

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from matplotlib.figure import Figure

from ocplanner.demos.dataset import Demonstrations
from ocplanner.demos.writer import DatasetWriter
from ocplanner.drawing.style import save_figure
from ocplanner.drawing.video import read_video
from ocplanner.errors import DatasetError
from ocplanner.planner.planner import FILE_NAME, Planner
from ocplanner.report.overlays import film_strip
from ocplanner.report.planner_figures import planner_figures
from ocplanner.report.plots import loss_curves
from ocplanner.report.runs import read_run
from ocplanner.reproduction import reproduction
from ocplanner.reproduction.experiments import PlannerExperiment
from ocplanner.zero_shot.result import TransferResult, read_result

HORIZONS = (5, 20, 50)
_SHOWN = 10
"""Number of held-out demonstrations drawn; the paper's Figure 7 has ten."""
_ROBOT, _EPISODE = "Sawyer", 10000


@dataclass(frozen=True)
class FigureWork:
    """Where the material of the figures lies, and how it is made.

    Attributes:
        data: Square PH with states.
        work: folder of rendered data, run folders and logs.
        results: folder of the committed planners.
        preset: preset of trainings; only ``cpu`` has committed planners.
        seed: training seed.
        workers: processes that render.
        device: device of trainings.
    """

    data: Path
    work: Path
    results: Path
    preset: str = "cpu"
    seed: int = 0
    workers: int = 1
    device: str = "cpu"

    def run(self, horizon: int) -> Path:
        """The run folder of one training, which is started or resumed if it is not finished."""
        experiment = self._experiment(horizon)
        folder = self.work / (experiment.name if self.preset == "cpu" else f"{experiment.name}_{self.preset}")
        if not (folder / FILE_NAME).exists():
            for _ in reproduction.render_images([experiment], self.data, self.work, self.workers):
                pass
            data = reproduction.images(self.work, experiment.observe)
            flags = ["--horizon", str(horizon), "--outputs", experiment.outputs, "--observe", experiment.observe]
            flags += ["--preset", self.preset, "--device", self.device, "--seed", str(self.seed)]
            command = ["train-planner", "--data", str(data), "--run", str(folder), *flags]
            reproduction.run_command(command, self.work / "logs" / f"{folder.name}.log")
        return folder

    def planner(self, horizon: int) -> Path:
        """The committed planner file, or that of a training."""
        committed = self._experiment(horizon).file(self.results)
        return committed if self.preset == "cpu" and committed.exists() else self.run(horizon) / FILE_NAME

    def held_out(self) -> Path:
        """A data set of ten held-out demonstrations with the planner's images.

        Raises:
            DatasetError: the data set does not say which demonstrations are held out.
        """
        states, images = self.work / "square_held_out.hdf5", self.work / "square_held_out_masked.hdf5"
        if not images.exists():
            if not states.exists():
                _copy_held_out(self.data, states)
            flags = ["--silhouettes", "--frames", "manipulation", "--workers", str(self.workers)]
            command = ["render", str(states), str(images), "--observe", self._experiment(20).observe, *flags]
            reproduction.run_command(command, self.work / "logs" / "render_held_out.log")
        return images

    def episode(self, planner: Path) -> tuple[Path, TransferResult]:
        """The video and the result of one zero-shot episode."""
        out = self.work / f"figure_8_{self.preset}_{self.seed}.json"
        if not out.exists():
            flags = ["--robot", _ROBOT, "--episodes", "1", "--seed-start", str(_EPISODE), "--videos", "1"]
            command = ["transfer", "--planner", str(planner), *flags, "--out", str(out)]
            reproduction.run_command(command, self.work / "logs" / f"{out.stem}.log")
        return out.with_suffix("") / f"episode_{_EPISODE}.mp4", read_result(out)

    def _experiment(self, horizon: int) -> PlannerExperiment:
        return PlannerExperiment(horizon=horizon, seed=self.seed)


def draw(number: int, work: FigureWork, folder: Path) -> Path:
    """Draw one figure of the paper as ``folder/paper_figure_N.png``; the name ends with a preset other than ``cpu``.

    Raises:
        OutputError: a step failed; the message names its log.
        DatasetError: the data set does not say which demonstrations are held out.
    """
    suffix = "" if work.preset == "cpu" else f"_{work.preset}"
    return save_figure(FIGURES[number](work), folder / f"paper_figure_{number}{suffix}.png")


def _losses(work: FigureWork) -> Figure:
    return loss_curves([read_run(work.run(horizon)) for horizon in HORIZONS])


def _plans(horizon: int) -> Callable[[FigureWork], Figure]:
    return lambda work: _drawn(work, horizon)["plans"]


def _latents(work: FigureWork) -> Figure:
    return _drawn(work, 20)["latents"]


def _drawn(work: FigureWork, horizon: int) -> Mapping[str, Figure]:
    with Demonstrations(work.held_out()) as demos:
        return planner_figures(Planner.load(work.planner(horizon)), demos, rows=2, columns=4, demonstrations=_SHOWN)


def _zero_shot(work: FigureWork) -> Figure:
    video, result = work.episode(work.planner(20))
    (episode,) = result.runs
    outcome = "success" if episode.success else episode.failure
    return film_strip(
        list(read_video(video)),
        count=12,
        columns=6,
        title=f"Zero-shot on {result.robot}, follow = {result.settings.control.follow}: {outcome}",
    )


def _copy_held_out(data: Path, target: Path) -> None:
    with ExitStack() as opened:
        demos = opened.enter_context(Demonstrations(data))
        if "valid" not in demos.mask_names:
            raise DatasetError(f"{data}: no mask/valid, so nothing says what was held out")
        writer = opened.enter_context(DatasetWriter(target, demos.env_args, reads=[data]))
        for name in demos.mask("valid")[:_SHOWN]:
            writer.add_copy(demos[name], {})
        writer.finish()


FIGURES: Mapping[int, Callable[[FigureWork], Figure]] = {
    4: _losses,
    5: _plans(20),
    6: _plans(50),
    7: _latents,
    8: _zero_shot,
}

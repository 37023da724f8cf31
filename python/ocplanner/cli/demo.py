"""``ocplanner demo``: the main job, from demonstrations to another arm."""

from dataclasses import dataclass, replace
from pathlib import Path

from rich.console import Console

from ocplanner.cli.collect import Collect
from ocplanner.cli.doctor import Doctor
from ocplanner.cli.render import Render
from ocplanner.cli.report import Report
from ocplanner.cli.train_planner import TrainPlanner
from ocplanner.cli.transfer import Transfer
from ocplanner.collection.settings import CollectSettings, RenderSettings
from ocplanner.demos.dataset import Demonstrations
from ocplanner.envs.robots import robot as robot_spec
from ocplanner.files.records.demo import DemoInputs
from ocplanner.planner.config import PlannerTraining, preset
from ocplanner.planner.planner import FILE_NAME
from ocplanner.rollouts.settings import WorkerSettings


@dataclass(frozen=True)
class Demo:
    """The main job: demonstrations of a Panda -> planner -> another arm; ends with a success rate, videos and a report.

    Without --data it first collects scripted demonstrations of Square. You can stop it at any time; the same command
    continues where it stopped. Another --data, --demonstrations, --seed or --stages needs another --out.
    """

    data: Path | None = None
    """A robomimic data set with states, such as Square PH. Default: collect one."""
    out: Path = Path("runs/demo")
    """Folder of everything that is made."""
    robot: str = "Sawyer"
    """The arm that the skill is transferred to."""
    demonstrations: int = 100
    """How many demonstrations to collect without --data."""
    episodes: int = 20
    """Zero-shot episodes, from seed 10000 on."""
    stages: tuple[int, int, int] | None = None
    """Steps of the three stages of training; a few suffice to try the pipeline. Default: the cpu preset's."""
    seed: int = 0
    """Seed of collecting and training."""
    workers: int = 2
    """Worker processes."""

    def run(self) -> None:
        """Run the steps that are not done yet."""
        robot_spec(self.robot)
        training = self._training()  # wrong settings are errors before anything is made
        collecting = CollectSettings(episodes=self.demonstrations, seed=self.seed) if self.data is None else None
        self._inputs().claim(self.out)
        console = Console()
        console.rule("1/6 this machine")
        Doctor().run()

        console.rule("2/6 demonstrations")
        data = self.data or self.out / "demonstrations.hdf5"
        if collecting is not None and not data.exists():
            Collect(out=data, settings=collecting, workers=WorkerSettings(self.workers)).run()
        console.print(str(data), soft_wrap=True)

        console.rule("3/6 images")
        images = self.out / "images.hdf5"
        if not images.exists():
            settings = RenderSettings(frames="manipulation")
            Render(source=data, target=images, settings=settings, workers=WorkerSettings(self.workers)).run()
        console.print(str(images), soft_wrap=True)

        console.rule("4/6 the object-centric planner")
        run = self.out / "planner"
        planner = run / FILE_NAME
        if not planner.exists():
            TrainPlanner(images, run, training).run()

        console.rule(f"5/6 zero-shot on {self.robot}")
        result = self.out / f"{self.robot.lower()}.json"
        videos = min(3, self.episodes)
        Transfer(
            planner=(planner,),
            robot=self.robot,
            episodes=self.episodes,
            workers=WorkerSettings(self.workers),
            videos=videos,
            out=result,
            overwrite=True,
        ).run()

        console.rule("6/6 report")
        Report(paths=(self.out,), out=self.out / "report.html", data=(images,)).run()

    def _inputs(self) -> DemoInputs:
        if self.data is None:
            return DemoInputs(None, None, self.demonstrations, self.seed, self.stages)
        with Demonstrations(self.data):  # an unreadable one is an error before anything is made
            size = self.data.stat().st_size
        return DemoInputs(str(self.data.absolute()), size, None, self.seed, self.stages)

    def _training(self) -> PlannerTraining:
        training = replace(preset("cpu"), seed=self.seed)
        steps = dict(zip(("vae", "predictor", "finetune"), self.stages or ()))
        stages = {name: replace(getattr(training, name), steps=count) for name, count in steps.items()}
        return replace(training, **stages)


COMMAND = Demo

"""The verbs that faults are injected into, on data so small that each takes a second or two."""

import functools
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from process import VerbProcess

ROOT = Path(__file__).parents[2]
PLANNER = ROOT / "results" / "planners" / "square_masked_h20_pose_0.safetensors"


class Material:
    """What verbs read, made when first asked for and kept in a folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        folder.mkdir(parents=True, exist_ok=True)

    @functools.cached_property
    def collected(self) -> Path:
        """Three demonstrations of Square, states only."""
        path = self.folder / "collected.hdf5"
        return self._made(path, ["collect", "--out", str(path), "--episodes", "3"])

    @functools.cached_property
    def rendered(self) -> Path:
        """The same with images of every frame."""
        path = self.folder / "rendered.hdf5"
        return self._made(path, ["render", str(self.collected), str(path), "--silhouettes", "--workers", "1"])

    @functools.cached_property
    def policy(self) -> Path:
        """A policy file."""
        run = self.folder / "policy"
        steps = ["--steps", "20", "--save-every", "20"]
        return self._made(
            run / "policy.safetensors", ["train-policy", "--data", str(self.collected), "--run", str(run), *steps]
        )

    @property
    def planner(self) -> Path:
        """A planner file that is committed."""
        return PLANNER

    def _made(self, path: Path, arguments: list[str]) -> Path:
        if not path.exists():
            ending = VerbProcess(arguments, self.folder / "log").wait()
            if ending.code:
                raise RuntimeError(f"ocplanner {' '.join(arguments)}: {ending.text}")
        return path


@dataclass(frozen=True)
class Verb:
    """One verb with its flags.

    Attributes:
        name: as on the command line.
        output: the last file that it writes, in the folder where it works; None: it writes nothing.
        arguments: from its inputs by kind, and the output.
        reads: the inputs by kind: names of :class:`Material`.
        grows: whether the output is there, and whole, before all is done.
        modules: what it imports when it runs.
    """

    name: str
    output: str | None
    arguments: Callable[[dict[str, Path], Path], list[str]]
    reads: tuple[str, ...] = ()
    grows: bool = False
    modules: tuple[str, ...] = ()

    def command(self, material: Material, work: Path, **instead: Path) -> list[str]:
        """The verb and its flags, with other inputs where ``instead`` names them."""
        inputs = {kind: instead.get(kind) or getattr(material, kind) for kind in self.reads}
        return [self.name, *self.arguments(inputs, work / (self.output or ""))]


def _collect(_: dict[str, Path], out: Path) -> list[str]:
    return ["--out", str(out), "--task", "Lift", "--episodes", "4"]


def _render(inputs: dict[str, Path], out: Path) -> list[str]:
    flags = ["--silhouettes", "--workers", "1", "--size", "32", "--frames", "manipulation"]
    return [str(inputs["collected"]), str(out), *flags]


def _convert(inputs: dict[str, Path], out: Path) -> list[str]:
    return [str(inputs["collected"]), str(out), "--next-obs"]


def _label(inputs: dict[str, Path], out: Path) -> list[str]:
    return [str(inputs["rendered"]), str(out), "--planner", str(inputs["planner"]), "--reward", "augment"]


def _train_planner(inputs: dict[str, Path], out: Path) -> list[str]:
    steps = ["--vae-steps", "32", "--predictor-steps", "32", "--finetune-steps", "16", "--channels", "4", "8"]
    return ["--data", str(inputs["rendered"]), "--run", str(out.parent), *steps]


def _train_policy(inputs: dict[str, Path], out: Path) -> list[str]:
    steps = ["--steps", "200", "--save-every", "80"]
    return ["--data", str(inputs["collected"]), "--run", str(out.parent), *steps]


def _transfer(inputs: dict[str, Path], out: Path) -> list[str]:
    return ["--planner", str(inputs["planner"]), "--robot", "Sawyer", "--episodes", "3", "--out", str(out)]


def _matrix(inputs: dict[str, Path], out: Path) -> list[str]:
    planners, robots = ["--planners", str(inputs["planner"])], ["--robots", "Sawyer", "UR5e"]
    return [*planners, *robots, "--episodes", "2", "--out", str(out)]


def _info(inputs: dict[str, Path], _: Path) -> list[str]:
    return [str(next(iter(inputs.values()))), "--all"]


def _evaluate(inputs: dict[str, Path], out: Path) -> list[str]:
    return ["--policy", str(inputs["policy"]), "--episodes", "1", "--horizon", "3", "--out", str(out)]


_PLANNING = "ocplanner.planner.planner"
_TRANSFERRING = (_PLANNING, "ocplanner.zero_shot.transfer")
_EVALUATING = ("ocplanner.policies.evaluate",)
_FITTING = ("ocplanner.planner.train", "ocplanner.report.page")

COLLECT = Verb("collect", "out.hdf5", _collect, modules=("ocplanner.collection.collect",))
RENDER = Verb("render", "out.hdf5", _render, ("collected",), modules=("ocplanner.collection.render",))
CONVERT = Verb("convert", "out.hdf5", _convert, ("collected",), modules=("ocplanner.demos.convert",))
LABEL = Verb("label", "out.hdf5", _label, ("rendered", "planner"), modules=("ocplanner.guidance", _PLANNING))
TRAIN_PLANNER = Verb("train-planner", "run/report.html", _train_planner, ("rendered",), modules=_FITTING)
TRAIN_POLICY = Verb(
    "train-policy", "run/policy.safetensors", _train_policy, ("collected",), modules=("ocplanner.policies.train",)
)
TRANSFER = Verb("transfer", "out.json", _transfer, ("planner",), modules=_TRANSFERRING)
MATRIX = Verb(
    "matrix",
    "out.json",
    _matrix,
    ("planner",),
    grows=True,
    modules=(*_TRANSFERRING, "ocplanner.zero_shot.matrix", "ocplanner.report.heat_map"),
)
EVALUATE = Verb("evaluate", "out.json", _evaluate, ("policy",), modules=_EVALUATING)

WRITERS = (TRAIN_POLICY, LABEL, TRAIN_PLANNER, COLLECT, TRANSFER, RENDER, CONVERT, MATRIX)
HDF5_READERS = (Verb("info", None, _info, ("rendered",)), LABEL, TRAIN_PLANNER, TRAIN_POLICY, RENDER, CONVERT)
PLANNER_READERS = (Verb("info", None, _info, ("planner",)), LABEL, TRANSFER)
POLICY_READERS = (Verb("info", None, _info, ("policy",)), EVALUATE)

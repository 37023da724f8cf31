"""Every odd input of ``inputs.py`` through every verb that reads data sets: what does each say, and is it right?

Run from the repository's root: ``python tests/border/table.py`` writes ``results/border.json``. ``--inputs`` chooses
some; rows of others stay as they are. It takes some minutes on one core.

``render``, ``convert`` and ``info`` read the input itself. So do the others if it has pictures, of which ``render``
then draws the kept frames alone; if not, they read what ``render`` made of it. An input with flags for ``convert`` is
read as that leaves it. ``evaluate`` runs the policy that ``train-policy`` made. An answer is ``ok: `` and what was
said, or ``error: `` and the one line; a traceback would read ``unexpected``. ``found`` holds what a silent mistake
would change: how many steps and frames were kept, how often the object is held.
"""

import argparse
import contextlib
import io
import json
import os
import re
import shlex
import shutil
import signal
import sys
import tempfile
import time
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any
from unittest import mock

sys.path.insert(0, str(Path(__file__).parent))
sys.path.append(str(Path(__file__).parents[1] / "benchmarks"))

os.environ.setdefault("OMP_NUM_THREADS", "1")

import h5py
import numpy as np
from inputs import INPUTS, SIZE, Base, Input
from machine import machine

from ocplanner.cli import main as ocplanner
from ocplanner.files.storage import atomic_json
from ocplanner.versions import installed

OUTPUT = Path(__file__).parents[2] / "results" / "border.json"
VERBS = ("info", "convert", "render", "train-planner", "label", "train-policy", "evaluate")
_LONGEST_S = 120
_NETWORK = ["--image-size", str(SIZE), "--crop", "20", "--augmentation.crop-shift", "1", "--channels", "4", "8"]
_STAGES = ["--vae-steps", "2", "--predictor-steps", "2", "--finetune-steps", "0", "--horizon", "5"]
_NOISE = re.compile(r"━|, step \d+: |^step \d")
_VARYING = (
    (re.compile(r"(eof|base_addr|bytes) (= )?\d+"), r"\1 \2N"),
    (re.compile(r"process \d+ \([^)]*\)"), "process N (COMMAND)"),
)
Found = dict[str, Any]


class Bench:
    """Where odd inputs are tried.

    Args:
        folder: for everything.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.base = Base(folder / "base")
        self._planner: Path | None = None

    @property
    def planner(self) -> Path:
        """A planner of the base, which has learned nothing."""
        if self._planner is None:
            run = self._folder / "planner"
            code, text = call(["train-planner", *train_planner_flags(self.base.lift, run)])
            if code:
                raise RuntimeError(text)
            self._planner = run / "planner.safetensors"
        return self._planner

    def row(self, odd: Input, verbs: Sequence[str] = VERBS) -> dict[str, Any]:
        """What the verbs say to an input, by verb."""
        work = self._folder / "work"
        shutil.rmtree(work, ignore_errors=True)
        work.mkdir()
        cells: dict[str, Any] = {}
        with odd.at(self.base, work) as path, contextlib.chdir(work):
            for verb in VERBS:
                if verb in verbs:
                    cells[verb] = self._cell(odd, verb, path)
        return {"input": odd.name, "what": odd.what, "answers": cells}

    def _cell(self, odd: Input, verb: str, path: Path) -> dict[str, Any]:
        work = path.parent
        rendered, run = work / "rendered.hdf5", work / "run"
        if odd.convert and (work / "converted.hdf5").exists():
            path = work / "converted.hdf5"
        pictured = _has_pictures(path)
        seen = rendered if rendered.exists() and not pictured else path
        policy = work / "policy"
        if verb == "evaluate" and not (policy / "policy.safetensors").exists():
            return {"answer": "no policy to evaluate"}
        commands = {
            "info": [str(path), "--json"],
            "convert": [str(work / "input.hdf5"), str(work / "converted.hdf5"), *odd.convert, *odd.reading],
            "render": [str(path), str(rendered), *render_flags("manipulation" if pictured else "all"), *odd.reading],
            "train-planner": [*train_planner_flags(seen, run), *odd.reading],
            "label": [str(seen), str(work / "labelled.hdf5"), "--planner", str(self.planner), *odd.reading],
            "train-policy": [*train_policy_flags(seen, policy), *odd.policy, *odd.reading],
            "evaluate": ["--policy", str(policy), "--episodes", "1", "--horizon", "3"],
        }
        code, text = call([verb, *commands[verb]])
        said = shortened(text, self._folder) if verb != "info" or code else ""
        if code:
            return {"answer": said[said.find("error: ") :]}
        answer = {"answer": f"ok: {said}" if said else "ok"}
        found = _found(verb, work, _without_folders(text, self._folder))
        return answer | ({"found": found} if found else {})


def call(arguments: list[str]) -> tuple[int, str]:
    """The exit status of a verb and what it said, in this process."""
    said = io.StringIO()
    with (
        contextlib.redirect_stdout(said),
        contextlib.redirect_stderr(said),
        mock.patch.dict(os.environ, COLUMNS="2000"),  # no line is broken
        _limited(),
        warnings.catch_warnings(),
    ):
        warnings.simplefilter("ignore")
        try:
            code = ocplanner(arguments)
        except SystemExit as ended:
            code = int(ended.code or 0)
            said.write(f"error: not parsed: {shlex.join(arguments)}")
    return code, said.getvalue()


@contextlib.contextmanager
def _limited() -> Iterator[None]:
    def late(*_: object) -> None:
        raise TimeoutError(f"more than {_LONGEST_S} s")

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(_LONGEST_S)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def shortened(text: str, folder: Path) -> str:
    """What was said without progress, measured losses and the names of temporary folders, on one line."""
    text = _without_folders(text, folder)
    lines = [line.strip() for line in text.splitlines() if line.strip() and not _NOISE.search(line)]
    joined = " | ".join(lines)
    for varying, plain in _VARYING:
        joined = varying.sub(plain, joined)
    return joined


def _without_folders(text: str, folder: Path) -> str:
    for place in (folder.resolve(), folder):
        text = re.sub(re.escape(str(place)) + r"/(work|base)?/?", "", text)
    return text


def render_flags(frames: str = "manipulation") -> list[str]:
    return ["--size", str(SIZE), "--observe", "full", "--frames", frames, "--workers", "1"]


def train_planner_flags(data: str | Path, run: str | Path) -> list[str]:
    return ["--data", str(data), "--run", str(run), "--observe", "full", *_NETWORK, *_STAGES]


def train_policy_flags(data: str | Path, run: str | Path) -> list[str]:
    steps = ["--steps", "2", "--save-every", "2", "--validate-every", "1"]
    return ["--data", str(data), "--run", str(run), *steps, "--hidden", "8"]


def _has_pictures(path: Path) -> bool:
    try:
        with h5py.File(path, "r") as file:
            return "agentview_image" in next(iter(file["data"].values()))["obs"]
    except OSError:
        return True
    except (KeyError, StopIteration):
        return False


def _found(verb: str, work: Path, text: str) -> Found:
    if verb == "info":
        facts = json.loads(text)
        kept = ("task", "robots", "demonstrations", "steps", "masks", "object layout", "largest action", "findings")
        return {key: facts[key] for key in kept if key in facts}
    if verb == "train-policy":
        lines = (work / "policy/metrics.jsonl").read_text(encoding="utf-8").splitlines()
        return {"held-out losses": sum("valid_loss" in line for line in lines)}
    if verb not in ("convert", "render", "label"):
        return {}
    name = {"convert": "converted", "render": "rendered", "label": "labelled"}[verb]
    with h5py.File(work / f"{name}.hdf5", "r") as file:
        demos = file["data"]
        found: Found = {"steps": {key: len(demo["actions"]) for key, demo in demos.items()}}
        if "mask" in file:
            found["masks"] = {mask: [entry.decode() for entry in file["mask"][mask]] for mask in file["mask"]}
        if verb == "convert":
            found["closing"] = {
                key: round(float(np.mean(demo["actions"][:, -1] > 0)), 2) for key, demo in demos.items()
            }
        if verb == "render":
            drawn = {key: demo["obs/agentview_image"][:].any(axis=(1, 2, 3)) for key, demo in demos.items()}
            found["drawn"] = {key: int(rows.sum()) for key, rows in drawn.items()}
            found["risen cm"] = {key: _risen(demo, drawn[key]) for key, demo in demos.items()}
            found["red pixels"] = {key: _red(demo["obs/agentview_image"][:][drawn[key]]) for key, demo in demos.items()}
        if verb == "label":
            found["held"] = {key: int(demo["obs/ocp_hint"][:, -1].sum()) for key, demo in demos.items()}
    return found


def _risen(demo: h5py.Group, rows: np.ndarray) -> float:
    """How far the cube rises in those rows, centimetres; from the states, which no observation can belie."""
    heights = demo["states"][:, 12][rows]
    return round(100 * float(np.ptp(heights)), 1) if len(heights) else 0.0


def _red(images: np.ndarray) -> int:
    """How many pixels the red cube covers, summed over the first five frames that were drawn."""
    red, green, blue = np.moveaxis(images[:5].astype(int), -1, 0)
    return int(np.sum((red > 2 * green) & (red > 2 * blue)))


def main(arguments: Sequence[str] | None = None) -> int:
    """Fill the table; the exit status says whether any cell is a traceback."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--inputs", nargs="+", choices=list(INPUTS), default=list(INPUTS))
    parser.add_argument("--output", type=Path, default=OUTPUT)
    options = parser.parse_args(arguments)
    before = json.loads(options.output.read_text(encoding="utf-8"))["rows"] if options.output.exists() else []
    rows = {row["input"]: row for row in before if row["input"] in INPUTS}
    with tempfile.TemporaryDirectory() as folder:
        bench = Bench(Path(folder))
        for name in options.inputs:
            began = time.monotonic()
            rows[name] = bench.row(INPUTS[name])
            sys.stdout.write(f"{name} ({time.monotonic() - began:.0f} s)\n")
            for verb, cell in rows[name]["answers"].items():
                sys.stdout.write(f"    {verb:14}{cell['answer'][:240]}\n")
            sys.stdout.flush()
            ordered = [rows[name] for name in INPUTS if name in rows]
            command = "python tests/border/table.py"
            atomic_json(
                options.output, {"command": command, "machine": machine(), "versions": installed(), "rows": ordered}
            )
    return int(any("unexpected" in cell["answer"] for row in rows.values() for cell in row["answers"].values()))


if __name__ == "__main__":
    sys.exit(main())

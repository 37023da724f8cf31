"""How far bf16 weight storage moves the plans of real frames.

Run from the repository's root: ``python tests/benchmarks/bf16_plans.py IMAGES PLANNER...``, with a data set made by
``ocplanner render`` for the planners' observation. Writes ``results/bf16_plans.json``: for each planner the largest and
the mean displacement of any planned step over frames drawn evenly from all kept ones.
"""

import argparse
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ocplanner import Demonstrations, Planner
from ocplanner.files.storage import atomic_json
from ocplanner.planner.config import PlannerTraining
from ocplanner.planner.frames import CameraFrames, data_settings, load_frames, split
from ocplanner.versions import installed

_OUTPUT = Path("results/bf16_plans.json")


def _degrees(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Angle between rotations (..., 3, 3); by the chord, which is exact for small angles."""
    chord = np.linalg.norm(first - second, axis=(-2, -1)) / np.sqrt(8)
    return np.degrees(2 * np.arcsin(np.minimum(chord, 1)))


def _seen(camera: CameraFrames, mask_rgb: Sequence[int]) -> np.ndarray:
    """The pictures as a planner gets them."""
    pictures = camera.scene.copy()
    if camera.mask is not None:
        pictures[camera.mask] = mask_rgb
    return pictures


def _row(path: Path, data: Path, frames: int) -> dict[str, object]:
    exact, rounded = Planner.load(path), Planner.load(path, storage="bf16")
    about = exact.header
    config = PlannerTraining(cameras=about.cameras, observe=about.observe, seed=about.seed or 0)
    with Demonstrations(data) as demos:
        settings = data_settings(demos, config)
        kept = load_frames(demos, split(demos, config.seed).train, config, settings.object_name, print)
    rows = np.linspace(0, len(kept) - 1, frames).astype(int)
    images = {name: _seen(camera.take(rows), settings.mask_rgb) for name, camera in kept.cameras.items()}
    plans = [planner.plan(images) for planner in (exact, rounded)]
    apart = 1000 * np.linalg.norm(plans[0].position - plans[1].position, axis=-1)
    name = path.parent.name if path.stem == "planner" else path.stem
    row = {"planner": name, "frames": frames, "worst_mm": float(apart.max()), "mean_mm": float(apart.mean())}
    if plans[0].rotation is not None and plans[1].rotation is not None:
        turned = _degrees(plans[0].rotation, plans[1].rotation)
        row |= {"worst_deg": float(turned.max()), "mean_deg": float(turned.mean())}
    return row


def main() -> None:
    """Measure the planners named on the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path)
    parser.add_argument("planners", type=Path, nargs="+")
    parser.add_argument("--frames", type=int, default=1000)
    options = parser.parse_args()
    rows = [_row(path, options.data, options.frames) for path in options.planners]
    atomic_json(_OUTPUT, {"command": shlex.join(["python", *sys.argv]), "versions": installed(), "rows": rows})
    for row in rows:
        print(row)  # noqa: T201


if __name__ == "__main__":
    main()

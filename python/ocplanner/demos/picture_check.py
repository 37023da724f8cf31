"""Stored pictures against renderings of the states that they belong to: which preset drew them, and which way up."""

from collections.abc import Sequence
from typing import get_args

import numpy as np

from ocplanner.demos.dataset import Demonstrations
from ocplanner.demos.demonstration import Demonstration
from ocplanner.demos.recorded_world import RecordedWorld
from ocplanner.envs import make_env
from ocplanner.envs.robots import ROBOTS
from ocplanner.envs.tasks import task_of_env
from ocplanner.envs.visuals import Visual
from ocplanner.errors import DatasetError, MismatchError, UnknownNameError
from ocplanner.files.records.render import RenderRecord

# Mean difference over the pixels and channels of two pictures, 0 to 255. Both presets draw the same scene 0.8 to 14
# apart, upside down it is 35 to 85 away, and one preset's pictures of two OpenGL drivers differ by a few tenths.
_SAME_DRAWING = 0.3
_SAME_PRESET = 3.0
_CLEARLY = 0.5
_SAME_SCENE = 20.0
_COMPARED = 3


def measured_visual(demos: Demonstrations, cameras: Sequence[str], names: Sequence[str] | None = None) -> Visual | None:
    """The visual preset that a data set's pictures were drawn with, by comparing a few of them with renderings.

    Args:
        demos: the data set.
        cameras: cameras with pictures; the first of them that the task has decides.
        names: demonstrations whose pictures are compared; the first one that has states and pictures decides.

    Returns:
        None if nothing can be compared (no states, another task, arm or camera), or if the pictures are of neither
        preset, such as another renderer's.

    Raises:
        MismatchError: the pictures are upside down, or of another preset than the file says, or another arm, gripper or
            scene was recorded.
        RenderingError: no working headless OpenGL.
    """
    rendered = demos.render_record or RenderRecord()
    presets: list[Visual] = sorted(get_args(Visual), key=lambda preset: (preset != rendered.visual, preset != "stock"))
    stored = _stored(demos, cameras, demos.names if names is None else names)
    if stored is None:
        return None
    demo, camera, rows = stored
    pictures = demo.images(camera, rows).astype(np.float64)
    apart: dict[Visual, float] = {}
    for preset in presets:
        drawn = _drawn(demos, demo, camera, rows, preset, rendered.observe, pictures.shape[1:3])
        if drawn is None:
            return None
        apart[preset] = _apart(pictures, drawn)
        if _apart(pictures[:, ::-1], drawn) < min(_SAME_SCENE, _CLEARLY * apart[preset]):
            raise MismatchError(
                f"{demos.path}: the pictures of {camera} in {demo.name} are upside down: turned over, they show the "
                "recorded states; turn them over with `ocplanner convert SOURCE TARGET --flip-images`, or draw them "
                "again with `ocplanner render`"
            )
        if apart[preset] < _SAME_DRAWING:
            break
    nearest = min(apart, key=apart.__getitem__)
    others = [_CLEARLY * apart[preset] for preset in apart if preset != nearest]
    found = nearest if apart[nearest] < min((_SAME_PRESET, *others)) else None
    if None not in (found, rendered.visual) and found != rendered.visual:
        raise MismatchError(
            f"{demos.path}: its record says that the pictures are {rendered.visual}, but those of {camera} in "
            f"{demo.name} are {found} ones; draw them again with `ocplanner render --visual {found}`"
        )
    return found


def _stored(
    demos: Demonstrations, cameras: Sequence[str], names: Sequence[str]
) -> tuple[Demonstration, str, np.ndarray] | None:
    """A demonstration, its camera, and the rows of pictures that are not black; None if there is none with states."""
    for name in names:
        demo = demos[name]
        for camera in (camera for camera in cameras if camera in demo.cameras):
            rows = np.unique(np.linspace(0, demo.length - 1, 4 * _COMPARED).astype(int))
            seen = rows[demo.images(camera, rows).any(axis=(1, 2, 3))]
            if len(seen):
                return demo, camera, seen[:: max(1, len(seen) // _COMPARED)][:_COMPARED]
    return None


def _drawn(
    demos: Demonstrations,
    demo: Demonstration,
    camera: str,
    rows: np.ndarray,
    preset: Visual,
    observe: str,
    size: tuple[int, ...],
) -> np.ndarray | None:
    """(n, h, w, 3) renderings of the states; None where they cannot be made."""
    robots = demos.robots
    try:
        task = task_of_env(demos.env_name)
        if not robots or robots[0] not in ROBOTS or robots != robots[:1] * task.arms:
            return None
        with make_env(task, robots[0], cameras=(camera,), visual=preset) as env:
            world, drawn = RecordedWorld(env, demos.grippers), []
            states = world.open(demo)
            for row in rows:
                world.show(demo, states[row])
                drawn.append(env.render(camera, size[1], size[0], observe))
            return np.array(drawn, dtype=np.float64)
    except (DatasetError, UnknownNameError):
        return None


def _apart(stored: np.ndarray, drawn: np.ndarray) -> float:
    """Median over the pictures of the mean difference."""
    return float(np.median(np.abs(stored - drawn).mean(axis=(1, 2, 3))))

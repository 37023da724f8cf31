"""Draws the two visual presets side by side, for all arms, into ``docs/images/presets.png``.

Run from the repository's root: ``python tests/benchmarks/presets_picture.py``. A row an arm, its hand over the nut of
Square; for each camera ``stock`` and ``fast``, then what ``fast`` gives as ``masked`` and ``no-robot``.
"""

import argparse
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from ocplanner.envs import ManipulationEnv, make_env
from ocplanner.envs.robots import ROBOTS
from ocplanner.geometry.pose import Pose

_OUTPUT = Path("docs/images/presets.png")
_TASK = "Square"
_CAMERAS = ("agentview", "robot0_eye_in_hand")
_OBSERVE = ("masked", "no-robot")
_OVER_THE_GRASP_M = 0.04
_SEED = 2
_LABEL, _GAP, _HEADER = 64, 3, 32
_SETTLING_STEPS = 6

COLUMNS = [(camera, visual, "full") for camera in _CAMERAS for visual in ("stock", "fast")] + [
    (_CAMERAS[0], "fast", observe) for observe in _OBSERVE
]


def over_the_object(env: ManipulationEnv) -> None:
    """Start an episode, let the object come to rest, and put the hand over it."""
    env.reset(_SEED)
    for _ in range(_SETTLING_STEPS):
        env.step(np.zeros(env.action_dim))
    grasp = env.object_pose() @ env.task.object().grasps[0].pose_object_eef
    over = grasp.position + np.array([0, 0, _OVER_THE_GRASP_M])
    env.place_eef(Pose(over, grasp.rotation @ env.robot.rotation_grasp_site))


def pictures(robot: str, size: int) -> list[np.ndarray]:
    """(size, size, 3) uint8 for each of :data:`COLUMNS`; the arm stands alike in all."""
    drawn = {}
    for visual in ("stock", "fast"):
        with make_env(_TASK, robot, visual=visual) as env:
            over_the_object(env)
            for camera, preset, observe in COLUMNS:
                if preset == visual:
                    drawn[camera, preset, observe] = env.render(camera, size, size, observe)
    return [drawn[column] for column in COLUMNS]


def page(rows: dict[str, list[np.ndarray]], size: int) -> Image.Image:
    """The rows under a header that names the columns."""
    step = size + _GAP
    image = Image.new("RGB", (_LABEL + step * len(COLUMNS), _HEADER + step * len(rows)), "white")
    draw = ImageDraw.Draw(image)
    for column, (camera, visual, observe) in enumerate(COLUMNS):
        text = f"{camera}\n{visual}" + (f", {observe}" if observe != "full" else "")
        draw.text((_LABEL + step * column, 2), text, fill="black")
    for row, (robot, drawn) in enumerate(rows.items()):
        draw.text((4, _HEADER + step * row + size // 2), robot, fill="black")
        for column, picture in enumerate(drawn):
            image.paste(Image.fromarray(picture), (_LABEL + step * column, _HEADER + step * row))
    return image


def main() -> None:
    """Draw the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", nargs="*", choices=list(ROBOTS), default=list(ROBOTS))
    parser.add_argument("--size", type=int, default=140, help="side of a picture, pixels")
    parser.add_argument("--output", type=Path, default=_OUTPUT)
    options = parser.parse_args()
    image = page({robot: pictures(robot, options.size) for robot in options.robots}, options.size)
    options.output.parent.mkdir(parents=True, exist_ok=True)
    image.quantize(256, dither=Image.Dither.NONE).save(options.output, optimize=True)


if __name__ == "__main__":
    main()

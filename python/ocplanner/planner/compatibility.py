"""Whether a data set shows a planner what it was trained to see."""

from typing import Any

from ocplanner.demos.dataset import Demonstrations
from ocplanner.demos.recorded_task import recorded_task
from ocplanner.errors import DatasetError, MismatchError
from ocplanner.files.records.render import RenderRecord
from ocplanner.planner.planner import Planner


def check_fit(planner: Planner, demos: Demonstrations) -> None:
    """Check task, object, cameras, observation, image size, visual preset and mask colour.

    Raises:
        DatasetError: images of a camera are missing.
        MismatchError: the planner was made for something else.
    """
    config, render = planner.config, demos.render_record or RenderRecord()
    task = recorded_task(demos.env_name)
    if task is None or task.name != config["task"] or config["object"] not in task.parts:
        raise MismatchError(
            f"{planner.path} plans for {config['object']} of {config['task']}, but {demos.path} shows "
            f"{demos.env_name}; use a planner of that task"
        )
    remedy = _remedy(planner)
    missing = [camera for camera in config["cameras"] if camera not in demos.cameras]
    if missing:
        raise DatasetError(
            f"{demos.path}: no images of camera {', '.join(missing)}, which the planner wants (there are: "
            f"{', '.join(demos.cameras) or 'none'}); add them with {remedy}"
        )
    for name, found in (("observe", render.observe), ("visual", render.visual)):
        if config[name] not in (None, found):
            raise MismatchError(
                f"{demos.path} was drawn with {name}={found or 'unknown'}, but {planner.path} was trained on "
                f"{config[name]}; draw it again with {remedy} (labelling takes a second file as --pictures)"
            )
    colour = None if render.mask_rgb is None else list(render.mask_rgb)
    if config["observe"] == "masked" and colour != config["mask_rgb"]:
        raise MismatchError(
            f"{demos.path}: masks have the colour {colour}, but {planner.path} was trained on "
            f"{config['mask_rgb']}; draw it again with {remedy}"
        )
    for camera in config["cameras"]:
        height, width = demos[0].images(camera, slice(0, 1)).shape[1:3]
        if (height, width) != (config["image_size"],) * 2:
            raise MismatchError(
                f"{demos.path}: images of {camera} are {width}x{height}, but the planner wants "
                f"{config['image_size']}x{config['image_size']}; draw them again with {remedy}"
            )


def _remedy(planner: Planner) -> str:
    config: dict[str, Any] = dict(planner.config)
    preset = f" --visual {config['visual']}" if config["visual"] else ""
    return (
        f"`ocplanner render SOURCE TARGET --observe {config['observe']} --cameras {' '.join(config['cameras'])} "
        f"--size {config['image_size']}{preset}`"
    )

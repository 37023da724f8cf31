"""Whether a data set fits a planner."""

from collections.abc import Sequence

from ocplanner.demos.control_frequency import control_frequency
from ocplanner.demos.dataset import Demonstrations
from ocplanner.demos.picture_check import measured_visual
from ocplanner.demos.recorded_task import recorded_task
from ocplanner.errors import MismatchError, RenderingError
from ocplanner.files.records.render import RenderRecord
from ocplanner.planner.planner import Planner


def check_fit(planner: Planner, demos: Demonstrations) -> None:
    """Check that a data set has the planner's task, object, cameras, observation, image size, preset and mask colour.

    Raises:
        DatasetError: the data set does not say its task.
        MismatchError: the planner was made for something else, images of a camera are missing, or they are upside down.
    """
    header, render = planner.header, demos.render_record or RenderRecord()
    demos.require_task_named()
    task = recorded_task(demos.env_name)
    if task is None or task.name != header.task or header.object not in task.parts:
        raise MismatchError(
            f"{planner.path} plans for {header.object} of {header.task}, but {demos.path} shows "
            f"{demos.env_name}; use a planner of that task"
        )
    frequency = control_frequency(demos, demos.names[0])
    if frequency != header.control_freq:
        raise MismatchError(
            f"{demos.path} was recorded at {frequency:g} Hz, but {planner.path} was trained on demonstrations of "
            f"{header.control_freq:g} Hz; use a planner trained on demonstrations of {frequency:g} Hz"
        )
    remedy = _remedy(planner)
    missing = [camera for camera in header.cameras if camera not in demos.cameras]
    if missing:
        raise MismatchError(
            f"{demos.path}: no images of camera {', '.join(missing)}, which the planner reads (there are: "
            f"{', '.join(demos.cameras) or 'none'}); add them with {remedy}"
        )
    visual = render.visual if render.visual or not header.visual else _measured(demos, header.cameras)
    for name, wanted, found in (("observe", header.observe, render.observe), ("visual", header.visual, visual)):
        if wanted not in (None, found):
            raise MismatchError(
                f"{demos.path} was drawn with {name}={found or 'unknown'}, but {planner.path} was trained on "
                f"{wanted}; draw it again with {remedy} (labelling takes a second file as --pictures)"
            )
    if header.observe == "masked" and render.mask_rgb != header.mask_rgb:
        raise MismatchError(
            f"{demos.path}: masks have the colour {render.mask_rgb}, but {planner.path} was trained on "
            f"{header.mask_rgb}; draw it again with {remedy}"
        )
    for camera in header.cameras:
        height, width = demos[0].images(camera, slice(0, 1)).shape[1:3]
        if (height, width) != (header.image_size,) * 2:
            raise MismatchError(
                f"{demos.path}: images of {camera} are {width}x{height}, but the planner reads "
                f"{header.image_size}x{header.image_size}; draw them again with {remedy}"
            )


def _measured(demos: Demonstrations, cameras: Sequence[str]) -> str | None:
    """The preset of pictures whose file does not say it; None if that cannot be seen."""
    try:
        return measured_visual(demos, cameras)
    except RenderingError:
        return None


def _remedy(planner: Planner) -> str:
    header = planner.header
    preset = f" --visual {header.visual}" if header.visual else ""
    return (
        f"`ocplanner render SOURCE TARGET --observe {header.observe} --cameras {' '.join(header.cameras)} "
        f"--size {header.image_size}{preset}`"
    )

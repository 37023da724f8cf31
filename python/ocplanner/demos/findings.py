"""What a user should know about a data set before using it: everything that some verb would refuse or change."""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from ocplanner.demos.action_frame import ActionFrame
from ocplanner.demos.control_frequency import control_frequency
from ocplanner.demos.convert import Converter
from ocplanner.demos.dataset import Demonstrations
from ocplanner.demos.demonstration import Demonstration
from ocplanner.demos.picture_check import measured_visual
from ocplanner.demos.segments import manipulation_segment
from ocplanner.demos.soundness import faults
from ocplanner.envs import CONTROL_HZ
from ocplanner.errors import OcplannerError

_NAMED = 12


def findings(demos: Demonstrations) -> list[str]:
    """One line for each finding; empty if there is nothing to say."""
    found = [*_of_masks(demos), *of_gripper(demos)]
    bad = faults(demos, demos.names, _readable(demos))
    found += [f"{name} cannot be used: {reason}" for name, reason in list(bad.items())[:_NAMED]]
    if len(bad) > _NAMED:
        found.append(f"{len(bad) - _NAMED} more demonstrations cannot be used")
    sound = [demos[name] for name in demos.names if name not in bad]
    if sound:
        for look in (_of_origin, _of_actions, _of_pictures):
            try:
                found += look(demos, sound)
            except OcplannerError as error:
                found.append(str(error))
    return list(dict.fromkeys(found))  # one fault may be found on several ways


def _readable(demos: Demonstrations) -> Callable[[Demonstration], None]:
    """Reads everything that is recorded of a demonstration but pictures."""
    try:
        parts = [part for spec in demos.task().objects for part in spec.parts]
    except OcplannerError:
        parts = []

    converter = Converter(demos)

    def read(demo: Demonstration) -> None:
        converter.check(demo)
        for part in parts:
            demo.manipulation(part)

    return read


def _of_masks(demos: Demonstrations) -> Iterator[str]:
    listed = {mask: demos.listed(mask) for mask in demos.mask_names}
    for mask, names in listed.items():
        twice = sorted(name for name, count in Counter(names).items() if count > 1)
        if twice:
            yield f"mask/{mask} names {_some(twice)} more than once; each counts once"
        absent = sorted(set(names) - set(demos.names))
        if absent:
            yield f"mask/{mask} names {_some(absent)}, which data does not contain"
    both = sorted(set(listed.get("train", ())) & set(listed.get("valid", ())))
    if both:
        yield f"mask/train and mask/valid share {_some(both)}; training refuses that"


def of_gripper(demos: Demonstrations) -> Iterator[str]:
    """Whether the first demonstration makes sense only if positive actions open the gripper."""
    try:
        demo, part = demos[0], demos.task().objects[0].parts[0]
        poses, actions = demo.object_poses(part), demo.carrier_actions(part)
    except OcplannerError:
        return
    carried = [True, True]
    for way, sign in enumerate((1.0, -1.0)):
        try:
            manipulation_segment(*poses, sign * actions)
        except OcplannerError:
            carried[way] = False
    if carried == [False, True]:
        yield (
            f"{part} is carried only while the gripper's action is negative: positive ones must close it; turn them "
            "round with `ocplanner convert --flip-gripper`"
        )


def _of_origin(demos: Demonstrations, sound: Sequence[Demonstration]) -> Iterator[str]:
    if demos.kind == "robosuite":
        yield "a raw recording of robosuite: observations, poses and rewards are derived from its states"
        late = [demo.name for demo in sound if demo.recorded_late]
        if late:
            yield f"the states of {_some(late)} were recorded after the actions: the first action is left out"
    elif demos.kind == "other":
        yield "it does not say its task and robot: only policies can be trained on it (train-policy --low-dim KEYS)"
        return
    elif sound[0].derived_keys:
        yield "states alone: observations and poses are derived from them"
    yield from _told(lambda: _frequency(demos, sound[0].name))
    yield from _told(lambda: _compared(demos, sound[0]))


def _of_actions(demos: Demonstrations, sound: Sequence[Demonstration]) -> Iterator[str]:
    beyond = sum(int((np.abs(demo.recorded_actions) > 1).any(axis=1).sum()) for demo in sound)
    if beyond:
        clipped = np.abs(sound[0].actions).max() <= 1
        answer = "they are clipped, as the recording's controller did" if clipped else "the controller does not clip"
        yield f"actions of {beyond} of {sum(demo.length for demo in sound)} steps lie outside [-1, 1]; {answer}"
    if demos.kind == "other":
        return
    yield from _told(lambda: _deltas(demos))


def _of_pictures(demos: Demonstrations, sound: Sequence[Demonstration]) -> Iterator[str]:
    rendered = demos.render_record
    for camera in demos.cameras:
        black = [demo.name for demo in sound if not demo.images(camera, slice(0, None, 10)).any(axis=(1, 2, 3)).all()]
        if black and (rendered is None or rendered.frames == "all"):
            yield f"{camera} has black pictures in {_some(black)}"
    if demos.cameras and demos.kind != "other":
        yield from _told(lambda: _drawn(demos, sound))


def _told(look: Callable[[], str | None]) -> Iterator[str]:
    """What a look at the data set says, or the error that it ends in, without the file's name."""
    try:
        line = look()
    except OcplannerError as error:
        line = str(error)
    if line:
        yield line


def _frequency(demos: Demonstrations, name: str) -> str | None:
    found = control_frequency(demos, name)
    return (
        None if found == CONTROL_HZ else f"recorded at {found:g} Hz; ocplanner's own recordings are at {CONTROL_HZ:g}"
    )


def _compared(demos: Demonstrations, demo: Demonstration) -> None:
    """Compare the recorded world with the simulated one."""
    demos.compare_world(demo)


def _deltas(demos: Demonstrations) -> None:
    ActionFrame(demos).close()


def _drawn(demos: Demonstrations, sound: Sequence[Demonstration]) -> str | None:
    found = measured_visual(demos, demos.cameras, [demo.name for demo in sound])
    if demos.render_record is None and found is not None:
        return f"the pictures are those of the visual preset {found}"
    return None


def _some(names: Sequence[str]) -> str:
    shown = ", ".join(names[:3])
    return shown if len(names) <= 3 else f"{shown} and {len(names) - 3} more"

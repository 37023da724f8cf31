"""What ``ocplanner evaluate`` would refuse of a policy, so that ``train-policy`` can say it before training."""

from typing import NamedTuple

from ocplanner.demos.layouts import TASK_OBJECTS
from ocplanner.demos.object_sensors import OBJECT_SENSORS, Sensors, sensors_of
from ocplanner.demos.recorded_observation import HAND_KEYS
from ocplanner.envs import CONTROL_HZ, CONTROL_RANGE_HZ, make_env
from ocplanner.envs.robots import ROBOTS
from ocplanner.envs.tasks import tasks
from ocplanner.envs.visuals import PRESETS
from ocplanner.errors import MismatchError, UnknownNameError
from ocplanner.files.records.policy import PolicyHeader
from ocplanner.policies.config import HINT_KEY, PolicyTraining
from ocplanner.policies.policy import Policy

ACTIONS_FAULT = "its actions are no OSC_POSE deltas of one arm, so they cannot be carried out here"


class Obstacle(NamedTuple):
    """Why a policy cannot be evaluated.

    Attributes:
        fault: what it is, with the value found.
        remedy: the way on.
        chosen: whether settings of the training brought it about; else it lies in the data set.
    """

    fault: str
    remedy: str
    chosen: bool = False

    def __str__(self) -> str:
        """Fault and remedy."""
        return f"{self.fault}; {self.remedy}"


def obstacles(header: PolicyHeader, training: PolicyTraining) -> list[Obstacle]:
    """All that stands between a policy and its evaluation in simulation; empty if nothing does.

    Args:
        header: of the policy's file, or what the file would say.
        training: its settings.
    """
    simulated = header.task in tasks()
    return [*_world(header), *(_observations(header, training) if simulated else [])]


def check_evaluable(policy: Policy) -> None:
    """Check that nothing stands between a policy and its evaluation.

    Raises:
        MismatchError: something does; the message gives all of it.
    """
    found = obstacles(policy.header, policy.training)
    if found:
        raise MismatchError(f"{policy.path}: {'. Also: '.join(map(str, found))}")


def object_of(header: PolicyHeader) -> Sensors | None:
    """The sensors of the ``object`` that a policy reads; None where its file does not settle them.

    Files that do not name sensors say in which order poses come. That settles nuts and what PickPlace carries, whose
    two orders were told apart when those files were written.
    """
    env_name = _env_name(header)
    if header.object_sensors is not None:
        return header.object_sensors if header.object_sensors in OBJECT_SENSORS.get(env_name, {}).values() else None
    layout = TASK_OBJECTS.get(env_name)
    if header.object_layout is None or layout is None or not layout.relative:
        return None
    return sensors_of(env_name, header.object_layout)


def _env_name(header: PolicyHeader) -> str:
    known = tasks().get(header.task)
    return header.environment or ("" if known is None else known.env_name)


def _world(header: PolicyHeader) -> list[Obstacle]:
    found = []
    if header.task not in tasks():
        known = ", ".join(tasks())
        found.append(Obstacle(f"its task is {header.task or 'not named'}", f"tasks that can be simulated are {known}"))
    robots = " and ".join(header.robots)
    if len(header.robots) != 1 or robots not in ROBOTS:
        known = ", ".join(ROBOTS)
        found.append(
            Obstacle(f"its data set names {robots or 'no robot'} as its robot", f"one of these can act: {known}")
        )
    slowest, fastest = CONTROL_RANGE_HZ
    if not slowest <= header.control_freq <= fastest:
        fault = f"it was recorded at {header.control_freq:g} Hz"
        found.append(Obstacle(fault, f"the simulation is controlled {slowest:g} to {fastest:g} times a second"))
    if header.action_frame is None:
        found.append(Obstacle(ACTIONS_FAULT, "record the data set with that controller"))
    return found


def _observations(header: PolicyHeader, training: PolicyTraining) -> list[Obstacle]:
    found = []
    live = (*HAND_KEYS, *(["object"] if object_of(header) is not None else []), HINT_KEY)
    missing = [key for key in training.observation.low_dim if key not in live]
    if missing == ["object"] and header.object_layout is not None and header.object_sensors is None:
        fault = "it reads object, whose sensors differ between robosuite versions, and its file does not name them"
        found.append(Obstacle(fault, "train it again"))
    elif missing:
        fault = f"it reads {', '.join(missing)}, which cannot be had live"
        found.append(Obstacle(fault, f"these can be: {', '.join(live)} (--low-dim)", chosen=True))
    if training.reads_hints and header.labels is None:
        fault = "its hints were not made by `ocplanner label`, so they cannot be made live"
        found.append(Obstacle(fault, "label the data set with `ocplanner label`"))
    if training.reads_hints and header.control_freq != CONTROL_HZ:
        fault = f"it was recorded at {header.control_freq:g} Hz, but hints are made for {CONTROL_HZ:g} Hz"
        found.append(Obstacle(fault, "train without hints"))
    return [*found, *_cameras(header, training)]


def _cameras(header: PolicyHeader, training: PolicyTraining) -> list[Obstacle]:
    cameras, visual = training.observation.cameras, None if header.render is None else header.render.visual
    if visual is not None and visual not in PRESETS:
        fault, known = f"its pictures were drawn with the visual preset {visual!r}", ", ".join(PRESETS)
        return [Obstacle(fault, f"render the data set again with one of {known} (`ocplanner render --visual`)")]
    if not cameras or header.robots[:1] == () or header.robots[0] not in ROBOTS:
        return []
    try:
        make_env(header.task, header.robots[0], cameras=cameras).close()
    except UnknownNameError as error:
        return [Obstacle(f"its pictures cannot be had live: {error}", "learn from other ones (--cameras)", chosen=True)]
    return []

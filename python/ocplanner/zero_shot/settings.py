"""The conditions of a transfer: every setting that decides how its episodes go, beside planner, robot and seed.

To add a condition, add a field whose default changes nothing to :class:`TransferConfig`, and the line that uses it. The
commands, the workers, the result files, their names and the report take it from here.
"""

from collections.abc import Iterator, Mapping
from dataclasses import MISSING, Field, dataclass, field, fields, is_dataclass
from typing import Annotated, Any, Literal, Self, get_args

import tyro

from ocplanner.control.noisy_pose import PoseError
from ocplanner.control.settings import ControlSettings, FollowMode
from ocplanner.envs import ControlLoop
from ocplanner.envs.robots import ROBOTS
from ocplanner.envs.visuals import Visual
from ocplanner.settings import build, require, require_choice, to_dict

_FOLLOW_FLAG = tyro.constructors.PrimitiveConstructorSpec(
    nargs=1,
    metavar=f"{{{','.join(get_args(FollowMode))}}}",
    choices=get_args(FollowMode),
    instance_from_str=lambda words: ControlSettings(follow=words[0]),
    is_instance=lambda settings: isinstance(settings, ControlSettings),
    str_from_instance=lambda settings: [settings.follow],
)
"""The command line sets the follow mode alone; the numbers of the control law are set from Python."""


def _label(name: str, text: str) -> dict[str, str]:
    """How file names and readers call a setting that is not the default, ``{}`` being its value; empty: not at all."""
    return {"name": name, "text": text}


@dataclass(frozen=True)
class TransferConfig:
    """How the episodes are run.

    Raises:
        UnknownNameError: there is no such visual preset or control loop.
        InvalidValueError: a number is outside its domain.
    """

    control: Annotated[ControlSettings, _FOLLOW_FLAG, tyro.conf.arg(name="follow")] = field(
        default_factory=ControlSettings
    )
    """gated: advance along the plan when the object is there. time: by the clock. open-loop: send the plan's
    differences, as the paper does."""
    visual: Visual | None = field(default=None, metadata=_label("{}", "{} visuals"))
    """Visual preset; must be the one that the planner was trained on, which is the default."""
    allow_mismatch: bool = field(default=False, metadata=_label("", ""))
    """Draw with --visual although the planner was trained on another preset."""
    patches: bool = field(default=True, metadata=_label("unpatched", "no patches"))
    """Apply the corrections that the robot's model needs; they are named in the result."""
    control_loop: Annotated[ControlLoop, tyro.conf.arg(name="control")] = field(
        default="native", metadata=_label("{}-loop", "{} control loop")
    )
    """Who runs the control loop: stock is robosuite's own, slower, with the same torques."""
    mask_error: Annotated[int, tyro.conf.arg(metavar="PIXELS")] = field(
        default=0, metadata=_label("error{}", "mask {} px off")
    )
    """Make the robot's mask wrong by so many pixels."""
    pose_noise: Annotated[tuple[float, float], tyro.conf.arg(metavar="MM DEG")] = field(
        default=(0.0, 0.0), metadata=_label("noise{:g}mm{:g}deg", "pose noise {:g} mm {:g}°")
    )
    """Add noise to the object's pose as grasping and following read it, anew each control step: standard deviations of
    its position along each axis and of its angle about a random axis."""
    pose_latency: Annotated[int, tyro.conf.arg(metavar="STEPS")] = field(
        default=0, metadata=_label("latency{}", "{}-step pose latency")
    )
    """Make that pose so many control steps (0.05 s) old."""
    pose_filter: Annotated[int, tyro.conf.arg(metavar="STEPS")] = field(
        default=1, metadata=_label("filter{}", "averaged over {} steps")
    )
    """Average that pose over so many control steps, in the hand's frame while it is closed; 1 takes it as it is."""

    def __post_init__(self) -> None:
        """Check the values."""
        if self.visual is not None:
            require_choice("visual preset", self.visual, Visual)
        require_choice("control loop", self.control_loop, ControlLoop)
        require(self.mask_error >= 0, f"mask_error is {self.mask_error} pixels, but must not be negative")
        require(self.pose_filter >= 1, f"pose_filter is {self.pose_filter} steps, but must be at least 1")
        PoseError(*self.pose_noise, self.pose_latency)

    @property
    def pose_error(self) -> PoseError:
        """The error of the object's pose as grasping and following read it."""
        return PoseError(*self.pose_noise, self.pose_latency)

    @property
    def names(self) -> tuple[str, ...]:
        """The follow mode and every setting that is not the default, for file names."""
        return tuple(self._labels("name"))

    @property
    def texts(self) -> tuple[str, ...]:
        """The same for readers."""
        return tuple(self._labels("text"))

    def _labels(self, kind: Literal["name", "text"]) -> Iterator[str]:
        yield self.control.follow
        for entry, value in _changed(self):
            if entry.name == "follow":
                continue
            plain = entry.name.replace("_", "-") + "{}" if kind == "name" else entry.name.replace("_", " ") + " {}"
            label = entry.metadata.get(kind, plain).format(*value if isinstance(value, tuple) else (value,))
            if label:
                yield label

    def to_json(self) -> dict[str, Any]:
        """All settings as JSON types."""
        return to_dict(self)

    @classmethod
    def from_result(cls, content: Mapping[str, Any]) -> Self:
        """The settings that a result file of any format states.

        Files of format 1 state each condition in a key of its own, and no number of the control law: these are today's
        here. That patches were off shows only where the robot has some.

        Raises:
            KeyError, TypeError, ValueError: a setting is missing, unknown or outside its domain.
        """
        return build(cls, content["settings"] if "settings" in content else _of_format_1(content))


def _of_format_1(content: Mapping[str, Any]) -> dict[str, Any]:
    error = content.get("pose_error", {})
    drawn, trained = content.get("visual"), content.get("planner_visual")
    robot = ROBOTS.get(content["robot"])
    return {
        "control": {"follow": content["follow"]},
        "visual": None if drawn == trained else drawn,
        "allow_mismatch": trained is not None and drawn != trained,
        "patches": bool(content["patches"]) or robot is None or not robot.patches,
        "control_loop": content.get("control", "native"),
        "mask_error": content.get("mask_error", 0),
        "pose_noise": (error.get("position_mm", 0.0), error.get("rotation_deg", 0.0)),
        "pose_latency": error.get("latency_steps", 0),
        "pose_filter": content.get("pose_filter", 1),
    }


def _changed(settings: Any) -> Iterator[tuple[Field[Any], Any]]:
    """The fields that are not at their defaults, those of nested settings in place, with their values."""
    for entry in fields(settings):
        value = getattr(settings, entry.name)
        if is_dataclass(value):
            yield from _changed(value)
        elif value != (entry.default if entry.default_factory is MISSING else entry.default_factory()):
            yield entry, value

"""Every number of the control laws, in one place.

Lengths are in metres, angles in radians and durations in control steps (20 Hz) unless a field says otherwise.
"""

from dataclasses import dataclass, field, replace
from typing import Literal

from ocplanner import _core
from ocplanner.envs.tasks import ObjectSpec
from ocplanner.settings import require, require_choice

FollowMode = Literal["gated", "time", "open-loop"]


@dataclass(frozen=True)
class GraspSettings:
    """The grasp primitive."""

    settle_steps: int = 6
    """Steps to wait, gripper open, for the object to drop and come to rest."""
    hover: float = 0.08
    """Height above the grasp from which the hand descends."""
    clearance: float = 0.005
    """Height above the grasp frame at which the fingers close: linked fingers reach lower as they do, and must not
    scrape over what the object lies on."""
    beside: float = 0.01
    """Distance of a grasp from the object's middle above which the object is held beside its middle."""
    near: float = 0.006
    """Distance from the grasp at which the gripper closes."""
    near_above: float = 3.0
    """Factor on ``near`` for the point above the grasp."""
    near_rotation: float = 0.1
    """Angle from the grasp at which the gripper closes."""
    slow: float = 0.003
    """Motion in a step above which the hand has not arrived yet."""
    arriving: float = 0.5
    """Share of the distance that counts as near by which the hand may move in a step and still have arrived, if that is
    more than ``slow``."""
    steep: float = 0.012
    """Distance from the vertical through the grasp within which the hand descends between walls."""
    approach_steps: int = 120
    """Steps allowed for each leg of the approach, and for the trial lift."""
    still: float = 0.0002
    """Motion of the hand, or change of the gripper's opening, in a step below which it has stopped."""
    still_steps: int = 4
    """Steps without motion after which the fingers have met the object, or each other."""
    stalled_steps: int = 8
    """Steps without motion after which the hand is as near as this arm gets, and how much longer than its full stroke a
    gripper may take to close."""
    probe: float = 0.03
    """Height of the trial lift that tells a hold from a miss."""
    held: float = 0.02
    """Distance that the grip point may wander on the object before the hold counts as lost."""
    freed: float = 0.03
    """Gain of the gripper's opening that frees any object."""
    partly_freed: float = 0.006
    """Gain of the gripper's opening that frees the object if the fingers then rest..."""
    rest_steps: int = 2
    """...for so many steps."""
    reopen_part: int = 5
    """Before another try the gripper gets one part in so many of its full stroke to open."""
    tries: int = 3
    """Grasps of an object: the first and the recoveries."""


@dataclass(frozen=True)
class FollowSettings:
    """The follower: see ``docs/control.md`` for the phases between which these numbers decide."""

    replan_steps: int = 4
    """Steps between two plans."""
    gate_position: float = 0.025
    """Distance from a planned pose that counts as there."""
    gate_rotation: float = 0.2
    """Angle from a planned pose that counts as there."""
    reach: float = 0.004
    """Reach error at the plan's end above which an equivalent rotation of the object is looked for; another one must be
    better by as much."""
    resting: float = 0.002
    """Motion in a step below which the object is at rest."""
    turn_lever: float = 0.1
    """Metres of motion that a turn by a radian counts for where the object is led along the plan pose by pose."""

    lift_first: float = 0.05
    """Height gained before moving sideways, if the plan lifts at all."""
    lift_beyond: float = 0.02
    """How far above that height the object is drawn, so that it passes it."""
    lifting: float = 0.02
    """A plan that rises by less does not lift."""

    stuck: float = 0.0015
    """Motion in a step below which the object does not move although it should."""
    stuck_steps: int = 8
    """Steps without motion that count as stuck."""
    unstick_lift: float = 0.045
    """Height gained to come free."""
    unstick_near: float = 0.01
    """Distance below that height at which the object has come free."""
    unstick_steps: int = 14
    """Steps after which coming free ends in any case."""

    goal_memory: int = 12
    """Plans whose ends are put together into one goal."""
    lowering: float = 0.03
    """The plan lowers the object when it ends so far below the highest point reached. An object that is inserted has
    been let down when it has descended as far."""
    depth: float = 0.25
    """Quantile of those plans' lowest points that counts as the goal's height."""
    aligned: float = 0.005
    """Horizontal distance from the goal at which the object is let down."""
    aligned_rotation: float = 0.2
    """Angle from the goal at which the object is let down."""
    patience: int = 25
    """Steps after which the alignment is good enough within a wider tolerance."""
    patient_slack: float = 2.0
    """Factor on the tolerance then."""
    lower_step: float = 0.01
    """Height by which the target is below the object while it is let down: gently, or it slips out of the hand."""
    press: float = 0.03
    """Depth below the goal to which the object is let down: one that hangs free goes there, one that rests on an edge
    does not."""
    slip: float = 0.006
    """Motion of the grip point, while the object is let down, that shows that the object rests on an edge."""
    search: float = 0.0035
    """Radius of the first ring of places tried after wedging."""

    closing_in: float = 0.08
    """Length of a plan below which an object that is traced follows it pose by pose within ``aligned``."""
    wedged: float = 0.005
    """Motion below which an object that is traced is wedged..."""
    wedged_steps: int = 16
    """...over so many steps."""

    recent_plans: int = 4
    """Plans that must end where the object is before it has arrived."""
    release: float = 0.02
    """Distance from the plans' ends within which the object may be released or kept; horizontal where it is dropped."""
    hanging: float = 0.6
    """Share of ``press`` below the goal at which an object hangs free."""
    attempts: int = 4
    """Times of coming free after which an object at rest by the goal is let go all the same."""
    traced_slack: float = 2.0
    """Factor on the tolerance within which an object that is traced has arrived..."""
    traced_patient_slack: float = 4.0
    """...and after ``patience`` steps without motion."""
    meeting: float = 0.05
    """Distance from the plans' ends within which the object may be handed over: the taker looks where it is."""

    def for_object(self, spec: ObjectSpec, *, lifts: bool = True) -> "FollowSettings":
        """These settings with the object's own numbers in place of the general ones.

        Args:
            spec: the object.
            lifts: whether the object's own lift counts: it lies where its way begins.
        """
        rule = self
        if spec.tolerance is not None:
            position, rotation = spec.tolerance
            near = max(rule.release, 2 * position)
            rule = replace(rule, aligned=position, aligned_rotation=rotation, release=near)
        if spec.descent is not None:
            rule = replace(rule, lower_step=spec.descent)
        if lifts and spec.lift is not None:
            rule = replace(rule, lift_first=spec.lift[0])
        return rule


@dataclass(frozen=True)
class OpenHandSettings:
    """Moving the open hand: away from an object, and past the places on the way to one."""

    near: float = 0.02
    """Distance from a place that the hand passes at which it is there."""
    near_rotation: float = 0.15
    """Angle from such a place at which the hand is there."""
    stalled: float = 0.0015
    """Motion in a step (a radian counts as a metre) below which the hand does not get on..."""
    stalled_steps: int = 8
    """...and after so many steps gives up."""
    go_steps: int = 120
    """Steps allowed to each place."""
    retreat: float = 0.12
    """Way of the hand after the release."""
    rise_beyond: float = 0.02
    """How far above the wanted height a rising hand is drawn, so that it passes it."""
    rise_steps: int = 60
    """Steps allowed to rise."""
    swing: float = 2e-5
    """Motion in a step below which an object that was hung up no longer swings."""
    swing_steps: int = 60
    """Steps allowed for that."""


@dataclass(frozen=True)
class SeveralArmsSettings:
    """Arms that wait for each other and hand objects over."""

    level: float = 0.03
    """Height below its waiting place up to which a hand that rises first goes straight up."""
    far: float = 0.5
    """Distance of a meeting from the taker's home above which the taker stays there."""
    beside: float = 0.13
    """Horizontal distance from the meeting at which the taker waits..."""
    above: float = 0.08
    """...and height above it."""
    lean: float = 0.25
    """Angle by which the taker's palm is tilted away from the giver's, or their wrists meet."""
    leave_steps: int = 30
    """Steps that the giver gets to rise from the object."""
    away: float = 0.06
    """Distance below the top of that rise from which the giver is out of the way."""


@dataclass(frozen=True)
class ControlSettings:
    """How a plan is carried out.

    Raises:
        UnknownNameError: no such follow mode.
        InvalidValueError: a number out of its domain.
    """

    follow: str = "gated"
    """How a plan is followed: ``gated`` advances along it only as the object does, ``time`` by the clock, ``open-loop``
    adds up its differences (the paper's)."""
    gain: float = 1.5
    """Factor on commanded differences: a constant command u moves the hand only about 0.31 u a step."""
    limit_rotation: float = 0.2
    """Largest rotation commanded in a step."""
    grasp: GraspSettings = field(default_factory=GraspSettings)
    following: FollowSettings = field(default_factory=FollowSettings)
    open_hand: OpenHandSettings = field(default_factory=OpenHandSettings)
    several_arms: SeveralArmsSettings = field(default_factory=SeveralArmsSettings)

    def __post_init__(self) -> None:
        """Check the values."""
        require_choice("follow mode", self.follow, FollowMode)
        require(self.gain > 0, f"gain is {self.gain}, but must be positive")
        steps = self.following.replan_steps
        require(steps >= 1, f"replan_steps is {steps}, but must be at least 1")

    @property
    def gated(self) -> bool:
        """Whether the plan waits for the object; the other modes do not."""
        return self.follow == "gated"

    @property
    def law(self) -> _core.DeltaPoseLaw:
        """How a pose difference becomes an action."""
        return _core.DeltaPoseLaw(gain_position=self.gain, gain_rotation=self.gain, limit_rotation=self.limit_rotation)

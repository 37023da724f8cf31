"""Every number of the zero-shot loop, in one place."""

from dataclasses import dataclass, field
from typing import Literal, get_args

from ocplanner.errors import InvalidValueError, UnknownNameError

Follow = Literal["gated", "time", "open-loop"]
FOLLOW_MODES: tuple[str, ...] = get_args(Follow)


@dataclass(frozen=True)
class GraspSettings:
    """The grasp primitive. Lengths in metres, angles in radians, durations in control steps (20 Hz)."""

    settle_steps: int = 6
    """Steps to wait, gripper open, for the object to drop and come to rest."""
    hover: float = 0.08
    """Height above the grasp from which the hand descends."""
    clearance: float = 0.005
    """Height above the grasp frame at which the fingers close: linked fingers reach lower as they do, and must not
    scrape over what the object lies on."""
    near: float = 0.006
    """Distance from the grasp at which the gripper closes."""
    steep: float = 0.012
    """Distance from the vertical through the grasp within which the hand comes down between walls."""
    near_rotation: float = 0.1
    """Angle from the grasp at which the gripper closes."""
    slow: float = 0.003
    """Motion in a step above which the hand is not yet there."""
    approach_steps: int = 120
    """Steps allowed for each leg of the approach."""
    still: float = 0.0002
    """Change of the gripper's opening in a step below which it has stopped."""
    freed: float = 0.03
    """Gain of the gripper's opening that frees any object."""
    probe: float = 0.03
    """Height of the trial lift that tells a hold from a miss."""
    held: float = 0.02
    """Distance that the grip point may wander on the object before the hold counts as lost."""
    tries: int = 3
    """Grasps in an episode: the first and the recoveries."""


@dataclass(frozen=True)
class FollowSettings:
    """The follower. Lengths in metres, angles in radians, durations in control steps (20 Hz)."""

    replan_steps: int = 4
    """Steps between two plans."""
    gate_position: float = 0.025
    """Distance from a planned pose that counts as there."""
    gate_rotation: float = 0.2
    """Angle from a planned pose that counts as there."""
    reach: float = 0.004
    """Error of the arm's own kinematics at the plan's end above which another turn of the object is looked for."""
    lift_first: float = 0.05
    """Height gained before moving sideways, if the plan lifts at all."""
    lowering: float = 0.03
    """The plan lowers the object when it ends so far below the highest point reached."""
    aligned: float = 0.005
    """Horizontal distance from the plan's end at which the object is let down."""
    aligned_rotation: float = 0.2
    """Angle from the plan's end at which the object is let down."""
    resting: float = 0.002
    """Motion in a step below which the object is at rest."""
    patience: int = 25
    """Steps after which the alignment is taken as good enough within twice its tolerance."""
    stuck: float = 0.0015
    """Motion in a step below which the object does not move although it should."""
    stuck_steps: int = 8
    """Steps without motion that count as stuck."""
    unstick_lift: float = 0.045
    """Height gained to come free."""
    search: float = 0.0035
    """Radius of the first ring of places tried after wedging."""
    goal_memory: int = 12
    """Plans whose ends are put together into one goal."""
    lower_step: float = 0.01
    """Height by which the target is below the object while it is let down: gently, or it slips out of the hand."""
    press: float = 0.03
    """Depth below the plan's end to which the object is let down: one that hangs free goes there, one that rests on an
    edge does not."""
    depth: float = 0.25
    """Quantile of the last plans' lowest points that counts as the plan's end."""
    slip: float = 0.006
    """Distance that the grip point wanders while the object is let down that tells that it rests on an edge."""
    attempts: int = 4
    """Times of coming free after which an object at rest by the plan's end is let go all the same."""
    release: float = 0.02
    """Horizontal distance from the plan's end within which the object may be released."""
    meeting: float = 0.05
    """Distance from the plan's end within which the object may be handed over: the taker looks where it is."""
    retreat: float = 0.12
    """Height gained after the release."""


@dataclass(frozen=True)
class ControlSettings:
    """How an episode is run.

    Raises:
        UnknownNameError: no such follow mode.
        InvalidValueError: a number out of its domain.
    """

    follow: str = "gated"
    gain: float = 1.5
    """Factor on commanded differences: a constant command u moves the hand only about 0.31 u a step."""
    limit_rotation: float = 0.2
    """Largest rotation commanded in a step, radians."""
    grasp: GraspSettings = field(default_factory=GraspSettings)
    following: FollowSettings = field(default_factory=FollowSettings)

    def __post_init__(self) -> None:
        """Check the values."""
        if self.follow not in FOLLOW_MODES:
            raise UnknownNameError("follow mode", self.follow, FOLLOW_MODES)
        if self.gain <= 0:
            raise InvalidValueError(f"gain is {self.gain}, but must be positive")
        if self.following.replan_steps < 1:
            raise InvalidValueError(f"replan_steps is {self.following.replan_steps}, but must be at least 1")

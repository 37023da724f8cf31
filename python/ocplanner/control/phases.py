"""The phases of a follower: each gives the command of a control step, or the phase that follows it.

``docs/control.md`` draws them. A phase holds what it must remember; what outlives it stands in
:class:`ocplanner.control.carry.Carry`.
"""

from collections import deque
from typing import Literal, NamedTuple, Protocol

import numpy as np

from ocplanner.control.arm import Reading
from ocplanner.control.carry import Carry, motion
from ocplanner.geometry.pose import Pose
from ocplanner.geometry.rotation import angle_between

PhaseName = Literal["lift", "transit", "trace", "align", "lower", "unstick", "release", "keep", "hand over"]


class Command(NamedTuple):
    """Where the object should go now, and why.

    ``release``: let go; ``keep``: it is there and stays in the hand; ``hand over``: it is there for another hand.
    """

    target: Pose
    phase: PhaseName


class Phase(Protocol):
    """A state of the follower."""

    def step(self, now: Reading, target: Pose) -> "Command | Phase":
        """The command of this control step, or the phase that follows and gives it.

        Args:
            now: what is sensed.
            target: where the plan in force leads.
        """
        ...


class Lift:
    """Straight up, before anything else, if the plan lifts at all.

    Args:
        carry: the object.
        back: how far along its own z the object goes meanwhile, metres.
        then: the phase after it.
    """

    def __init__(self, carry: Carry, back: float, then: Phase) -> None:
        self._carry, self._then = carry, then
        start, rule = carry.start, carry.rule
        above = start.raised(rule.lift_first + rule.lift_beyond)
        self._above = above._replace(position=above.position + back * start.rotation[:, 2] * [1, 1, 0])

    def step(self, now: Reading, target: Pose) -> Command | Phase:  # noqa: ARG002
        """Up, until the object is high enough."""
        carry = self._carry
        lifts = carry.course.top > carry.start.position[2] + carry.rule.lifting
        if lifts and not carry.is_lifted(now.object):
            return Command(self._above, "lift")
        carry.lifted = True
        return self._then


class Transit:
    """Where the plans lead, as long as they do not let the object down."""

    def __init__(self, carry: Carry) -> None:
        self._carry = carry

    def step(self, now: Reading, target: Pose) -> Command | Phase:
        """Along the plan, until it lets the object down or the object is stuck."""
        carry = self._carry
        goal = carry.ends.goal
        if goal is not None:
            return Align(carry, max(carry.motion.top, float(goal.position[2]) + carry.rule.lowering))
        if carry.motion.still >= carry.rule.stuck_steps:
            return Unstick(carry, now.object, then=self)
        return Command(target, "transit")


class Align:
    """At a fixed height over the goal, until the object is lined up with it and rests.

    Args:
        carry: the object.
        height: to which it is held, world, metres; fixed, or with every overshoot it would climb.
    """

    def __init__(self, carry: Carry, height: float) -> None:
        self._carry, self._height = carry, height

    def step(self, now: Reading, target: Pose) -> Command | Phase:  # noqa: ARG002
        """Over the goal, until it is lost or the object is lined up."""
        carry, rule, here = self._carry, self._carry.rule, now.object
        goal = carry.ends.goal
        if goal is None:
            return Transit(carry)
        place = carry.place_to_try(goal, here)
        carry.search.aligning += 1
        slack = rule.patient_slack if carry.search.aligning > rule.patience else 1.0
        if (
            np.linalg.norm(here.position[:2] - place.position[:2]) > slack * rule.aligned
            or angle_between(here.rotation, place.rotation) > slack * rule.aligned_rotation
            or carry.motion.moved > slack * rule.resting
        ):
            return Command(place._replace(position=np.append(place.position[:2], self._height)), "align")
        return Lower(carry, now)


class Lower:
    """Down onto the goal, gently; it ends when the follower lets go.

    Args:
        carry: the object.
        start: what was sensed when it was lined up.
    """

    def __init__(self, carry: Carry, start: Reading) -> None:
        self._carry, self._start = carry, start
        carry.motion.still = 0

    def has_descended(self, here: Pose) -> bool:
        """Whether the object has come down from where it was lined up, rather than rests on its way."""
        return bool(self._start.object.position[2] - here.position[2] > self._carry.rule.lowering)

    def step(self, now: Reading, target: Pose) -> Command | Phase:  # noqa: ARG002
        """Down, until the object is stuck or the grip slips: then up again, and down at another place."""
        carry, rule, here = self._carry, self._carry.rule, now.object
        slipped = np.linalg.norm(now.grip_point - self._start.grip_point) > rule.slip
        if slipped or carry.motion.still >= rule.stuck_steps:
            carry.search.fail()
            return Unstick(carry, here, then=Align(carry, float(here.position[2]) + rule.unstick_lift))
        goal = carry.ends.goal
        if goal is None:
            return Transit(carry)
        place = carry.place_to_try(goal, here)
        place.position[2] = max(place.position[2] - rule.press, here.position[2] - rule.lower_step)
        return Command(place, "lower")


class Trace:
    """Through each pose of the plan; an object that stays wedged comes free and tries beside them."""

    def __init__(self, carry: Carry) -> None:
        self._carry = carry
        self._track: deque[Pose] = deque(maxlen=carry.rule.wedged_steps)

    def step(self, now: Reading, target: Pose) -> Command | Phase:
        """Along the plan, until the object is wedged."""
        carry, rule = self._carry, self._carry.rule
        self._track.append(now.object)
        moved = motion(self._track[0], now.object, rule.turn_lever)
        if len(self._track) == rule.wedged_steps and moved < rule.wedged:
            carry.search.fail()
            self._track.clear()
            return Unstick(carry, now.object, then=self)
        if carry.course.exact:
            target = target._replace(position=target.position + np.append(carry.search.aside, 0.0))
        return Command(target, "trace")


class Unstick:
    """Straight up until the object is free.

    Args:
        carry: the object.
        here: where it is stuck.
        then: the phase after it.
    """

    def __init__(self, carry: Carry, here: Pose, then: Phase) -> None:
        self._carry, self._then = carry, then
        self._above = here.raised(carry.rule.unstick_lift)
        self._steps = 0

    def step(self, now: Reading, target: Pose) -> Command | Phase:  # noqa: ARG002
        """Up, until the object is high enough or it has taken too long."""
        rule = self._carry.rule
        free = now.object.position[2] >= self._above.position[2] - rule.unstick_near
        if self._steps and (free or self._steps >= rule.unstick_steps):
            self._carry.motion.still = 0
            return self._then
        self._steps += 1
        return Command(self._above, "unstick")


class Ungated:
    """Where the plan leads, in the modes that do not wait for the object."""

    def step(self, now: Reading, target: Pose) -> Command:  # noqa: ARG002
        """Along the plan."""
        return Command(target, "transit")

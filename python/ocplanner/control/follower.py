"""Making a held object follow a plan that is renewed every few steps.

The follower is a state machine over :mod:`ocplanner.control.phases`; ``docs/control.md`` draws it. Decisions rest on
the plans, the object's pose and where the hand holds it: no goal pose, no success flag.
"""

from typing import NamedTuple

import numpy as np

from ocplanner.control.arm import Reachability, Reading
from ocplanner.control.carry import Carry, Motion, Search
from ocplanner.control.course import Course, PlanEnds, SymmetryChoice, TracedCourse
from ocplanner.control.phases import Command, Lift, Lower, Phase, Trace, Transit, Ungated
from ocplanner.control.placing import DropPlacing, InsertPlacing, TracePlacing
from ocplanner.control.settings import ControlSettings
from ocplanner.envs.tasks import ObjectSpec
from ocplanner.geometry.pose import Pose

_PLACINGS = {"drop": DropPlacing, "insert": InsertPlacing, "trace": TracePlacing}


class Role(NamedTuple):
    """An arm's part of the way of an object that several arms carry, one after the other.

    Attributes:
        takes: whether the object's way begins with this arm.
        given_rotation: (3, 3) rotation in which the object is handed over where a plan does not say; None: this arm is
            the last, and places it.
    """

    takes: bool = True
    given_rotation: np.ndarray | None = None

    @property
    def gives(self) -> bool:
        """Whether the plans of this part end where another hand takes the object."""
        return self.given_rotation is not None


class Follower:
    """Follows successive plans of one object in one hand.

    Args:
        settings: modes and thresholds.
        spec: the object: its symmetry, its way of being placed, its own numbers.
        start: what is sensed when the object has just been taken.
        reach: where the arm gets to; without it every pose counts as reachable.
        role: the arm's part of the way.
    """

    def __init__(
        self,
        settings: ControlSettings,
        spec: ObjectSpec,
        start: Reading,
        reach: Reachability | None = None,
        role: Role = Role(),  # noqa: B008
    ) -> None:
        rule = settings.following.for_object(spec, lifts=role.takes)
        traced = spec.placing == "trace"
        carried = start.object.rotation if role.given_rotation is None else role.given_rotation
        self._spec, self._role = spec, role
        self._carry = carry = Carry(
            rule=rule,
            start=start.object,
            course=(TracedCourse if traced else Course)(settings, rule, carried),
            symmetry=SymmetryChoice(rule, spec.yaw_fold, reach if settings.gated else None),
            ends=PlanEnds(rule, spec.yaw_fold),
            motion=Motion(start.object, rule.stuck, rule.turn_lever if traced else 0.0),
            search=Search(rule.search),
        )
        self._placing = _PLACINGS[spec.placing](carry)
        self._release = self._placing if settings.gated else DropPlacing(carry, presses=False)
        self._phase: Phase = Ungated()
        if settings.gated:
            back = spec.lift[1] if role.takes and spec.lift is not None else 0.0
            self._phase = Lift(carry, back, then=Trace(carry) if traced else Transit(carry))

    @property
    def goal(self) -> Pose | None:
        """Where the plans let the object down; None while they do not."""
        return self._carry.ends.goal

    def receive(self, positions: np.ndarray, rotations: np.ndarray | None, now: Reading) -> None:
        """Take a new plan.

        Args:
            positions: (H, 3) world, metres.
            rotations: (H, 3, 3), or None for a position-only plan: the object then keeps its rotation, or turns to that
                in which it is handed over.
            now: what is sensed.
        """
        carry = self._carry
        if rotations is not None:
            rotations = carry.symmetry.turn(positions, rotations, now)
        end = carry.course.set_plan(np.ascontiguousarray(positions), rotations, now.object)
        carry.ends.add(end)
        if self._role.gives:
            return
        top = max(carry.motion.top, float(now.object.position[2]))
        if carry.is_lifted(now.object) and end.position[2] < top - carry.rule.lowering:
            carry.ends.add_goal(end)
        elif not isinstance(self._phase, Lower):
            carry.ends.forget_goal()

    def command(self, now: Reading) -> Command:
        """Where to move the object in this control step."""
        here, motion = now.object, self._carry.motion
        motion.step(here)
        target = self._carry.course.target(here, motion.moved)
        ending = self._ending(here)
        if ending is not None:
            return ending
        while True:
            step = self._phase.step(now, target)
            if isinstance(step, Command):
                return step
            self._phase = step

    def may_release(self, here: Pose, moved: float = 0.0) -> bool:
        """Whether the plans are fulfilled, so that the object may be let go of.

        Args:
            here: where it is.
            moved: its motion in the last step, metres.
        """
        return self._release.may_release(here, moved, self._phase)

    def _ending(self, here: Pose) -> Command | None:
        """The last command, once the object is where this part of its way ends."""
        moved, rule = self._carry.motion.moved, self._carry.rule
        if self._role.gives:
            return Command(here, "hand over") if self._placing.has_arrived(here, moved, rule.meeting) else None
        if not self._spec.let_go:
            return Command(here, "keep") if self._placing.has_arrived(here, moved, rule.release) else None
        return Command(here, "release") if self.may_release(here, moved) else None

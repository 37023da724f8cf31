"""The ways of placing an object: which course it takes, and how the follower tells that it is there.

No decision looks at the goal itself or a success flag: only at the plans, the object and where the hand holds it.
"""

import numpy as np

from ocplanner.control.carry import Carry
from ocplanner.control.phases import Lower, Phase
from ocplanner.geometry.pose import Pose


class DropPlacing:
    """Lined up over the goal and let down, until the object hangs free there.

    Args:
        carry: the object.
        presses: whether the object is let down below the goal. Then it hangs free once it is well below, and may rest
            at the goal's height only after ``attempts`` tries; else it is enough that it rests there.
    """

    def __init__(self, carry: Carry, *, presses: bool = True) -> None:
        self._carry, self._presses = carry, presses

    def has_arrived(self, here: Pose, moved: float, near: float) -> bool:
        """Whether the object has been lifted and rests within ``near`` metres of where the last plans end."""
        carry = self._carry
        return carry.is_lifted(here) and carry.ends.farthest(here) < near and moved < carry.rule.resting

    def may_release(self, here: Pose, moved: float, phase: Phase) -> bool:  # noqa: ARG002
        """Whether the plans are fulfilled: it hangs free, or rests at the goal's height and cannot get lower."""
        goal, rule = self._carry.ends.goal, self._carry.rule
        if goal is None:
            return False
        away = here.position - goal.position
        if np.linalg.norm(away[:2]) > rule.release:
            return False
        if away[2] < -rule.hanging * rule.press:
            return True
        patient = not self._presses or self._carry.search.attempts >= rule.attempts
        return bool(patient and away[2] < rule.release and moved < rule.resting)


class InsertPlacing(DropPlacing):
    """Lined up over the goal and let down, until the object rests there."""

    def may_release(self, here: Pose, moved: float, phase: Phase) -> bool:
        """Whether the plans are fulfilled: it was let down, and has arrived."""
        descended = isinstance(phase, Lower) and phase.has_descended(here)
        return descended and self.has_arrived(here, moved, self._carry.rule.release)


class TracePlacing(DropPlacing):
    """Led through each pose of the plan, until the object rests at the last."""

    def has_arrived(self, here: Pose, moved: float, near: float) -> bool:  # noqa: ARG002
        """Whether the object has been lifted and rests where the last plans end, within its own tolerance."""
        carry, rule = self._carry, self._carry.rule
        if not carry.is_lifted(here) or moved >= rule.resting:
            return False
        slack = rule.traced_patient_slack if carry.motion.still > rule.patience else rule.traced_slack
        return (
            carry.ends.farthest(here) < slack * rule.aligned and carry.ends.widest(here) < slack * rule.aligned_rotation
        )

    def may_release(self, here: Pose, moved: float, phase: Phase) -> bool:  # noqa: ARG002
        """Whether the plans are fulfilled: it has arrived."""
        return self.has_arrived(here, moved, self._carry.rule.release)

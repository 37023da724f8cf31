"""Placing objects by their plans, one after another: grasp, follow, hand over, let go.

Runs on a simulated work cell and on a real one alike: see ``docs/control.md``.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from ocplanner.control.arm import OPEN, Arm, CellArm, Reading, WorkCell
from ocplanner.control.arm_multiplexer import ArmMultiplexer
from ocplanner.control.arm_program import ArmProgram
from ocplanner.control.follower import Follower, Role
from ocplanner.control.grasp import close_around, hover_over, is_held, take_hold
from ocplanner.control.hand_over import ends_for_hands, ready_beside, rotation_to_taker
from ocplanner.control.open_hand import back_off, bring_hand, release
from ocplanner.control.settings import ControlSettings
from ocplanner.envs.tasks import ObjectSpec
from ocplanner.geometry.pose import Pose

UNPLANNED_PHASES = ("go", "grasp", "recover", "release")
"""Phases in which no plan is followed."""


class PlanSource(Protocol):
    """What plans: :class:`ocplanner.Planner`, or recorded trajectories in its place."""

    def plan(self, images: dict[str, np.ndarray]) -> Any:
        """Plan from pictures (B, h, w, 3) uint8 by camera.

        Returns:
            Something with ``position`` (B, H, 3), world, metres, and ``rotation`` (B, H, 3, 3) or None.
        """


@dataclass
class Progress:
    """How far the executor has come with the active object and the active arm.

    Attributes:
        spec: the object.
        arm: number of the arm.
        phase: what is being done: one of :data:`UNPLANNED_PHASES`, ``"hand over"``, or the follower's.
        held_once: whether this arm has had the object in its hand.
        lost: whether it has lost it since.
        grip: what was sensed when the follower began.
        follower: the follower of this arm's part of the way.
    """

    spec: ObjectSpec
    arm: int
    phase: str = "grasp"
    held_once: bool = False
    lost: bool = False
    grip: Reading | None = None
    follower: Follower | None = None

    @property
    def is_last_arm(self) -> bool:
        """Whether the active arm is to place the object, not to hand it over."""
        return self.arm == self.spec.arms[-1]

    @property
    def taker(self) -> int:
        """Number of the arm after the active one."""
        return self.spec.arms[self.spec.arms.index(self.arm) + 1]


class Executor:
    """Grasps objects and makes them follow their plans.

    Args:
        cell: the arms before the objects.
        objects: what is to be placed, in this order.
        planners: one for each of the objects' :attr:`ocplanner.envs.tasks.ObjectSpec.parts`.
        observe: takes the planners' pictures, (h, w, 3) uint8 by camera.
        settings: every number of the control laws.
        horizon: control steps until :class:`ocplanner.control.arm_program.HorizonReached`.
        sense: what the active arm is sensed and acts through, made anew for each object and arm; the arm itself if not
            given. See :class:`ocplanner.control.pose_filter.FilteredArm`.
        on_step: called with the reading after every control step.

    Attributes:
        program: the arm that moves.
        progress: how far it has come.
        finished: whether the follower has decided that the last object is where it belongs.
        plans: (control step, (H, 3) positions) of every plan that was made.
    """

    def __init__(
        self,
        cell: WorkCell,
        objects: Sequence[ObjectSpec],
        planners: Mapping[str, PlanSource],
        observe: Callable[[], dict[str, np.ndarray]],
        settings: ControlSettings,
        horizon: int,
        *,
        sense: Callable[[Arm], Arm] | None = None,
        on_step: Callable[[Reading], None] | None = None,
    ) -> None:
        self._cell, self._objects, self._planners, self._observe = cell, objects, planners, observe
        self._settings, self._sense = settings, sense
        self._homes = [arm.eef_pose() for arm in cell.arms]
        self._arms = ArmMultiplexer(cell, settings.law, objects[0].name, level=settings.several_arms.level)
        self.program = ArmProgram(self._arms, settings.law, horizon, on_step, cell.robot.holding)
        self.progress = Progress(objects[0], objects[0].arms[0])
        self.finished = False
        self.plans: list[tuple[int, np.ndarray]] = []

    def run(self) -> None:
        """Place the objects; returns early when one is given up.

        Raises:
            HorizonReached: no steps are left.
        """
        for number, spec in enumerate(self._objects):
            self._activate(spec, spec.arms[0])
            self._send_to_wait(self._objects[number + 1 :])
            self._go()
            if not self._place(last=spec is self._objects[-1]):
                return

    @property
    def _arm(self) -> CellArm:
        return self._cell.arms[self.progress.arm]

    def _activate(self, spec: ObjectSpec, arm: int, phase: str = "grasp") -> None:
        """From here on this object is sensed and planned for, and this arm moves."""
        self._arms.activate(spec.name, arm)
        self.program.arm = self._arms if self._sense is None else self._sense(self._arms)
        self.progress = Progress(spec, arm, phase)

    def _send_to_wait(self, later: Sequence[ObjectSpec]) -> None:
        """Let the other arms go above what they are to take next, or where they were when the episode began."""
        for arm, home in enumerate(self._homes):
            if arm == self.progress.arm:
                continue
            place = home
            following = next((spec for spec in later if spec.arms[0] == arm), None)
            if following is not None:
                lying = self._cell.object_pose(following.name).position
                height = max(home.position[2], lying[2] + hover_over(following, self._settings.grasp))
                place = home._replace(position=np.append(lying[:2], height))
            self._arms.wait_at(place, arm, rising=True)

    def _go(self) -> None:
        """Pass the places on the way to the object."""
        self.progress.phase = "go"
        for place in self.progress.spec.way:
            hand = Pose(np.array(place), self._homes[self.progress.arm].rotation)
            bring_hand(self.program, hand, self._settings.open_hand)

    def _place(self, *, last: bool) -> bool:
        """Bring the active object to where the plans lead; True once the follower decides that it is there."""
        spec, robot = self.progress.spec, self._cell.robot
        for _ in range(self._settings.grasp.tries):
            placed = self._try_to_place()
            if not placed and spec.let_go:
                placed = self._fell_into_place()
            if placed:
                self.finished = last
                if spec.let_go:
                    self.progress.phase = "release"
                    release(self.program, spec, robot, self._settings)
                return True
            back_off(self.program, spec, robot, self._settings)
        return False

    def _try_to_place(self) -> bool:
        """Take hold of the active object and carry it; True once the follower decides that it is there."""
        progress, grasp = self.progress, self._settings.grasp
        progress.phase, progress.lost = "grasp", False
        held = taken = progress.spec
        if not progress.is_last_arm:
            here = self.program.read().object
            held, taken = ends_for_hands(progress.spec, here, self._arm.reach, self._settings.several_arms)
        grip_point = take_hold(self.program, held, self._cell.robot, grasp, self._arm.reach)
        if grip_point is None:
            return False
        progress.held_once = True
        while self._follow(grip_point, held, taken):
            if self.progress.is_last_arm:
                return True
            handed = self._hand_over(taken)
            if handed is None:
                break
            grip_point = handed
        self.progress.lost = True
        return False

    def _follow(self, grip_point: np.ndarray, held: ObjectSpec, taken: ObjectSpec) -> bool:
        """Follow the plans of the active arm's part of the way; False if the object was lost.

        Args:
            grip_point: (3,) where the hand holds the object.
            held: the object as this arm holds it.
            taken: the object as the next arm is to take it.
        """
        progress, spec = self.progress, self.progress.spec
        now = progress.grip = self.program.read()
        role = Role(takes=progress.arm == spec.arms[0])
        if not progress.is_last_arm:
            way = self._cell.arms[progress.taker].reach.base - self._arm.reach.base
            role = role._replace(given_rotation=rotation_to_taker(now.object, held, taken, way))
        follower = progress.follower = Follower(self._settings, spec, now, self._arm.reach, role)
        planner = self._planners[spec.parts[spec.arms.index(progress.arm)]]
        steps = 0
        while True:
            if steps % self._settings.following.replan_steps == 0:
                self._replan(planner, follower, now)
            command = follower.command(now)
            progress.phase = command.phase
            if command.phase in ("release", "keep", "hand over"):
                return True
            now = self.program.move_object(command.target)
            steps += 1
            if not is_held(now, grip_point, self._settings.grasp):
                return False

    def _replan(self, planner: PlanSource, follower: Follower, now: Reading) -> None:
        """Give the follower a plan from fresh pictures, and let the arm that takes the object next come closer."""
        plan = planner.plan({camera: image[None] for camera, image in self._observe().items()})
        positions = plan.position[0]
        follower.receive(positions, None if plan.rotation is None else plan.rotation[0], now)
        self.plans.append((self.program.steps, positions))
        if not self.progress.is_last_arm:
            taker = self.progress.taker
            place = ready_beside(positions[-1], self._homes[taker], self._settings.several_arms)
            self._arms.wait_at(place, taker)

    def _hand_over(self, taken: ObjectSpec) -> np.ndarray | None:
        """Let the next arm take the object from the active one.

        Args:
            taken: the object as the next arm takes it.

        Returns:
            (3,) its grip point, or None if it does not hold the object.
        """
        settings, robot, number = self._settings, self._cell.robot, self.progress.arm
        giver = self._cell.arms[number]
        self._activate(self.progress.spec, self.progress.taker, "hand over")
        self.progress.held_once = True
        at_once = replace(settings.grasp, settle_steps=0)
        close_around(self.program, taken, robot, at_once, self._arm.reach)
        now = self.program.read()
        open_enough = giver.gripper_opening + settings.grasp.freed
        self._arms.open(number)
        self._hold(now.eef, lambda: giver.gripper_opening > open_enough, robot.stroke_steps)
        above = giver.eef_pose().raised(settings.open_hand.retreat)
        self._arms.wait_at(above, number)
        clear = above.position[2] - settings.several_arms.away
        self._hold(now.eef, lambda: giver.eef_pose().position[2] > clear, settings.several_arms.leave_steps)
        self._arms.wait_at(self._homes[number], number)
        return now.grip_point if is_held(self.program.read(), now.grip_point, settings.grasp) else None

    def _hold(self, place: Pose, until: Callable[[], bool], steps: int) -> None:
        """Keep the closed hand where it is until something has happened, for at most so many steps."""
        for _ in range(steps):
            self.program.move_hand(place, self.program.holding)
            if until():
                return

    def _fell_into_place(self) -> bool:
        """Whether the object slid out of the hand to where the plan wanted it."""
        self.progress.phase = "recover"
        for _ in range(self._settings.grasp.settle_steps):
            self.program.wait(OPEN)
        follower = self.progress.follower
        return follower is not None and follower.may_release(self.program.read().object)

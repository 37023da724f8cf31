"""One zero-shot episode: grasp, follow the plan, let go."""

import contextlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np

from ocplanner import _core
from ocplanner.control.arm import OPEN, Arm, Reading
from ocplanner.control.arm_multiplexer import ArmMultiplexer
from ocplanner.control.arm_program import ArmProgram, HorizonReached
from ocplanner.control.follower import Follower
from ocplanner.control.grasp import close_around, hover_over, is_held, open_fingers, opening_before, take_hold, toward
from ocplanner.control.hand_over import across, ends_for_hands, ready_beside
from ocplanner.control.settings import ControlSettings
from ocplanner.envs.environment import ManipulationEnv
from ocplanner.envs.tasks import ObjectSpec
from ocplanner.geometry.pose import Pose
from ocplanner.geometry.rotation import angle_between

_SWINGING, _RESTING = 60, 2e-5  # steps, m a step: an object that was let go of
_LEAVING, _AWAY = 30, 0.06  # steps, m: a hand that has given something away goes up; from where it is out of the way
_NEAR, _NEAR_ROTATION = 0.02, 0.15  # m, rad: the open hand has come to a place that it passes


class Plans(Protocol):
    """What plans: :class:`ocplanner.Planner`, or recorded trajectories in its place."""

    def plan(self, images: dict[str, np.ndarray]) -> Any:
        """Plan from pictures (B, h, w, 3) uint8 by camera."""


@dataclass
class Trace:
    """What happened, step by step, for videos and for telling failures apart."""

    readings: list[Reading] = field(default_factory=list)
    phases: list[str] = field(default_factory=list)
    plans: list[tuple[int, np.ndarray]] = field(default_factory=list)
    in_play: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Episode:
    """The outcome of an episode.

    Attributes:
        seed: of the reset.
        success: the object is at the goal, and the follower itself ended the episode: by letting go, or by keeping
            the object up where the task wants that.
        steps: control steps used.
        failure: one of :data:`ocplanner.zero_shot.result.FAILURES`, or None.
        released_by: ``"follower"``, or None if it never let go (nor kept the object where that is the end).
        trace: the steps.
        failed_with: the object in play when a task with several objects failed, or None.
    """

    seed: int
    success: bool
    steps: int
    failure: str | None
    released_by: str | None
    trace: Trace
    failed_with: str | None = None


def run_episode(
    env: ManipulationEnv,
    planner: Plans | Mapping[str, Plans],
    seed: int,
    settings: ControlSettings | None = None,
    *,
    observe: Callable[[ManipulationEnv], dict[str, np.ndarray]] = ManipulationEnv.observe,
    sense: Callable[[Arm], Arm] | None = None,
    on_step: Callable[[], None] | None = None,
) -> Episode:
    """Run one episode.

    Args:
        env: the arm before its task, observing as the planner was trained to.
        planner: anything with ``plan(images)``, for the task's first object; or one for each by the object's name, and
            of an object that several arms carry one for the part of each, see
            :attr:`ocplanner.envs.tasks.ObjectSpec.parts`.
        seed: of the reset.
        settings: the follower's numbers.
        observe: takes the planner's pictures of the environment, (h, w, 3) uint8 by camera.
        sense: what the arm's program senses and acts through, made after the reset and anew for each object, and each
            arm, that comes into play; without it poses are exact. The verdict does not depend on it.
        on_step: called after every control step (recording frames).
    """
    settings = settings or ControlSettings()
    trace = Trace()

    def note(reading: Reading) -> None:
        trace.readings.append(reading)
        trace.phases.append(program.phase)
        trace.in_play.append(program.spec.name)
        if on_step is not None:
            on_step()

    env.reset(seed)
    law = _core.DeltaPoseLaw(
        gain_position=settings.gain, gain_rotation=settings.gain, limit_rotation=settings.limit_rotation
    )
    parts = planner if isinstance(planner, Mapping) else {env.task.object().name: planner}
    hands = ArmMultiplexer(env, law, env.task.objects[0].name)
    body = ArmProgram(hands, law, env.horizon, note, env.robot.holding)
    program = _Program(env, parts, hands, body, settings, trace, observe, sense)
    with contextlib.suppress(HorizonReached):
        program.run()
    success = program.finished and env.success()
    failure = None if success else program.why(env)
    released_by = "follower" if program.finished else None
    failed_with = program.spec.name if failure is not None and len(env.task.objects) > 1 else None
    return Episode(seed, success, body.steps, failure, released_by, trace, failed_with)


class _Program:
    def __init__(
        self,
        env: ManipulationEnv,
        planners: Mapping[str, Plans],
        hands: ArmMultiplexer,
        body: ArmProgram,
        settings: ControlSettings,
        trace: Trace,
        observe: Callable[[ManipulationEnv], dict[str, np.ndarray]],
        sense: Callable[[Arm], Arm] | None,
    ) -> None:
        self.env, self.planners, self.hands, self.body = env, planners, hands, body
        self.settings, self.trace, self.observe, self.sense = settings, trace, observe, sense
        self.objects = [spec for spec in env.task.objects if set(spec.parts) <= planners.keys()]
        self.finished = False
        self.ends = (env.task.objects[-1],) * 2
        self.homes = [arm.eef_pose() for arm in env.arms]
        self.reaches = [arm.reach for arm in env.arms]

    def activate(self, spec: ObjectSpec, arm: int) -> None:
        """Put an object and an arm in play: from here on this object is sensed and planned for, and this arm moves."""
        self.spec, self.arm = spec, arm
        self.hands.activate(spec.name, arm)
        self.body.arm = self.hands if self.sense is None else self.sense(self.hands)
        self.reach = self.reaches[arm]
        self.phase = "grasp"
        self.held_once = False
        self.lost = False
        self.grip: Reading | None = None
        self.follower: Follower | None = None

    def run(self) -> None:
        for number, spec in enumerate(self.objects):
            self.activate(spec, spec.arms[0])
            self._send_to_wait(self.objects[number + 1 :])
            self._go(spec)
            if not self._place(spec, last=spec is self.objects[-1]):
                return

    def _send_to_wait(self, later: Sequence[ObjectSpec]) -> None:
        """Let the other arms go above what they are to take next, or where they were when the episode began."""
        for arm in range(len(self.homes)):
            if arm == self.arm:
                continue
            place = self.homes[arm]
            nexts = [spec for spec in later if spec.arms[0] == arm]
            if nexts:
                lying = self.env.object_pose(nexts[0].name).position
                hover = hover_over(nexts[0], self.settings.grasp)
                place = place._replace(position=np.array([*lying[:2], max(place.position[2], lying[2] + hover)]))
            self.hands.wait_at(place, arm, rising=True)

    def _place(self, spec: ObjectSpec, *, last: bool) -> bool:
        """Bring the object in play to where the plans lead; True once the follower decides that it is there."""
        for _ in range(self.settings.grasp.tries):
            self.phase, self.lost = "grasp", False
            held = spec
            if self.arm != spec.arms[-1]:
                held, _ = self.ends = ends_for_hands(spec, self.body.read().object, self.reach)
            grip_point = take_hold(self.body, held, self.env.robot, self.settings.grasp, self.reach)
            if grip_point is not None:
                self.held_once = True
                if self._carry(grip_point, spec):
                    self.finished = last
                    if spec.let_go:
                        self._let_go(spec)
                    return True
                self.lost = True
            if spec.let_go and self._fell_into_place():
                self.finished = last
                self._let_go(spec)
                return True
            self._back_off()
        return False

    def _carry(self, grip_point: np.ndarray, spec: ObjectSpec) -> bool:
        """Follow the plans of the arm in play and of those to which the object is handed over, to the end."""
        while self._follow(grip_point, spec):
            if self.arm == spec.arms[-1]:
                return True
            handed = self._hand_over(spec, self._taker(spec))
            if handed is None:
                return False
            grip_point = handed
        return False

    def _taker(self, spec: ObjectSpec) -> int:
        """Number of the arm after the one in play."""
        return spec.arms[spec.arms.index(self.arm) + 1]

    def _hand_over(self, spec: ObjectSpec, taker: int) -> np.ndarray | None:
        """Let the next arm take the object from the one in play; its grip point, or None if it does not hold it."""
        giver = self.arm
        self.activate(spec, taker)
        self.phase, self.held_once = "hand over", True
        at_once = replace(self.settings.grasp, settle_steps=0)
        close_around(self.body, self.ends[1], self.env.robot, at_once, self.reach)
        now = self.body.read()
        grip_point, place = now.grip_point, now.eef
        arm = self.env.arms[giver]
        open_enough = arm.gripper_opening + self.settings.grasp.freed
        self.hands.open(giver)
        self._hold(place, lambda: arm.gripper_opening > open_enough, self.env.robot.stroke_steps)
        above = arm.eef_pose().raised(self.settings.following.retreat)
        self.hands.wait_at(above, giver)
        self._hold(place, lambda: arm.eef_pose().position[2] > above.position[2] - _AWAY, _LEAVING)
        self.hands.wait_at(self.homes[giver], giver)
        return grip_point if is_held(self.body.read(), grip_point, self.settings.grasp) else None

    def _across(self, spec: ObjectSpec, pose_object: Pose) -> np.ndarray:
        """(3, 3) rotation in which the object is handed over, where its plan does not say."""
        given, taken = self.ends
        return across(pose_object, given, taken, self.reaches[self._taker(spec)].base - self.reach.base)

    def _hold(self, place: Pose, until: Callable[[], bool], steps: int) -> None:
        """Keep the closed hand where it is until something has happened, for at most so many steps."""
        for _ in range(steps):
            self.body.move_hand(place, self.body.holding)
            if until():
                return

    def _follow(self, grip_point: np.ndarray, spec: ObjectSpec) -> bool:
        """True once the follower decides that the plans are fulfilled, False if the object was lost."""
        now = self.grip = self.body.read()
        hands_over = self.arm != spec.arms[-1]
        self.follower = follower = Follower(
            self.settings,
            spec.yaw_fold,
            now,
            self.reach,
            let_go=spec.let_go,
            lift=spec.lift if self.arm == spec.arms[0] else None,
            hands_over=hands_over,
            turned=self._across(spec, now.object) if hands_over else None,
            placing=spec.placing,
            tolerance=spec.tolerance,
            descent=spec.descent,
        )
        planner = self.planners[spec.parts[spec.arms.index(self.arm)]]
        step = 0
        while True:
            if step % self.settings.following.replan_steps == 0:
                images = self.observe(self.env)
                plan = planner.plan({camera: image[None] for camera, image in images.items()})
                rotations = None if plan.rotation is None else plan.rotation[0]
                follower.receive(plan.position[0], rotations, now)
                self.trace.plans.append((self.body.steps, plan.position[0]))
                if hands_over:
                    taker = self._taker(spec)
                    self.hands.wait_at(ready_beside(plan.position[0][-1], self.homes[taker]), taker)
            command = follower.command(now)
            self.phase = command.phase
            if command.phase in ("release", "keep", "hand over"):
                return True
            now = self.body.move_object(command.target)
            step += 1
            if not is_held(now, grip_point, self.settings.grasp):
                return False

    def _let_go(self, spec: ObjectSpec) -> None:
        self.phase = "release"
        open_fingers(self.body, self.env.robot, self.settings.grasp)
        self._withdraw(spec)
        if spec.placing == "trace":
            self._wait_for_rest()

    def _withdraw(self, spec: ObjectSpec) -> None:
        if spec.withdraw == "up":
            self._rise(self.settings.following.retreat)
            return
        start = self.body.read().eef
        palm = (start.rotation @ self.env.robot.rotation_grasp_site.T)[:, 2]
        self._bring_hand(start._replace(position=start.position - self.settings.following.retreat * palm))

    def _wait_for_rest(self) -> None:
        """An object that was let go of where it hangs may slide and swing on for a while."""
        for _ in range(_SWINGING):
            before = self.body.read().object.position
            if np.linalg.norm(self.body.wait(OPEN).object.position - before) < _RESTING:
                return

    def _go(self, spec: ObjectSpec) -> None:
        """Pass the places on the way to an object."""
        self.phase = "go"
        for place in spec.way:
            self._bring_hand(Pose(np.array(place), self.homes[self.arm].rotation))

    def _bring_hand(self, hand: Pose) -> None:
        """Move the open hand near a pose, or as near as the arm gets."""
        still = 0
        for _ in range(self.settings.grasp.approach_steps):
            before = self.body.read().eef
            now = self.body.move_hand(hand, OPEN).eef
            turned = angle_between(now.rotation, hand.rotation)
            if np.linalg.norm(now.position - hand.position) < _NEAR and turned < _NEAR_ROTATION:
                return
            moved = np.linalg.norm(now.position - before.position) + angle_between(now.rotation, before.rotation)
            still = still + 1 if moved < self.settings.following.stuck else 0
            if still >= self.settings.following.stuck_steps:
                return

    def _fell_into_place(self) -> bool:
        """Whether the object slid out of the hand to where the plan wanted it."""
        self.phase = "recover"
        for _ in range(self.settings.grasp.settle_steps):
            self.body.wait(OPEN)
        return self.follower is not None and self.follower.may_release(self.body.read().object)

    def _back_off(self) -> None:
        self._rise(self.settings.grasp.hover)
        for _ in range(self.env.robot.stroke_steps // 5):
            self.body.wait(toward(opening_before(self.spec, self.env.robot), self.body.read().opening))

    def _rise(self, height: float) -> None:
        start = self.body.read().eef
        top = start.position[2] + height
        still, before = 0, start.position[2]
        for _ in range(60):
            now = self.body.move_hand(start._replace(position=np.array([*start.position[:2], top + 0.02])), OPEN)
            still = still + 1 if now.eef.position[2] - before < self.settings.following.stuck else 0
            before = now.eef.position[2]
            if before > top or still >= self.settings.following.stuck_steps:
                break

    def why(self, env: ManipulationEnv) -> str:
        """The class of a failure; looks at contacts, which no decision does."""
        if self.finished:
            return "not aligned"
        if self.phase == "go":
            return "time-out"
        if self.phase == "hand over":
            return "not handed over"
        if not self.held_once:
            return "missed grasp"
        if self.lost or self.phase in ("recover", "grasp") or not env.in_contact(self.spec.name, self.arm):
            return "lost grasp"
        now = self.body.read()
        if self.grip is not None:
            before = self.grip.eef.rotation.T @ self.grip.object.rotation
            if angle_between(before, now.eef.rotation.T @ now.object.rotation) > 0.8:
                return "slip"
        goal = None if self.follower is None else self.follower.goal
        if goal is not None:
            if np.linalg.norm(now.object.position - goal.position) < 0.03:
                return "not released"
            return "not aligned"
        recent = np.array([reading.object.position[:2] for reading in self.trace.readings[-60:]])
        return "stuck in transit" if np.ptp(recent, axis=0).max() < 0.03 else "time-out"

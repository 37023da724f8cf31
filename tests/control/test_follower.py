"""The follower against a floating object that goes where it is told, and a peg that it must be threaded on."""

import numpy as np
import pytest

from ocplanner.control.arm import Reading
from ocplanner.control.follower import Follower, Role
from ocplanner.control.settings import ControlSettings, FollowSettings
from ocplanner.envs.tasks import ObjectSpec
from ocplanner.errors import InvalidValueError, UnknownNameError
from ocplanner.geometry.pose import Pose
from ocplanner.geometry.rotation import angle_between, yaw_rotation
from peg_plans import PEG, plan_to_peg

START = np.array([-0.11, 0.15, 0.83])
TOP, SLACK = 0.96, 0.007
RAISED = np.array([0.0, 0.0, 0.1])


class Floating:
    """An object that moves a third of the way to its target each step and cannot pass through the peg's edge."""

    def __init__(self, yaw: float = 0.0) -> None:
        self.pose = Pose(START.copy(), yaw_rotation(yaw))

    def read(self) -> Reading:
        return Reading(self.pose, Pose(self.pose.position + np.array([0.0, 0.06, 0.0]), np.eye(3)), 0.03)

    def move(self, target: Pose) -> None:
        step = 0.3 * (target.position - self.pose.position)
        step *= min(1.0, 0.013 / max(1e-9, float(np.linalg.norm(step))))
        position = self.pose.position + step
        off = np.linalg.norm(position[:2] - PEG)
        if SLACK < off < 0.04 and position[2] < TOP <= self.pose.position[2] + 1e-9:
            position[2] = TOP
        self.pose = Pose(position, target.rotation)


def make(floating, yaw_fold: int, *, settings=None, reach=None, role=None, **how) -> Follower:
    """A follower of an object that is described by keywords of ObjectSpec."""
    spec = ObjectSpec("object", "joint", (), yaw_fold=yaw_fold, **how)
    return Follower(settings or ControlSettings(), spec, floating.read(), reach, role or Role())


def run(follower: Follower, floating: Floating, plan, horizon: int = 300) -> list[str]:
    phases = []
    for step in range(horizon):
        now = floating.read()
        if step % 4 == 0:
            follower.receive(*plan(step, now.object), now)
        command = follower.command(now)
        phases.append(command.phase)
        if command.phase in ("release", "hand over"):
            break
        floating.move(command.target)
    return phases


def test_carries_lets_down_and_releases():
    floating = Floating()
    follower = make(floating, 4)
    phases = run(follower, floating, lambda step, here: plan_to_peg(here, np.zeros(2), 0.0))
    assert list(dict.fromkeys(phases)) == ["lift", "transit", "align", "lower", "release"]
    assert floating.pose.position[:2] == pytest.approx(PEG, abs=SLACK)
    assert floating.pose.position[2] < 0.93


def test_an_object_that_is_to_stay_in_hand_is_kept_where_the_plans_end():
    floating = Floating()
    follower = make(floating, 0, let_go=False)
    height = START + np.array([0.0, 0.0, 0.1])

    def plan(_, here):
        return np.linspace(here.position, height, 20), np.repeat(here.rotation[None], 20, axis=0)

    phases = []
    for step in range(200):
        now = floating.read()
        if step % 4 == 0:
            follower.receive(*plan(step, now.object), now)
        command = follower.command(now)
        phases.append(command.phase)
        if command.phase == "keep":
            break
        floating.move(command.target)
    assert phases[-1] == "keep"
    assert "release" not in phases
    assert floating.pose.position == pytest.approx(height, abs=0.02)


def test_errors_of_single_plans_average_out():
    rng = np.random.default_rng(0)
    floating = Floating()
    follower = make(floating, 4)
    phases = run(follower, floating, lambda step, here: plan_to_peg(here, rng.normal(0, 0.006, 2), 0.0))
    assert phases[-1] == "release"
    assert floating.pose.position[:2] == pytest.approx(PEG, abs=SLACK)


def test_searches_when_the_peg_is_seen_beside_its_place():
    floating = Floating()
    follower = make(floating, 4)
    phases = run(follower, floating, lambda step, here: plan_to_peg(here, np.array([0.009, 0.0]), 0.0))
    assert "unstick" in phases
    assert phases[-1] == "release"
    assert floating.pose.position[2] < 0.93


@pytest.mark.parametrize("wrong", [np.pi / 2, np.pi, -np.pi / 2])
def test_a_yaw_wrong_by_the_goals_symmetry_does_not_turn_the_object(wrong):
    floating = Floating(yaw=0.4)
    follower = make(floating, 4)
    largest = 0.0

    def plan(step, here):
        nonlocal largest
        largest = max(largest, angle_between(here.rotation, yaw_rotation(0.4)))
        return plan_to_peg(here, np.zeros(2), 0.4 + wrong * (step % 3 == 0))

    assert run(follower, floating, plan)[-1] == "release"
    assert largest < 0.05


def test_stuck_in_transit_lifts():
    floating = Floating()
    follower = make(floating, 4)
    floating.pose = Pose(np.array([0.0, 0.1, 0.95]), np.eye(3))
    phases = []
    for _ in range(14):
        now = floating.read()
        follower.receive(np.tile([0.2, 0.1, 1.0], (20, 1)), None, now)
        phases.append(follower.command(now).phase)
    assert phases[0] == "transit"
    assert phases[-1] == "unstick"


@pytest.mark.parametrize("follow", ["time", "open-loop"])
def test_other_modes_release_by_the_plan_alone(follow):
    floating = Floating()
    follower = make(floating, 4, settings=ControlSettings(follow=follow))
    floating.pose = Pose(np.array([*PEG, 0.99]), np.eye(3))
    follower.receive(*plan_to_peg(floating.pose, np.zeros(2), 0.0), floating.read())
    assert follower.command(floating.read()).phase == "transit"
    floating.pose = Pose(np.array([*PEG, 0.92]), np.eye(3))
    follower.command(floating.read())
    assert follower.command(floating.read()).phase == "release"


def test_settings_are_checked():
    with pytest.raises(UnknownNameError, match="gated"):
        ControlSettings(follow="blind")
    with pytest.raises(InvalidValueError, match="gain"):
        ControlSettings(gain=0.0)
    with pytest.raises(InvalidValueError, match="replan_steps"):
        ControlSettings(following=FollowSettings(replan_steps=0))


class Carried(Floating):
    """The hand turns with the object."""

    def read(self) -> Reading:
        return Reading(self.pose, self.pose @ Pose(np.array([0.0, 0.06, 0.0]), np.eye(3)), 0.03)


class ShortArm:
    """A robot whose hand does not get beyond a plane in x."""

    def __init__(self, farthest: float) -> None:
        self.farthest = farthest

    def outward(self, position: np.ndarray) -> np.ndarray:
        return np.array([1.0, 0.0, 0.0])

    def reach_error(self, pose: Pose) -> float:
        return max(0.0, float(pose.position[0]) - self.farthest)

    def wrist_room(self, pose: Pose, turn: float) -> float:
        return 1.0


@pytest.mark.parametrize(("farthest", "turned"), [(1.0, False), (PEG[0] - 0.03, True)])
def test_turns_the_object_so_that_a_short_arm_reaches_the_goal(farthest, turned):
    floating = Carried()
    follower = make(floating, 4, reach=ShortArm(farthest))
    phases = run(follower, floating, lambda step, here: plan_to_peg(here, np.zeros(2), 0.0))
    assert phases[-1] == "release"
    assert (floating.read().eef.position[0] < floating.pose.position[0] - 0.05) == turned


def test_an_object_that_is_inserted_is_released_where_it_rests():
    floating = Floating()
    follower = make(floating, 4, placing="insert", tolerance=(0.003, 0.05))
    floor = 0.9  # where the plan ends, and nothing goes below

    def plan(step, here):
        positions, rotations = plan_to_peg(here, np.zeros(2), 0.0)
        return np.maximum(positions, [-9, -9, floor]), rotations

    def move(target):
        Floating.move(floating, target)
        floating.pose.position[2] = max(floating.pose.position[2], floor)

    floating.move = move
    assert run(follower, floating, plan)[-1] == "release"
    assert floating.pose.position == pytest.approx([*PEG, floor], abs=0.004)


def test_an_object_that_is_traced_passes_each_pose_of_the_plan():
    """Down, and then aside, beneath an edge that the straight way would hit."""
    floating = Floating()
    follower = make(floating, 1, placing="trace", tolerance=(0.003, 0.06))
    corner, end = START + RAISED, START + RAISED + np.array([0.05, 0.0, 0.0])
    way = np.concatenate([np.linspace(START, corner, 20), np.linspace(corner, end, 15)])

    def plan(_, here):
        rows = np.argmin(np.linalg.norm(way - here.position, axis=1)) + 1 + np.arange(20)
        return way[np.minimum(rows, len(way) - 1)], np.repeat(np.eye(3)[None], 20, axis=0)

    path = []
    phases = []
    for step in range(300):
        now = floating.read()
        path.append(now.object.position)
        if step % 4 == 0:
            follower.receive(*plan(step, now.object), now)
        command = follower.command(now)
        phases.append(command.phase)
        if command.phase == "release":
            break
        floating.move(command.target)
    assert phases[-1] == "release"
    assert np.linalg.norm(np.array(path) - corner, axis=1).min() < 0.008
    assert floating.pose.position == pytest.approx(end, abs=0.006)


def test_a_traced_object_that_is_wedged_comes_free_and_tries_beside():
    floating = Floating()
    follower = make(floating, 1, placing="trace", tolerance=(0.003, 0.06))
    floating.pose = Pose(START + RAISED, np.eye(3))
    end = floating.pose.position - [0.0, 0.0, 0.04]
    targets = []
    for step in range(60):
        now = floating.read()
        if step % 4 == 0:
            follower.receive(np.linspace(now.object.position, end, 20), np.repeat(np.eye(3)[None], 20, axis=0), now)
        command = follower.command(now)
        targets.append((command.phase, *command.target.position[:2]))
    assert "unstick" in [phase for phase, *_ in targets]
    assert {round(x - START[0], 4) for phase, x, _ in targets if phase == "trace"} == {0.0, 0.0035, -0.0035}


def giver(floating: Floating, **how) -> Follower:
    return make(floating, 0, role=Role(given_rotation=yaw_rotation(0.4)), **how)


def test_an_object_for_another_hand_is_brought_to_where_the_plans_end_and_held_there():
    floating, meeting = Floating(), np.array([0.0, 0.0, 1.05])
    follower = giver(floating)
    phases = run(follower, floating, lambda step, here: (np.linspace(here.position, meeting, 20), None))
    assert phases[-1] == "hand over"
    assert not {"align", "lower", "release"} & set(phases)
    assert np.linalg.norm(floating.pose.position - meeting) < FollowSettings().meeting
    assert angle_between(floating.pose.rotation, yaw_rotation(0.4)) < 1e-6


def test_an_object_goes_up_and_back_before_it_goes_aside():
    floating, meeting = Floating(), np.array([0.0, 0.0, 1.05])
    floating.pose = Pose(START.copy(), np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]))  # its z along the world's x
    follower = giver(floating, lift=(0.14, -0.02))
    phases = []
    for step in range(60):
        now = floating.read()
        if step % 4 == 0:
            follower.receive(np.linspace(now.object.position, meeting, 20), None, now)
        command = follower.command(now)
        phases.append(command.phase)
        if command.phase != "lift":
            break
        np.testing.assert_allclose(command.target.position, START + np.array([-0.02, 0.0, 0.16]), atol=1e-9)
        floating.move(command.target)
    assert len(phases) > 8
    assert floating.pose.position[2] > START[2] + 0.14

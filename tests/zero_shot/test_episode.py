"""The whole episode on robosuite, with a planner that knows where the peg is in place of a trained one."""

from types import SimpleNamespace

import numpy as np
import pytest

from ocplanner.collection.attempts import attempt
from ocplanner.control.settings import ControlSettings
from ocplanner.demos.recorded_task import object_of, part_gripper, segment_rule
from ocplanner.demos.segments import manipulation_segment
from ocplanner.envs import make_env
from ocplanner.geometry.pose import Pose
from ocplanner.geometry.rotation import angle_between
from ocplanner.zero_shot.episode import run_episode
from ocplanner.zero_shot.result import FAILURES
from peg_plans import plan_to_peg


class KnowingPlanner:
    """Plans from the object's pose instead of pictures, with a few millimetres of error."""

    def __init__(self, env, error: float = 0.003):
        self.env, self.error, self.rng = env, error, np.random.default_rng(0)

    def plan(self, images):
        here = self.env.object_pose()
        yaw = np.arctan2(here.rotation[1, 0], here.rotation[0, 0])
        goal = np.pi / 2 * np.round(yaw / (np.pi / 2))
        positions, rotations = plan_to_peg(here, self.rng.normal(0, self.error, 2), goal)
        return SimpleNamespace(position=positions[None], rotation=rotations[None], probability=np.ones(1))


@pytest.mark.parametrize("robot", ["Panda", "Sawyer", "UR5e"])
def test_an_arm_inserts_the_nut_and_lets_go(robot):
    with make_env("Square", robot, cameras=()) as env:
        episode = run_episode(env, KnowingPlanner(env), 501)
        assert episode.success, episode.failure
        assert episode.released_by == "follower"
        assert episode.failure is None
        assert len(episode.trace.readings) == len(episode.trace.phases) == episode.steps


def test_a_slow_gripper_takes_the_cube_and_keeps_it():
    class Up:
        def plan(self, images):
            here = env.object_pose().position + np.array([0.0, 0.0, 0.06])
            return SimpleNamespace(position=np.linspace(here, np.append(here[:2], 0.9), 20)[None], rotation=None)

    with make_env("Lift", "Jaco", cameras=()) as env:
        episode = run_episode(env, Up(), 501)
        assert episode.success, episode.failure
    assert episode.steps < 200
    held = [
        reading
        for reading, phase in zip(episode.trace.readings, episode.trace.phases, strict=True)
        if phase == "transit"
    ]
    assert np.ptp([reading.grip_point for reading in held], axis=0).max() < 0.01


def test_the_same_seed_gives_the_same_episode():
    with make_env("Square", "Panda", cameras=()) as env:
        first, _, again = (run_episode(env, KnowingPlanner(env), seed) for seed in (502, 503, 502))
        assert first.steps == again.steps
        assert np.array_equal(first.trace.readings[-1].object.position, again.trace.readings[-1].object.position)


class Motionless:
    """A planner that wants the object to stay where it is."""

    def __init__(self, env):
        self.env = env

    def plan(self, images):
        here: Pose = self.env.object_pose()
        return SimpleNamespace(position=np.tile(here.position, (1, 20, 1)), rotation=None, probability=np.ones(1))


@pytest.mark.parametrize("follow", ["gated", "open-loop"])
def test_a_plan_that_leads_nowhere_is_a_classified_failure(follow):
    with make_env("Square", "Panda", cameras=(), horizon=130) as env:
        episode = run_episode(env, Motionless(env), 501, ControlSettings(follow=follow))
    assert not episode.success
    assert episode.released_by is None
    assert episode.steps == 130
    assert episode.failure in FAILURES
    assert episode.failure == "stuck in transit"


class Replay:
    """Plans the motion of one object as a demonstration of the same seed had it."""

    def __init__(self, env, name: str, poses: list[Pose]):
        self.env, self.name, self.poses, self.place = env, name, poses, 0
        self.plans_rotation = True

    def plan(self, images):
        here = self.env.object_pose(self.name)
        near = self.poses[self.place : self.place + 40]
        off = [np.linalg.norm(p.position - here.position) + angle_between(p.rotation, here.rotation) for p in near]
        self.place += int(np.argmin(off))
        rows = np.minimum(self.place + 1 + np.arange(20), len(self.poses) - 1)
        positions, rotations = (np.array([self.poses[row][part] for row in rows]) for part in (0, 1))
        rotation = rotations[None] if self.plans_rotation else None
        return SimpleNamespace(position=positions[None], rotation=rotation, probability=np.ones(1))


def replays(env, seed: int) -> dict[str, Replay]:
    """Of a demonstration of each object, or each arm's part of its way, from its grasp to its release."""
    poses, grippers = {spec.name: [] for spec in env.task.objects}, []

    def note(action):
        grippers.append(action[6::7])
        for name, known in poses.items():
            known.append(env.object_pose(name))

    assert attempt(env, seed, note, noise=0.0)
    found = {}
    for part in (part for spec in env.task.objects for part in spec.parts):
        known = poses[object_of(part)]
        arrays = [np.array([pose[number] for pose in known]) for number in (0, 1)]
        gripper = part_gripper(np.array(grippers), env.task.env_name, part)
        segment = manipulation_segment(*arrays, gripper, segment_rule(env.task.env_name, part))
        found[part] = Replay(env, object_of(part), known[segment.start : segment.stop])
    return found


def test_objects_are_placed_one_after_another():
    with make_env("ToolHang", "Panda", cameras=()) as env:
        planners = replays(env, 502)
        episode = run_episode(env, planners, 502, observe=lambda env: {})
        assert episode.success, (episode.failure, episode.failed_with)
        assert list(dict.fromkeys(episode.trace.objects)) == ["frame", "tool"]
        planners = {"frame": Replay(env, "frame", planners["frame"].poses), "tool": Motionless(env)}
        lone = run_episode(env, planners, 502, observe=lambda env: {})
    assert not lone.success
    assert lone.failed_with == "tool"


def test_two_arms_hand_an_object_over():
    with make_env("Transport", "Panda", cameras=()) as env:
        planners = replays(env, 503)
        planners["payload:0"].plans_rotation = planners["payload:1"].plans_rotation = False
        episode = run_episode(env, planners, 503, observe=lambda env: {})
        assert episode.success, (episode.failure, episode.failed_with)
        assert list(dict.fromkeys(episode.trace.objects)) == ["lid", "trash", "payload"]
        assert episode.trace.phases.count("hand over") > 20
        assert np.linalg.norm(env.arms[0].eef_pose().position - env.object_pose("payload").position) > 0.3

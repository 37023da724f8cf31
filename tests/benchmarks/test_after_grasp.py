import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parent))

import after_grasp

from ocplanner.control.grasp_detection import GraspDetector
from ocplanner.envs import make_env


class Rollout:
    """In place of a policy before its task: notes at which steps it acts."""

    hint = None

    def __init__(self, env, gripper):
        self.env, self.policy, self.steps, self._gripper = env, self, [], gripper

    def reset(self, seed):
        self.steps.clear()

    def _observation(self, gripper):
        return {}

    def act(self, observation):
        self.steps.append(self.env.steps)
        return [[0, 0, 0, 0, 0, 0, self._gripper]]

    def _carried_out(self, action):
        return action


@pytest.mark.parametrize(
    ("held", "success", "outcome"),
    [
        (range(0), None, None),
        (range(3, 6), None, "lost"),
        (range(3, 99), None, "held at the end"),
        (range(3, 6), 8, "success"),
    ],
)
def test_the_second_policy_acts_while_the_object_is_held(monkeypatch, held, success, outcome):
    with make_env("Square", "Panda", cameras=()) as env:
        monkeypatch.setattr(GraspDetector, "update", lambda self, *_: env.steps in held)
        monkeypatch.setattr(type(env), "success", lambda self: self.steps == success)
        grasp, carry = Rollout(env, 1.0), Rollout(env, 1.0)
        assert after_grasp.relay(grasp, carry, 50000, 10) == outcome
        steps = range(success or 10)
        assert carry.steps == [step for step in steps if step in held]
        assert grasp.steps == [step for step in steps if step not in held]

"""The comparison with robosuite's control loop: it notices what differs, and the committed figures are explained."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parent))

from equivalence import TorqueTwin, apart, rollout, torque_difference

from ocplanner.envs import make_env
from ocplanner.envs.robots import ROBOTS

RESULTS = Path(__file__).parents[2] / "results" / "equivalence.json"


def test_torques_agree_from_the_first_substep_after_a_reset() -> None:
    found = torque_difference("IIWA", 2)
    assert found["substeps"] == 50
    assert found["substeps_above_1e-6"] == 0
    assert found["largest"] < 1e-9
    assert 0 < found["rounding"] < 1e-9


def test_another_action_is_noticed() -> None:
    with make_env("Lift", "Panda", cameras=(), control="stock") as env:
        twin = TorqueTwin(env)
        twin._delta = np.full(6, 1e-4)
        env.step(np.zeros(7))
    assert max(twin.differences) > 1e-3


@pytest.mark.parametrize("robot", ROBOTS)
def test_rollouts_that_hold_the_object_agree(robot: str) -> None:
    places = []
    for control in ("stock", "native"):
        with make_env("Square", robot, cameras=(), control=control) as env:
            places.append(rollout(env, 40, "holding"))
    assert max(apart(*places).values()) < 1e-5


def test_the_committed_figures_are_within_tolerance_or_within_robosuites_own_rounding() -> None:
    rows = json.loads(RESULTS.read_text())["rows"]
    assert [row["robot"] for row in rows] == list(ROBOTS)
    for row in rows:
        torques = row["torques"]
        assert torques["largest"] < max(1e-6, 5 * torques["rounding"]), row["robot"]
        for motion, found in row["rollouts"].items():
            for name, distance in found["native"].items():
                chaos = found.get("chaos", {}).get(name, 0.0)
                assert distance < max(1e-5, 5 * chaos), (row["robot"], motion, name)

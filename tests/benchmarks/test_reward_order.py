import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parent))


from behaviours import Episode
from reward_order import area, interval, orders, record

from ocplanner.planner.planner import Planner
from random_planner import write_random_planner


def made(errors, nearer=None) -> Episode:
    """An episode, held all along, whose object is so far from the plan, m."""
    achieved, turned = np.zeros((len(errors), 3)), np.tile(np.eye(3), (len(errors), 1, 1))
    planned = achieved + np.stack([errors, 0 * np.asarray(errors), 0 * np.asarray(errors)], axis=1)
    nearer = -np.asarray(errors) if nearer is None else nearer
    return Episode(True, np.ones(len(errors), bool), (planned, turned), (achieved, turned), nearer)


def test_the_area_is_the_chance_of_a_higher_score():
    assert area(np.array([2.0, 3]), np.array([0.0, 1])) == 1
    assert area(np.array([0.0, 1]), np.array([2.0, 3])) == 0
    assert area(np.array([1.0, 2]), np.array([1.0, 0])) == pytest.approx(3.5 / 4)
    rng = np.random.default_rng(0)
    low, high = interval(rng.normal(1, 1, 200), rng.normal(0, 1, 200))
    assert low < 0.76 < high  # of two normals a standard deviation apart
    assert high - low < 0.15


def test_forms_put_small_errors_first_and_the_literal_one_last():
    rng = np.random.default_rng(0)
    groups = {"human": [made(rng.uniform(0, 0.01, 30)) for _ in range(5)], "expert": [made(rng.uniform(0, 0.01, 30))]}
    found = orders({**groups, "bad": [made(rng.uniform(0.02, 0.1, 30)) for _ in range(6)]}, {})
    for form, best in (("penalty", 1), ("literal", 0), ("exp", 1)):
        assert found[form]["auc"]["bad"]["mean while held"]["auc"] == best
        assert found[form]["auc"]["bad"]["return"]["auc"] == best
        assert found[form]["progress_correlation"] == pytest.approx(2 * best - 1)


def test_behaviours_are_what_their_names_say(square_ph, tmp_path):
    write_random_planner(tmp_path / "planner.safetensors")
    episodes = record(square_ph, Planner.load(tmp_path / "planner.safetensors"), 1)
    assert {name: len(group) for name, group in episodes.items()} == dict.fromkeys(
        ("human", "expert", "released early", "beside the peg", "aimless", "still"), 1
    )
    for name, (one,) in episodes.items():
        assert one.success == (name in ("human", "expert"))
        moved = np.linalg.norm(np.diff(one.achieved[0][one.held], axis=0), axis=1).sum()
        assert (moved < 0.06) == (name == "still"), (name, moved)
        np.testing.assert_array_equal(one.planned[0][~one.held], one.achieved[0][~one.held])
    assert episodes["released early"][0].held.sum() < episodes["expert"][0].held.sum()

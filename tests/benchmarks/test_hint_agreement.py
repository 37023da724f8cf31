import json
import sys
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).parent))


import hint_agreement
from hint_agreement import agreement

from random_planner import write_random_planner


def test_a_hint_that_is_a_third_of_the_action():
    actions = np.random.default_rng(0).uniform(-1, 1, (200, 6))
    found = agreement(actions / 3, actions)
    for values, expected in zip(found[:3], (1, 3, 1)):
        np.testing.assert_allclose(values, expected)
    np.testing.assert_allclose(3 * found.hint, found.action)


def test_a_hint_that_says_nothing_and_one_of_the_wrong_sign():
    rng = np.random.default_rng(0)
    actions, noise = rng.uniform(-1, 1, (2, 4000, 6))
    assert np.abs(agreement(noise, actions).correlation).max() < 0.1
    assert agreement(noise, actions).explained.max() < 0.01
    np.testing.assert_allclose(agreement(-actions, actions).weight, -1)


def test_measures_all_hints_on_a_data_set(tiny_square, tmp_path, monkeypatch):
    planner, out = tmp_path / "p.safetensors", tmp_path / "agreement.json"
    write_random_planner(planner, observe="full", visual=None, mask_rgb=None)
    flags = ["--data", tiny_square("1.4.1", images=True), "--planner", planner, "--horizon-step", 2, 3, "--output", out]
    monkeypatch.setattr(sys, "argv", ["hint_agreement.py", *map(str, flags)])
    hint_agreement.main()
    written = json.loads(out.read_text())
    assert written["steps held"] > 10
    rows = {(row["from"], row["k"]): row for row in written["rows"]}
    assert set(rows) == {(origin, k) for origin in ("object", "plan", "recorded") for k in (2, 3)}
    assert rows["recorded", 2]["correlation"]["x"] > 0.9  # the synthetic nut goes where the hand is told to
    assert rows["object", 2]["action"]["z"] > 0.01
    assert rows["object", 2]["correlation"]["rx"] is None  # the synthetic hand is never told to turn

import json
import sys
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).parent))


import jaco_losses

from ocplanner.envs import make_env
from random_planner import write_random_planner


def test_a_nut_that_lies_on_the_table_is_pushed_by_its_weight():
    with make_env("Square", "Jaco", cameras=()) as env:
        env.reset(0)
        for _ in range(20):
            env.step(np.zeros(7))
        nut = env.model.body_rootid[env.model.geom_bodyid] == env.model.body("SquareNut_main").id
        np.testing.assert_allclose(jaco_losses.push(env, nut), 0.0158 * 9.81, rtol=0.1)


def test_writes_each_loss(tmp_path, monkeypatch):
    planner, out = tmp_path / "p.safetensors", tmp_path / "losses.json"
    write_random_planner(planner)
    flags = ["--planner", str(planner), "--episodes", "1", "--out", str(out)]
    monkeypatch.setattr(sys, "argv", ["jaco_losses.py", *flags])
    jaco_losses.main()
    assert sum(json.loads(out.read_text())["episodes"].values()) == 1

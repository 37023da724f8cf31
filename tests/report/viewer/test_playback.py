from pathlib import Path

import numpy as np
import pytest

from ocplanner.errors import UnknownNameError
from ocplanner.planner.planner import Planner
from ocplanner.report.viewer import record_playback

PLANNER = Path(__file__).parents[3] / "results" / "planners" / "square_masked_h20_pose_0.safetensors"


def test_an_episode_is_kept_step_by_step():
    playback = record_playback(Planner.load(PLANNER), "Panda", 10000)
    steps = len(playback)
    assert steps > 50
    assert all(len(path) == steps for path in playback.positions.values())
    assert all(len(quats) == steps for quats in playback.quats_wxyz.values())
    assert len(playback.achieved) == len(playback.planned) == steps
    nut = playback.positions["SquareNut_main"]
    assert np.linalg.norm(nut - playback.achieved, axis=1).max() < 1e-6
    followed = [step for step, plan in enumerate(playback.planned) if plan is not None]
    assert playback.phases[followed[0]] not in ("grasp", "release")
    assert playback.planned[followed[0]].shape == (20, 3)
    assert playback.title == "Square on Panda, gated, seed 10000"


def test_an_unknown_robot_is_an_error():
    with pytest.raises(UnknownNameError, match="Sawyer"):
        record_playback(Planner.load(PLANNER), "Sawer", 10000)

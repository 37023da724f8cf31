import contextlib
from pathlib import Path

import numpy as np

from ocplanner.report.viewer import record_playback
from ocplanner.zero_shot.settings import TransferConfig
from ocplanner.zero_shot.setup import EpisodeRunner, TransferSetup

PLANNER = Path(__file__).parents[3] / "results" / "planners" / "square_masked_h20_pose_0.safetensors"


def test_an_episode_is_kept_step_by_step():
    playback = record_playback(TransferSetup.of(PLANNER, "Panda"), 10000)
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
    assert playback.title == "Square on Panda (gated, masked), seed 10000"


def test_the_episode_is_the_transfers_whatever_the_conditions():
    config = TransferConfig(mask_error=3, pose_noise=(8.0, 4.0), pose_latency=2, pose_filter=4)
    setup = TransferSetup.of(PLANNER, "Panda", config)
    playback = record_playback(setup, 10003)
    with contextlib.closing(EpisodeRunner(setup)) as runner:
        run = runner.play(10003)
    assert (playback.outcome, len(playback)) == ("success" if run.success else run.failure, run.steps)

"""robomimic configurations that train in seconds, without rollouts and without a graphics card."""

from pathlib import Path
from typing import Any


def quick(config: Any, data: Path, folder: Path, batch: int) -> None:
    """Two epochs of three steps on ``mask/train`` of ``data``; the configuration's values must be unlocked."""
    config.experiment.epoch_every_n_steps = 3
    config.experiment.rollout.enabled = False
    config.experiment.logging.terminal_output_to_txt = False
    config.train.data = str(data)
    config.train.output_dir = str(folder / "robomimic")
    config.train.hdf5_filter_key = "train"
    config.train.cuda = False
    config.train.batch_size = batch
    config.train.num_epochs = 2

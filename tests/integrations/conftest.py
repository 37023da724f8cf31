"""A small labelled data set, and robomimic configurations that train on it in seconds."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch

from ocplanner.guidance.dataset import label_dataset
from ocplanner.guidance.settings import LabelSettings
from quick_robomimic import quick
from random_planner import write_random_planner


@pytest.fixture(autouse=True)
def _the_process_stays_as_it_was():
    """robomimic's ``train`` chooses the number of threads."""
    before = torch.get_num_threads()
    yield
    torch.set_num_threads(before)


@pytest.fixture(scope="session")
def labelled(tiny_square, tmp_path_factory) -> Path:
    """The synthetic recordings with hints 1 and 4 steps ahead, by a planner whose weights are random."""
    folder = tmp_path_factory.mktemp("labelled_for_robomimic")
    write_random_planner(folder / "planner.safetensors", observe="full", visual=None, mask_rgb=None)
    settings = LabelSettings(horizon_steps=(1, 4))
    source = tiny_square("1.4.1", images=True)
    return label_dataset(source, folder / "labelled.hdf5", folder / "planner.safetensors", settings)


@pytest.fixture
def configuration(labelled, tmp_path) -> Callable[..., Any]:
    """``configuration(rnn=False, hint=False, keys=())``: a small robomimic configuration for 2 epochs of 3 steps."""
    from robomimic.config import config_factory

    def make(rnn: bool = False, hint: bool = False, keys: tuple[str, ...] = ()) -> Any:
        config = config_factory("bc")
        with config.values_unlocked():
            quick(config, labelled, tmp_path, batch=8)
            config.experiment.save.every_n_epochs = 1
            config.train.seq_length = 5 if rnn else 1
            config.algo.gmm.enabled = True
            config.algo.actor_layer_dims = () if rnn else (32, 32)
            config.algo.rnn.enabled = rnn
            config.algo.rnn.horizon = 5
            config.algo.rnn.hidden_dim = 16
            low_dim = ["object", "robot0_eef_pos", "robot0_eef_quat", "robot0_gripper_qpos", *keys]
            if hint:
                low_dim.append("ocp_hint")
                config.algo.ocp_hint.enabled = True
                config.algo.ocp_hint.horizons = [1, 4]
            config.observation.modalities.obs.low_dim = low_dim
        return config

    return make

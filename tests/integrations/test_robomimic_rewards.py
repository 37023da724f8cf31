"""robomimic's own offline reinforcement learning on a file with a planner's rewards, as it is."""

import re

import h5py
import numpy as np
import pytest
import torch

from ocplanner.guidance.dataset import label_dataset
from ocplanner.guidance.rewards import RewardConfig
from ocplanner.guidance.settings import LabelSettings
from quick_robomimic import quick
from random_planner import write_random_planner

from robomimic.config import config_factory  # isort: skip
from robomimic.scripts import train as script  # isort: skip

pytestmark = pytest.mark.filterwarnings("ignore")  # robomimic's own


@pytest.fixture(scope="module", params=["augment", "only"])
def rewarded(request, tiny_square, tmp_path_factory):
    folder = tmp_path_factory.mktemp("rewarded")
    write_random_planner(folder / "planner.safetensors", observe="full", visual=None, mask_rgb=None)
    settings = LabelSettings(hints=False, reward=request.param, reward_config=RewardConfig(a=1.0, b=1.0))
    source = tiny_square("1.4.1", images=True)  # without next_obs
    return label_dataset(source, folder / "rewarded.hdf5", folder / "planner.safetensors", settings)


@pytest.mark.parametrize("name", ["bcq", "iql"])
def test_robomimics_script_learns_from_the_rewards(rewarded, name, tmp_path, capsys):
    config = config_factory(name)
    with config.values_unlocked():
        quick(config, rewarded, tmp_path, batch=270)  # all of mask/train
        config.experiment.save.every_n_epochs = 2
        config.observation.modalities.obs.low_dim = [
            "object", "robot0_eef_pos", "robot0_eef_quat", "robot0_gripper_qpos"
        ]  # fmt: skip
    config.lock()
    script.train(config, torch.device("cpu"))
    seen = first_numbers(capsys.readouterr().out)
    (folder,) = (tmp_path / "robomimic" / "test").iterdir()
    assert list((folder / "models").glob("*.pth"))
    with h5py.File(rewarded) as file:
        rewards = np.concatenate([file[f"data/{demo}/rewards"][:] for demo in ("demo_0", "demo_1", "demo_10")])
    assert rewards.mean() < -0.5
    # Fresh critics say about nothing, so the first targets are little but the rewards.
    if name == "bcq":
        assert seen["Critic/Q_Targets"] == pytest.approx(rewards.mean(), abs=0.3)
    else:
        assert seen["critic/critic1_loss"] == pytest.approx((rewards**2).mean(), rel=0.3)


def first_numbers(said: str) -> dict[str, float]:
    """What the first epoch logged, by name."""
    found = re.findall(r'^\s+"([^"]+)": ([-\d.e]+),?$', said, flags=re.MULTILINE)
    return {name: float(value) for name, value in reversed(found)}

import dataclasses

import pytest

from ocplanner.errors import InvalidValueError, UnknownNameError
from ocplanner.planner.config import (
    AugmentationConfig,
    EncoderConfig,
    LossConfig,
    NetworkConfig,
    PlannerTraining,
    preset,
)
from ocplanner.settings import build, to_dict
from ocplanner.training.schedule import StageConfig


@pytest.mark.parametrize("name", ["cpu", "robomimic"])
def test_presets_survive_a_round_trip(name):
    config = preset(name)
    assert config.preset == name
    assert build(PlannerTraining, to_dict(config)) == config


def test_the_robomimic_preset_is_robomimics_encoder():
    encoder = preset("robomimic").network.encoder
    assert (encoder.type, encoder.pool, encoder.keypoints, encoder.feature) == ("resnet18", "spatial_softmax", 32, 64)


@pytest.mark.parametrize(
    "make", [lambda: preset("tpu"), lambda: NetworkConfig(outputs="yaw"), lambda: LossConfig(latent="l1")]
)
def test_unknown_names_list_the_known(make):
    with pytest.raises(UnknownNameError, match="known: "):
        make()


@pytest.mark.parametrize(
    ("kind", "values"),
    [
        (NetworkConfig, {"horizon": 0}),
        (NetworkConfig, {"crop": 100}),
        (NetworkConfig, {"image_size": 1025}),
        (NetworkConfig, {"modes": 0}),
        (NetworkConfig, {"latent": 0}),
        (EncoderConfig, {"channels": ()}),
        (EncoderConfig, {"temperature": 0.0}),
        (LossConfig, {"kl": -1.0}),
        (StageConfig, {"steps": 10, "batch": 0}),
        (StageConfig, {"steps": 10, "learning_rate": 0.0}),
        (StageConfig, {"steps": 10, "ema": 1.0}),
        (AugmentationConfig, {"swap": 0.8, "union": 0.8}),
        (AugmentationConfig, {"blob": 1.5}),
        (PlannerTraining, {"cameras": ()}),
        (PlannerTraining, {"cameras": ("agentview", "agentview")}),
        (PlannerTraining, {"seed": -1}),
        (PlannerTraining, {"threads": 0}),
        (PlannerTraining, {"predictor": StageConfig(steps=0)}),
        (PlannerTraining, {"finetune": StageConfig(steps=0), "keep": "finetune"}),
        (PlannerTraining, {"augmentation": AugmentationConfig(crop_shift=5)}),
    ],
)
def test_numbers_outside_their_domain(kind, values):
    with pytest.raises(InvalidValueError):
        kind(**values)


def test_unknown_keys_are_named():
    with pytest.raises(InvalidValueError, match="horzion"):
        build(PlannerTraining, {"network": {"horzion": 5}})


def test_configurations_are_frozen():
    with pytest.raises(dataclasses.FrozenInstanceError):
        preset("cpu").seed = 3

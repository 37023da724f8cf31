from dataclasses import replace

import pytest

from ocplanner.errors import InvalidValueError, UnknownNameError
from ocplanner.planner.config import EncoderConfig
from ocplanner.policies.bcq_config import BCQConfig
from ocplanner.policies.config import (
    GmmConfig,
    HintConfig,
    NetworkConfig,
    ObservationConfig,
    PolicyTraining,
    preset,
    training_from_dict,
)
from ocplanner.settings import to_dict

EVERY = [
    (name, algorithm, kind)
    for name in ("cpu", "robomimic")
    for algorithm in ("bc", "bc-rnn", "bcq")
    for kind in ("state", "image")
]


@pytest.mark.parametrize(("name", "algorithm", "kind"), EVERY)
def test_presets_survive_a_file(name, algorithm, kind):
    config = preset(name, algorithm, kind)
    if algorithm != "bcq":
        config = replace(config, network=replace(config.network, hint=HintConfig((1, 5))))
    assert training_from_dict(to_dict(config)) == config


@pytest.mark.parametrize("algorithm", ["bc", "bc-rnn"])
def test_the_robomimic_preset_is_the_published_one(algorithm):
    """Mandlekar et al. 2021, appendix; Adam, no weight decay, no schedule, no clipping, no normalisation."""
    state, image = (preset("robomimic", algorithm, kind) for kind in ("state", "image"))
    for config in (state, image):
        assert (config.learning_rate, config.weight_decay, config.schedule, config.clip) == (1e-4, 0, "constant", None)
        assert (config.ema, config.warmup, config.mask) == (0, 0, "train")
        assert config.network.hidden == (1024, 1024)
        assert (config.network.lstm_layers, config.network.sequence) == (2, 10)
        assert config.network.gmm == GmmConfig(5, 1e-4, "softplus", tanh_means=True, low_noise=True)
        assert not config.observation.normalise
    assert (state.steps, state.batch, state.save_every) == (2000 * 100, 100, 50 * 100)
    assert (image.steps, image.batch, image.save_every) == (600 * 500, 16, 20 * 500)
    assert (state.network.lstm_hidden, image.network.lstm_hidden) == (400, 1000)
    assert state.observation.low_dim == ("object", "robot0_eef_pos", "robot0_eef_quat", "robot0_gripper_qpos")
    assert image.observation.low_dim == ("robot0_eef_pos", "robot0_eef_quat", "robot0_gripper_qpos")
    assert image.observation.cameras == ("agentview", "robot0_eye_in_hand")
    assert (image.observation.image_size, image.observation.crop) == (84, 76)
    encoder = image.observation.encoder
    assert encoder == EncoderConfig(
        type="resnet18", pool="spatial_softmax", keypoints=32, temperature=1.0, feature=64, feature_relu=True
    )


def test_the_robomimic_preset_of_bcq_is_the_published_one():
    """robomimic's ``modify_bcq_config_for_dataset`` for Proficient-Human data."""
    state, image = (preset("robomimic", "bcq", kind) for kind in ("state", "image"))
    for config in (state, image):
        assert (config.learning_rate, config.weight_decay, config.schedule, config.clip) == (1e-4, 0, "constant", None)
        assert (config.ema, config.warmup, config.mask, config.observation.normalise) == (0, 0, "train", False)
    assert (state.steps, state.batch, state.save_every) == (2000 * 100, 100, 50 * 100)
    assert (image.steps, image.batch, image.save_every) == (600 * 500, 16, 20 * 500)
    published = BCQConfig(
        critic_hidden=(300, 400),
        critic_learning_rate=1e-4,
        critics=2,
        pessimism=0.75,
        discount=0.99,
        tau=5e-4,
        proposals=10,
        rollout_proposals=100,
        vae_hidden=(300, 400),
        latent=14,
        kl_weight=0.05,
    )
    assert state.algorithm_settings == published
    assert image.algorithm_settings == replace(published, critic_learning_rate=1e-3, vae_hidden=(1024, 1024))
    assert image.observation == preset("robomimic", "bc", "image").observation


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"discount": 1.0}, r"discount 1.0 must lie in \[0, 1\)"),
        ({"tau": 0.0}, "tau 0.0"),
        ({"pessimism": 2}, "pessimism 2"),
        ({"critic_learning_rate": 0.0}, "critic learning rate 0.0"),
        ({"kl_weight": -1.0}, "KL weight -1.0"),
        ({"proposals": 0}, "proposals and latent must be at least 1"),
    ],
)
def test_impossible_settings_of_bcq(setting, message):
    with pytest.raises(InvalidValueError, match=message):
        BCQConfig(**setting)


def test_unknown_keys_are_named():
    with pytest.raises(InvalidValueError, match=r"unknown NetworkConfig keys \['hiden'\]; known: .*'hidden'"):
        training_from_dict({"network": {"hiden": [3]}})


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda: preset("gpu"), UnknownNameError, "unknown preset 'gpu'; known: cpu, robomimic"),
        (lambda: preset("cpu", "iql"), UnknownNameError, "unknown algorithm 'iql'; known: bc, bc-rnn, bcq"),
        (lambda: PolicyTraining(learning_rate=float("nan")), InvalidValueError, "learning rate nan must be positive"),
        (lambda: PolicyTraining(batch=0), InvalidValueError, "at least 1"),
        (lambda: PolicyTraining(ema=1.0), InvalidValueError, "ema 1.0"),
        (lambda: GmmConfig(modes=0), InvalidValueError, "modes 0"),
        (lambda: GmmConfig(min_std=0.0), InvalidValueError, "min_std 0.0"),
        (lambda: HintConfig(horizons=(0,)), InvalidValueError, "hint horizons"),
        (lambda: HintConfig(horizons=(1, 1)), InvalidValueError, "name each once"),
        (lambda: ObservationConfig(crop=85), InvalidValueError, "crop 85 must lie in 1..84"),
        (lambda: ObservationConfig(low_dim=()), InvalidValueError, "at least one observation"),
        (lambda: PolicyTraining("bcq"), InvalidValueError, "bcq needs algorithm_settings of BCQConfig"),
        (
            lambda: PolicyTraining("bc", algorithm_settings=BCQConfig()),
            InvalidValueError,
            "bc needs algorithm_settings of AlgorithmSettings, not BCQConfig",
        ),
        (lambda: replace(preset("cpu", "bcq"), precision="bfloat16"), InvalidValueError, "bcq learns in float32 alone"),
        (lambda: PolicyTraining("bc", precision="float16"), UnknownNameError, "precision"),
        (
            lambda: PolicyTraining("bcq", network=NetworkConfig(hint=HintConfig()), algorithm_settings=BCQConfig()),
            InvalidValueError,
            "bcq reads no hint",
        ),
        (lambda: NetworkConfig(sequence=0), InvalidValueError, "sequence must be at least 1"),
    ],
)
def test_impossible_settings(make, error, message):
    with pytest.raises(error, match=message):
        make()

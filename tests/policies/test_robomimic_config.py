import json
from pathlib import Path

import pytest
import torch
from robomimic import exps
from robomimic.config import BCConfig
from robomimic.scripts import generate_paper_configs as paper

from ocplanner.errors import InvalidValueError
from ocplanner.policies.config import HintConfig, ObservationConfig, preset
from ocplanner.policies.robomimic_config import read_robomimic_config

SOME_CAMERA = {
    "observation.modalities.obs.rgb": ["agentview_image"],
    "observation.encoder.rgb.obs_randomizer_class": "CropRandomizer",
    "observation.encoder.rgb.obs_randomizer_kwargs": {"crop_height": 76, "crop_width": 76},
}
RNN = {"algo.rnn.enabled": True, "train.seq_length": 10, "algo.actor_layer_dims": []}


@pytest.fixture
def written(tmp_path):
    """``written(values, **changes)``: the path of a configuration; changes by dotted key."""

    def write(values=None, changes=None) -> Path:
        values = {"algo_name": "bc", "algo": {"gmm": {"enabled": True}}} if values is None else values
        values = json.loads(json.dumps(values))
        for key, value in (changes or {}).items():
            *path, last = key.split(".")
            part = values
            for name in path:
                part = part.setdefault(name, {})
            part[last] = value
        path = tmp_path / "config.json"
        path.write_text(json.dumps(values))
        return path

    return write


@pytest.fixture
def template() -> dict:
    return json.loads((Path(exps.__path__[0]) / "templates" / "bc.json").read_text())


def published(algorithm: str, kind: str) -> BCConfig:
    """The configuration of the paper's Square PH run, from robomimic's own generator."""
    config = BCConfig()
    defaults = {
        "state": paper.modify_config_for_default_low_dim_exp,
        "image": paper.modify_config_for_default_image_exp,
    }
    layout = "low_dim" if kind == "state" else "image"
    config = defaults[kind](config)
    config = paper.modify_config_for_dataset(config, "square", "ph", layout, "/data")
    change = {"bc": paper.modify_bc_config_for_dataset, "bc-rnn": paper.modify_bc_rnn_config_for_dataset}
    return change[algorithm](config, "square", "ph", layout)


@pytest.mark.parametrize("kind", ["state", "image"])
@pytest.mark.parametrize("algorithm", ["bc", "bc-rnn"])
def test_the_published_configurations_are_the_robomimic_preset(written, algorithm, kind):
    given = read_robomimic_config(written(published(algorithm, kind)))
    ours, wanted = given.training, preset("robomimic", algorithm, kind)
    assert given.data is not None
    assert given.data.parent == Path("/data/square/ph")
    assert set(ours.observation.low_dim) == set(wanted.observation.low_dim)
    for name in ("cameras", "crop", "image_size", "normalise"):
        assert getattr(ours.observation, name) == getattr(wanted.observation, name)
    if kind == "image":
        assert ours.observation.encoder == wanted.observation.encoder
    for name in ("gmm", "hint", "sequence", *(("hidden",) if algorithm == "bc" else ("lstm_hidden", "lstm_layers"))):
        assert getattr(ours.network, name) == getattr(wanted.network, name)
    for name in ("algorithm", "steps", "batch", "learning_rate", "weight_decay", "schedule", "warmup", "clip", "ema"):
        assert getattr(ours, name) == getattr(wanted, name)
    assert (ours.mask, ours.seed) == ("train", 1)
    assert ours.save_every == {"state": 5000, "image": 10_000}[kind] == wanted.save_every
    assert {"experiment.logging", "experiment.rollout", "train.output_dir", "algo.vae"} <= set(given.ignored)


def test_every_key_of_robomimics_template_is_known(written, template):
    with pytest.raises(InvalidValueError) as error:
        read_robomimic_config(written(template))
    assert str(error.value).endswith("algo.gmm.enabled is false: our policies have a mixture: set it to true")
    given = read_robomimic_config(written(template, {"algo.gmm.enabled": True}))
    assert given.training == read_robomimic_config(written()).training
    assert given.data is None
    assert given.training.mask is None
    assert {"algo.rnn.rnn_type", "algo.vae", "train.output_dir", "experiment.logging"} <= set(given.ignored)
    used = ("algo.gmm", "algo.rnn.enabled", "train.batch_size", "algo.optim_params.policy.learning_rate.initial")
    assert not any(used_key.startswith(name) for name in given.ignored for used_key in used)


def test_values_arrive(written):
    changes = {
        "train.data": "/data/x.hdf5",
        "train.hdf5_filter_key": "20_percent",
        "train.hdf5_normalize_obs": True,
        "train.batch_size": 7,
        "train.num_epochs": 3,
        "train.seed": 0,
        "train.max_grad_norm": 2,
        "experiment.epoch_every_n_steps": 11,
        "experiment.save.every_n_epochs": 2,
        "algo.optim_params.policy.optimizer_type": "adamw",
        "algo.optim_params.policy.regularization.L2": 0.1,
        "algo.optim_params.policy.learning_rate": {
            "initial": 0.01, "scheduler_type": "cosine", "step_every_batch": True, "decay_factor": 0.1
        },
        "algo.gmm": {
            "enabled": True, "num_modes": 3, "min_std": 0.01, "std_activation": "exp", "low_noise_eval": False
        },
        "algo.actor_layer_dims": [5],
        "observation.modalities.obs.low_dim": ["a", "ocp_hint"],
    }  # fmt: skip
    given = read_robomimic_config(written(changes=changes))
    config = given.training
    assert given.data == Path("/data/x.hdf5")
    assert (config.mask, config.batch, config.steps, config.save_every, config.seed) == ("20_percent", 7, 33, 22, 0)
    assert (config.learning_rate, config.weight_decay, config.schedule, config.clip) == (0.01, 0.1, "cosine", 2)
    gmm = config.network.gmm
    assert (gmm.modes, gmm.min_std, gmm.std_activation, gmm.low_noise) == (3, 0.01, "exp", False)
    assert config.network.hidden == (5,)
    assert config.network.hint is None
    assert (config.observation.low_dim, config.observation.normalise) == (("a", "ocp_hint"), True)


def test_the_lstm_and_the_cameras_arrive(written):
    changes = RNN | SOME_CAMERA
    changes |= {"train.seq_length": 6, "algo.rnn.horizon": 6, "algo.rnn.hidden_dim": 9, "algo.rnn.num_layers": 1}
    changes["observation.encoder.rgb.core_kwargs"] = {"feature_dimension": 8, "pool_kwargs": {"num_kp": 4}}
    config = read_robomimic_config(written(changes=changes)).training
    network = config.network
    assert config.algorithm == "bc-rnn"
    assert (network.sequence, network.lstm_hidden, network.lstm_layers) == (6, 9, 1)
    assert config.observation.cameras == ("agentview",)
    assert (config.observation.encoder.feature, config.observation.encoder.keypoints) == (8, 4)
    uncropped = SOME_CAMERA | {"observation.encoder.rgb.obs_randomizer_class": None}
    assert read_robomimic_config(written(changes=uncropped)).training.observation.crop == ObservationConfig().image_size


def test_the_hint_is_the_one_of_the_integration_and_no_observation(written):
    changes = {
        "algo.ocp_hint": {"enabled": True, "horizons": [1, 5], "initial_weight": 0.5},
        "observation.modalities.obs.low_dim": ["object", "ocp_hint"],
    }
    config = read_robomimic_config(written(changes=changes)).training
    assert config.network.hint == HintConfig((1, 5), 0.5)
    assert config.observation.low_dim == ("object",)


@pytest.mark.parametrize("saves", [{"enabled": False}, {"every_n_epochs": None}])
def test_without_regular_saves_only_the_last_policy_is_kept(written, saves):
    config = read_robomimic_config(written(changes={"experiment.save": saves})).training
    assert config.save_every == config.steps


@pytest.mark.parametrize("entry", [{"filter_key": "valid"}, {"filter_key": None, "weight": 2.0, "eval": False}])
def test_a_list_of_one_file_is_that_file(written, entry):
    given = read_robomimic_config(written(changes={"train.data": [{"path": "~/x.hdf5"} | entry]}))
    assert given.data == Path.home() / "x.hdf5"
    assert given.training.mask == entry["filter_key"]


@pytest.mark.parametrize(("present", "device"), [(True, "cuda"), (False, "cpu")])
def test_cuda_means_a_gpu_if_there_is_one(monkeypatch, written, present, device):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: present)
    assert read_robomimic_config(written()).training.device == device
    assert read_robomimic_config(written(changes={"train.cuda": False})).training.device == "cpu"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"train.colour": 1, "algo.gmm.modes": 5}, "unknown keys algo.gmm.modes, train.colour"),
        ({"experiment.rollout.speed": 1}, "unknown keys experiment.rollout.speed"),
        ({"algo_name": "bcq"}, 'algo_name is "bcq"; only "bc"'),
        ({"algo.gmm.enabled": False}, "algo.gmm.enabled is false: our policies have a mixture"),
        ({"algo.gaussian.enabled": True}, "algo.gaussian.enabled is true: only false can be honoured"),
        ({"algo.vae.enabled": True}, "algo.vae.enabled is true"),
        ({"algo.transformer.enabled": True}, "algo.transformer.enabled is true"),
        ({"algo.rnn.enabled": True, "train.seq_length": 10}, "algo.actor_layer_dims [1024, 1024]: no layers follow"),
        (RNN | {"train.seq_length": 1}, "train.seq_length 1: set it to algo.rnn.horizon, 10"),
        ({"train.seq_length": 2}, "train.seq_length 2: set it to 1"),
        (RNN | {"algo.rnn.rnn_type": "GRU"}, 'algo.rnn.rnn_type is "GRU"'),
        (RNN | {"algo.rnn.open_loop": True}, "algo.rnn.open_loop is true"),
        (RNN | {"algo.rnn.kwargs": {"bidirectional": True, "dropout": 0.1}}, "unknown keys algo.rnn.kwargs.dropout"),
        ({"algo.optim_params.policy.regularization.L2": 0.1}, "regularization.L2 0.1: only adamw"),
        ({"algo.optim_params.policy.optimizer_type": "sgd"}, "'sgd': known are adam, adamw"),
        ({"algo.optim_params.policy.learning_rate.epoch_schedule": [9]}, "epoch_schedule is [9]"),
        ({"algo.optim_params.policy.learning_rate.scheduler_type": "cosine"}, "step_every_batch is false"),
        ({"algo.optim_params.policy.learning_rate.initial": 0}, "initial 0 must be positive"),
        ({"train.batch_size": "many"}, 'train.batch_size "many": give a whole number'),
        ({"train.batch_size": True}, "train.batch_size true: give a whole number"),
        ({"train.num_epochs": 0}, "train.num_epochs 0 must be at least 1"),
        ({"experiment.epoch_every_n_steps": None}, "experiment.epoch_every_n_steps null: give a whole number"),
        ({"experiment.save.every_n_epochs": 0}, "every_n_epochs 0: give at least 1"),
        ({"experiment.ckpt_path": "a.pth"}, 'experiment.ckpt_path is "a.pth": only null'),
        ({"train.action_keys": ["actions_abs"]}, 'train.action_keys is ["actions_abs"]'),
        ({"train.action_config.actions.normalization": "min_max"}, 'normalization is "min_max"'),
        ({"train.frame_stack": 10}, "train.frame_stack is 10"),
        ({"train.goal_mode": "last"}, 'train.goal_mode is "last"'),
        ({"train.data": [{"path": "a"}, {"path": "b"}]}, "train.data must name one file"),
        ({"train.data": [{"path": "a", "demo_limit": 3}]}, "train.data: demo_limit cannot be honoured"),
        ({"train.data": 3}, "train.data 3: give a value of another type"),
        ({"observation.modalities.obs.depth": ["d"]}, 'observation.modalities.obs.depth is ["d"]'),
        ({"observation.modalities.obs.low_dim": ["a", "a"]}, "give names, each once"),
        ({"observation.modalities.obs.rgb": ["agentview"]}, "'agentview' must end in '_image'"),
        (SOME_CAMERA | {"train.hdf5_normalize_obs": True}, "would scale the pictures too"),
        (SOME_CAMERA | {"observation.encoder.rgb.core_class": "R3M"}, 'core_class is "R3M"'),
        (SOME_CAMERA | {"observation.encoder.rgb.core_kwargs.flavour": 1}, "unknown keys observation.encoder.rgb"),
        (SOME_CAMERA | {"observation.encoder.rgb.core_kwargs.backbone_kwargs.pretrained": True}, "pretrained is true"),
        (SOME_CAMERA | {"observation.encoder.rgb.obs_randomizer_kwargs.crop_width": 70}, "crop_width is 70"),
        (SOME_CAMERA | {"observation.encoder.rgb.obs_randomizer_kwargs.num_crops": 2}, "num_crops is 2"),
        (
            SOME_CAMERA | {"observation.encoder.rgb.obs_randomizer_kwargs": {"crop_height": 216, "crop_width": 216}},
            "crop_height 216: pictures have 84 pixels",
        ),
        ({"algo.ocp_hint": {"enabled": True, "horizons": [0]}}, "give positive whole numbers"),
    ],
)
def test_what_cannot_be_honoured_is_named(written, changes, message):
    with pytest.raises(InvalidValueError) as error:
        read_robomimic_config(written(changes=changes))
    assert message in str(error.value)


def test_everything_that_is_wrong_is_named_at_once(written):
    changes = {"train.colour": 1, "algo.gmm.enabled": False, "train.batch_size": -1}
    with pytest.raises(InvalidValueError) as error:
        read_robomimic_config(written(changes=changes))
    assert all(name in str(error.value) for name in ("train.colour", "algo.gmm.enabled", "train.batch_size"))


@pytest.mark.parametrize(("text", "message"), [("{", "is no JSON"), ("[]", "algo_name is null")])
def test_files_that_are_no_configuration(tmp_path, text, message):
    path = tmp_path / "c.json"
    path.write_text(text)
    with pytest.raises(InvalidValueError, match=message):
        read_robomimic_config(path)
    with pytest.raises(InvalidValueError, match="cannot be read: No such file"):
        read_robomimic_config(tmp_path / "absent.json")

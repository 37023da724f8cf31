"""What our networks compute with robomimic's weights, against robomimic."""

import json
import sys

import h5py
import pytest
import torch
from robomimic.scripts.train import train
from robomimic.utils.file_utils import policy_from_checkpoint

from ocplanner.errors import InvalidValueError, MismatchError, ModelFileError
from ocplanner.integrations.robomimic import export_policy
from ocplanner.integrations.robomimic.__main__ import main
from ocplanner.policies.policy import Policy

pytestmark = pytest.mark.filterwarnings("ignore")  # robomimic's own


@pytest.fixture
def trained(configuration, tmp_path):
    """``trained(rnn, hint, normalise, image)``: a checkpoint of a short run of robomimic's train.py."""

    def make(rnn=False, hint=False, normalise=False, image=False):
        config = configuration(rnn, hint)
        with config.unlocked():
            config.train.hdf5_normalize_obs = normalise
            if image:
                config.train.batch_size = 2
                config.train.num_epochs = 1
                config.experiment.save.enabled = False  # but for the last: a ResNet18 with Adam's state has 135 MB
                config.observation.modalities.obs.rgb = ["agentview_image"]
                config.observation.encoder.rgb.core_kwargs.feature_dimension = 64
                config.observation.encoder.rgb.obs_randomizer_class = "CropRandomizer"
                config.observation.encoder.rgb.obs_randomizer_kwargs.update({"crop_height": 76, "crop_width": 76})
        config.lock()
        train(config, torch.device("cpu"))
        (path,) = (tmp_path / "robomimic" / "test").glob("*/last.pth")
        return path

    return make


def theirs(checkpoint, observation, steps):
    """Means, standard deviations (low noise) and logits of robomimic's network, step by step."""
    policy, _ = policy_from_checkpoint(ckpt_path=str(checkpoint), device=torch.device("cpu"), verbose=False)
    policy.start_episode()
    network, memory, found = policy.policy.nets["policy"], None, []
    for t in steps:
        seen = policy._prepare_observation({key: value[t].copy() for key, value in observation.items()})
        if hasattr(network, "forward_train_step"):
            memory = network.get_rnn_init_state(1, torch.device("cpu")) if memory is None else memory
            mixture, memory = network.forward_train_step(seen, rnn_state=memory)
        else:
            mixture = network.forward_train(seen)
        found.append((mixture.component_distribution.base_dist.loc[0], mixture.mixture_distribution.probs[0]))
    return found


@pytest.mark.parametrize(
    "kind",
    [{}, {"hint": True}, {"normalise": True}, {"image": True, "hint": True}],
    ids=["plain", "hint", "normalised", "image"],
)
@pytest.mark.parametrize("rnn", [False, True], ids=["bc", "bc-rnn"])
def test_our_networks_compute_what_robomimics_do(trained, labelled, tmp_path, rnn, kind):
    checkpoint = trained(rnn, **kind)
    policy = Policy.load(export_policy(checkpoint, tmp_path / "policy.safetensors"))
    assert policy.training.algorithm == ("bc-rnn" if rnn else "bc")
    assert (policy.training.network.hint is not None) == kind.get("hint", False)
    assert policy.header.step == (3 if kind.get("image") else 6)
    with h5py.File(labelled) as file:
        seen = {key: file[f"data/demo_2/obs/{key}"][()] for key in policy.observation_keys}
    steps = (38, 39, 40, 41)
    memory = None
    with torch.inference_mode():
        expected = theirs(checkpoint, seen, steps)
        for t, (means, weights) in zip(steps, expected):
            ours = policy._tensors({key: value[t : t + 1] for key, value in seen.items()})
            if rnn:
                ours = ours._replace(
                    low_dim=ours.low_dim[None],
                    images={name: image[None] for name, image in ours.images.items()},
                    hint=None if ours.hint is None else ours.hint[None],
                )
            mixture, memory = policy.network.distribution(ours, memory)
            torch.testing.assert_close(mixture.means.reshape(means.shape), means, rtol=1e-4, atol=1e-5)
            torch.testing.assert_close(mixture.logits.softmax(-1).flatten(), weights, rtol=1e-4, atol=1e-5)


def test_the_command_writes_a_policy_that_acts(trained, labelled, tmp_path, monkeypatch, capsys):
    checkpoint, out = trained(hint=True), tmp_path / "policy.safetensors"
    arguments = ["export", "--checkpoint", str(checkpoint), "--out", str(out), "--data", str(labelled)]
    monkeypatch.setattr(sys, "argv", ["robomimic", *arguments])
    capsys.readouterr()
    main()
    assert capsys.readouterr().out == f"{out}\n"
    policy = Policy.load(out)
    with h5py.File(labelled) as file:
        action = policy.act({key: file[f"data/demo_2/obs/{key}"][40:41] for key in policy.observation_keys})
    assert action.shape == (1, 7)
    assert policy.header.labels.settings["horizon_steps"] == [1, 4]


def test_what_is_no_checkpoint_is_refused(tmp_path, monkeypatch, capsys):
    path = tmp_path / "x.pth"
    path.write_bytes(b"nothing")
    monkeypatch.setattr(sys, "argv", ["robomimic", "export", "--checkpoint", str(path), "--out", "y"])
    with pytest.raises(SystemExit) as left:
        main()
    assert left.value.code == 2
    assert "x.pth is no checkpoint of robomimic's" in capsys.readouterr().err
    with pytest.raises(ModelFileError, match="No such file"):
        export_policy(tmp_path / "absent.pth", tmp_path / "y")


def changed(checkpoint, change):
    found = torch.load(checkpoint, weights_only=False)
    change(found)
    torch.save(found, checkpoint)
    return checkpoint


def test_checkpoints_that_our_networks_cannot_be(trained, tmp_path):
    checkpoint = trained()

    def without_mixture(found):
        values = json.loads(found["config"])
        values["algo"]["gmm"]["enabled"] = False
        found["config"] = json.dumps(values)

    def with_one_layer_less(found):
        values = json.loads(found["config"])
        values["algo"]["gmm"]["enabled"] = True
        values["algo"]["actor_layer_dims"] = [32]
        found["config"] = json.dumps(values)

    def without_weights(found):
        with_two_layers(found)
        del found["model"]["nets"]["policy.nets.mlp._model.0.weight"]

    def with_two_layers(found):
        values = json.loads(found["config"])
        values["algo"]["actor_layer_dims"] = [32, 32]
        found["config"] = json.dumps(values)

    with pytest.raises(InvalidValueError, match=r"last\.pth: algo\.gmm\.enabled is false"):
        export_policy(changed(checkpoint, without_mixture), tmp_path / "y")
    for change in (with_one_layer_less, without_weights):
        with pytest.raises(MismatchError, match="not those of its configuration"):
            export_policy(changed(checkpoint, change), tmp_path / "y")
    assert not (tmp_path / "y").exists()

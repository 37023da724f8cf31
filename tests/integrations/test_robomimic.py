import json
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import h5py
import numpy as np
import pytest
import torch

import ocplanner.integrations.robomimic as integration
from ocplanner.errors import InvalidValueError, MismatchError, VersionError
from ocplanner.integrations.robomimic.__main__ import main
from ocplanner.policies.config import HintConfig
from ocplanner.policies.gmm import Mixture
from ocplanner.policies.hint import HintWeights
from ocplanner.policies.policy import Policy
from ocplanner.policies.robomimic_config import read_robomimic_config
from ocplanner.policies.train import train_policy

from robomimic.algo import algo_factory  # isort: skip
from robomimic.algo.algo import algo_name_to_factory_func  # isort: skip
from robomimic.config import config_factory  # isort: skip
from robomimic.scripts import train as script  # isort: skip
from robomimic.utils import file_utils, obs_utils  # isort: skip

SHAPES = {"object": [14], "robot0_eef_pos": [3], "robot0_eef_quat": [4], "robot0_gripper_qpos": [2]}
WIDTH = 13
pytestmark = pytest.mark.filterwarnings("ignore")  # robomimic's own


def algorithm(config, shapes=None, seed=0):
    obs_utils.initialize_obs_utils_with_config(config)
    config.unlock()
    for part in config.algo.optim_params.values():
        part.num_train_batches, part.num_epochs = 3, 2
    config.lock()
    hint = {"ocp_hint": [WIDTH]} if "ocp_hint" in config.observation.modalities.obs.low_dim else {}
    torch.manual_seed(seed)
    return algo_factory("bc", config, shapes or SHAPES | hint, 7, torch.device("cpu"))


def batch(seed=0, steps=5):
    generator = torch.Generator().manual_seed(seed)
    seen = {key: torch.randn(6, steps, *shape, generator=generator) for key, shape in SHAPES.items()}
    seen["ocp_hint"] = torch.cat(
        [torch.randn(6, steps, WIDTH - 1, generator=generator), torch.ones(6, steps, 1)], dim=-1
    )
    return {"obs": seen, "actions": torch.rand(6, steps, 7, generator=generator) * 2 - 1}


def zeroed(data):
    return data | {"obs": data["obs"] | {"ocp_hint": torch.zeros_like(data["obs"]["ocp_hint"])}}


def switched_off(data):
    hint = data["obs"]["ocp_hint"].clone()
    hint[..., -1] = 0
    return data | {"obs": data["obs"] | {"ocp_hint": hint}}


@pytest.mark.parametrize("rnn", [False, True])
@pytest.mark.parametrize(("hint", "keys"), [(True, ()), (False, ("ocp_hint",)), (False, ("ocp_hint", "ocp_plan"))])
def test_robomimics_script_trains_on_a_labelled_file(configuration, tmp_path, rnn, hint, keys):
    config = configuration(rnn, hint, keys)
    config.lock()
    script.train(config, torch.device("cpu"))
    (folder,) = (tmp_path / "robomimic" / "test").iterdir()
    names = {path.name for path in (folder / "models").iterdir()}
    assert names == {"model_epoch_1.pth", "model_epoch_2.pth"}
    first, last = (
        file_utils.load_dict_from_checkpoint(str(folder / "models" / f"model_epoch_{n}.pth"))["model"]["nets"]
        for n in (1, 2)
    )
    assert all(torch.isfinite(value).all() for value in last.values())
    assert all(not torch.equal(first[name], value) for name, value in last.items())
    assert any("hint_weights" in name for name in last) == hint
    inputs = next(v for n, v in last.items() if n.endswith(("rnn.nets.weight_ih_l0", "mlp._model.0.weight"))).shape[1]
    assert inputs == 23 + (13 if "ocp_hint" in keys else 0) + (6 * 9 if "ocp_plan" in keys else 0)


@pytest.mark.parametrize("rnn", [False, True])
def test_ocplanner_reads_the_configuration_that_robomimic_saves(configuration, labelled, tmp_path, rnn):
    config = configuration(rnn, hint=True)
    config.lock()
    script.train(config, torch.device("cpu"))
    (path,) = (tmp_path / "robomimic" / "test").glob("*/config.json")
    given = read_robomimic_config(path)
    assert given.data == labelled
    assert given.training.network.hint == HintConfig((1, 4))
    assert (given.training.steps, given.training.save_every) == (6, 3)
    policy = train_policy(given.training, labelled, tmp_path / "run")
    assert Policy.load(policy).observation_keys[-1] == "ocp_hint"


def test_a_trained_checkpoint_acts_within_bounds_through_robomimics_loader(configuration, labelled, tmp_path):
    config = configuration(rnn=True, hint=True)
    config.lock()
    script.train(config, torch.device("cpu"))
    (path,) = (tmp_path / "robomimic" / "test").glob("*/models/model_epoch_2.pth")
    policy, _ = file_utils.policy_from_checkpoint(ckpt_path=str(path), device=torch.device("cpu"))
    assert isinstance(policy.policy, integration.HintedBCRNN)
    policy.start_episode()
    with h5py.File(labelled) as file:
        seen = {key: file[f"data/demo_0/obs/{key}"][40] for key in (*SHAPES, "ocp_hint")}
    assert seen["ocp_hint"][-1] == 1
    seen["ocp_hint"] = np.concatenate([np.full(12, 9.0), [1.0]])
    action = policy(seen)
    assert action.shape == (7,)
    assert np.abs(action).max() == 1


def test_the_module_runs_robomimics_script_on_a_json_file(configuration, tmp_path):
    path = tmp_path / "config.json"
    path.write_text(json.dumps(configuration(hint=True)))
    command = [sys.executable, "-m", "ocplanner.integrations.robomimic", "train", "--config", str(path)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=tmp_path)
    assert "finished run successfully!" in done.stdout
    assert "HintedGMMActor" in done.stdout


def test_the_module_refuses_a_configuration_in_one_line_before_robomimic_begins(configuration, tmp_path):
    path = tmp_path / "config.json"
    config = configuration(hint=True)
    config["experiment"]["rollout"]["enabled"] = True
    path.write_text(json.dumps(config))
    command = [sys.executable, "-m", "ocplanner.integrations.robomimic", "train", "--config", str(path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1].startswith("error: robomimic's environments observe no 'ocp_hint'")
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("name", ["", "no_such_script", "os.path"])
def test_the_module_names_an_unknown_script(monkeypatch, name):
    monkeypatch.setattr(sys, "argv", ["robomimic", *([name] if name else [])])
    with pytest.raises(SystemExit, match=f"unknown robomimic script {name!r}"):
        main()


@pytest.mark.parametrize("off", [zeroed, switched_off])
@pytest.mark.parametrize("rnn", [False, True])
def test_without_a_hint_it_is_robomimics_algorithm_number_for_number(configuration, rnn, off):
    hinted, plain = algorithm(configuration(rnn, hint=True)), algorithm(configuration(rnn))
    assert type(plain).__module__ == "robomimic.algo.bc"
    data = off(batch())
    for step in range(3):
        losses = []
        for one in (hinted, plain):
            one.set_train()
            info = one.train_on_batch(one.process_batch_for_training(data), epoch=1)
            losses.append(info["losses"]["action_loss"])
        assert torch.equal(*losses), step
    weights = hinted.nets.state_dict()
    assert all(torch.equal(weights[name], value) for name, value in plain.nets.state_dict().items())
    more = set(weights) - set(plain.nets.state_dict())
    assert more
    assert all("hint_weights" in name for name in more)
    for one in (hinted, plain):
        one.set_eval()
        one.reset()
    for t in range(5):
        seen = {key: value[:, t] for key, value in data["obs"].items()}
        actions = []
        for one in (hinted, plain):
            torch.manual_seed(t)
            actions.append(one.get_action(seen))
        assert torch.equal(actions[0], actions[1].clamp(-1, 1))


@pytest.mark.parametrize("rnn", [False, True])
def test_the_means_are_those_of_ocplanners_own_head(configuration, rnn):
    hinted, plain = algorithm(configuration(rnn, hint=True)), algorithm(configuration(rnn))
    data = hinted.process_batch_for_training(batch())["obs"]
    features = []
    decoder = hinted.nets["policy"].nets["decoder"]
    decoder.register_forward_pre_hook(lambda _, inputs: features.append(inputs[0]))
    with torch.no_grad():
        ours = hinted.nets["policy"].forward_train(obs_dict=data)
        theirs = plain.nets["policy"].forward_train(obs_dict=data)
    own = HintWeights(features[0].shape[-1], 5, HintConfig((1, 4)))
    own.linear.load_state_dict(decoder.nets["hint_weights"].state_dict())
    residual = Mixture(
        theirs.mixture_distribution.logits,
        theirs.component_distribution.base_dist.loc,
        theirs.component_distribution.base_dist.scale,
    )
    expected = own(residual, features[0].reshape(*residual.logits.shape[:-1], -1), data["ocp_hint"])
    torch.testing.assert_close(ours.component_distribution.base_dist.loc, expected.means)
    assert torch.equal(ours.component_distribution.base_dist.scale, expected.stds)
    assert (ours.component_distribution.base_dist.loc - residual.means).abs().max() > 1


def test_configurations_without_the_section_and_of_other_algorithms_still_work(configuration):
    plain = configuration()
    with plain.unlocked():
        del plain.algo["ocp_hint"]
    assert type(algorithm(plain)).__name__ == "BC_GMM"
    actor = config_factory("hbc").algo.actor
    assert "ocp_hint" not in actor
    assert algo_name_to_factory_func("bc")(actor)[0].__name__ == "BC_RNN"


def refused(config, **changes):
    with config.values_unlocked():
        for key, value in changes.items():
            part = config
            *path, last = key.split("__")
            for name in path:
                part = part[name]
            part[last] = value
    return config


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"algo__gmm__enabled": False}, InvalidValueError, "set algo.gmm.enabled"),
        ({"algo__gaussian__enabled": True}, InvalidValueError, "switch algo.gaussian"),
        ({"algo__ocp_hint__horizons": [1]}, MismatchError, r"\(1, 4\) steps ahead.*give algo.ocp_hint.horizons 1 4"),
        ({"algo__ocp_hint__horizons": [0, 1]}, InvalidValueError, "at least 1 step"),
        ({"observation__modalities__obs__low_dim": ["object"]}, MismatchError, "needs 'ocp_hint' in observation"),
        ({"experiment__rollout__enabled": True}, MismatchError, "set experiment.rollout.enabled to false"),
        ({"train__hdf5_normalize_obs": True}, MismatchError, "hdf5_normalize_obs to false"),
        ({"train__action_config__actions__normalization": "min_max"}, MismatchError, "normalization of every"),
    ],
)
def test_what_the_hint_cannot_work_with_is_refused(configuration, changes, error, message):
    with pytest.raises(error, match=message):
        algorithm(refused(configuration(hint=True), **changes))


def test_another_robomimic_is_refused(monkeypatch):
    real = metadata.version
    monkeypatch.setattr(metadata, "version", lambda name: "0.4.0" if name == "praxis-robomimic" else real(name))
    monkeypatch.delitem(sys.modules, "ocplanner.integrations.robomimic")
    with pytest.raises(
        VersionError, match=r"praxis-robomimic 0\.4\.0 is installed.*pip install 'praxis-robomimic==0\.5\.0'"
    ):
        __import__("ocplanner.integrations.robomimic")


def test_robomimics_configuration_files_are_read(configuration, tmp_path):
    template = json.loads((Path(script.__file__).parents[1] / "exps" / "templates" / "bc.json").read_text())
    config = config_factory("bc")
    with config.values_unlocked():
        config.update(template | {"algo": template["algo"] | {"ocp_hint": {"enabled": True, "horizons": [1, 4]}}})
    assert config.algo.ocp_hint.to_dict() == {"enabled": True, "horizons": [1, 4], "initial_weight": 1.0}

import json
from dataclasses import replace

import pytest
import tyro
import yaml

from ocplanner import Policy
from ocplanner.cli import main
from ocplanner.cli.train_policy import TrainPolicy
from ocplanner.errors import InvalidValueError, MismatchError
from ocplanner.policies.config import HintConfig, preset
from ocplanner.policies.train import train_policy

GMM = {"gmm": {"enabled": True}}


def parsed(*flags: str) -> TrainPolicy:
    return tyro.cli(TrainPolicy, args=["--data", "d.hdf5", "--run", "r", *flags], default=TrainPolicy.defaults(flags))


@pytest.mark.parametrize("name", ["cpu", "robomimic"])
@pytest.mark.parametrize("algorithm", ["bc", "bc-rnn", "bcq"])
@pytest.mark.parametrize("kind", ["state", "image"])
def test_the_defaults_are_the_preset(name, algorithm, kind):
    flags = ("--preset", name, "--algorithm", algorithm, "--observations", kind)
    assert parsed(*flags).configuration() == preset(name, algorithm, kind)


def test_flags_reach_the_configuration():
    flags = "--hint --mask all --seed 3 --steps 7 --batch 4 --learning-rate 0.01 --ema 0 --threads 2 --hint-weight 2"
    config = parsed(*flags.split(), "--cameras", "agentview", "--low-dim", "a", "b", "--hidden", "8").configuration()
    assert config.network.hint == HintConfig(initial_weight=2)
    assert config.network.hidden == (8,)
    assert (config.mask, config.seed, config.steps, config.batch, config.threads) == (None, 3, 7, 4, 2)
    assert (config.learning_rate, config.ema) == (0.01, 0)
    assert (config.observation.cameras, config.observation.low_dim) == (("agentview",), ("a", "b"))


def test_the_kl_weight_is_bcqs():
    config = parsed("--algorithm", "bcq", "--kl-weight", "0.005").configuration()
    base = preset("cpu", "bcq")
    assert config == replace(base, algorithm_settings=replace(base.algorithm_settings, kl_weight=0.005))
    for flags, only in (
        ([], "--algorithm bcq alone"),
        (["--algorithm", "bcq", "--sampler", "gmm"], "--sampler vae alone"),
    ):
        with pytest.raises(InvalidValueError, match=f"--kl-weight.* for .*{only}"):
            parsed(*flags, "--kl-weight", "0.005").configuration()


def test_the_sampler_is_bcqs():
    config = parsed("--algorithm", "bcq", "--sampler", "gmm").configuration()
    base = preset("cpu", "bcq")
    assert config == replace(
        base, algorithm_settings=replace(base.algorithm_settings, sampler="gmm", rollout_proposals=10)
    )
    assert parsed("--algorithm", "bcq", "--sampler", "vae").configuration() == base
    with pytest.raises(InvalidValueError, match="--sampler: for --algorithm bcq alone"):
        parsed("--sampler", "gmm").configuration()


def test_a_trained_policy_brings_what_is_seen_and_the_networks(tiny_square, tmp_path):
    short = ["--cameras", "agentview", "--observations", "image", "--steps", "1", "--batch", "4"]
    trained = train_policy(parsed(*short).configuration(), tiny_square(images=True), tmp_path / "bc")
    above = ["--algorithm", "bcq", "--sampler-from", str(trained)]
    policy, base = Policy.load(trained), preset("cpu", "bcq", "image")
    config = parsed(*above, "--seed", "4").configuration()
    bcq = replace(base.algorithm_settings, sampler="policy", sampler_sha256=policy.sha256, rollout_proposals=10)
    assert config == replace(
        base,
        observation=policy.training.observation,
        network=policy.training.network,
        algorithm_settings=bcq,
        steps=10_000,
        batch=100,
        save_every=1000,
        seed=4,
    )
    published = parsed(*above, "--preset", "robomimic").configuration()
    assert (published.steps, published.batch, published.algorithm_settings.critic_learning_rate) == (300_000, 16, 1e-3)
    for flags in ("--sampler gmm", "--observations state"):
        with pytest.raises(InvalidValueError, match=f"{flags.split()[0]} and --sampler-from both decide"):
            parsed(*above, *flags.split()).configuration()
    with pytest.raises(InvalidValueError, match=r"--kl-weight is for .* --sampler vae alone"):
        parsed(*above, "--kl-weight", "1").configuration()
    for flags in ("--low-dim object", "--cameras a", "--hidden 3"):
        changed = parsed(*above, *flags.split()).configuration()
        with pytest.raises(MismatchError, match=r"what is seen and the networks are those of .*policy\.safetensors"):
            train_policy(changed, tiny_square(images=True), tmp_path / "above", sampler=trained)
    with pytest.raises(InvalidValueError, match="--sampler-from is for --algorithm bcq alone"):
        parsed("--sampler-from", str(trained)).configuration()


def test_a_robomimic_configuration_decides_and_flags_override(tmp_path):
    path = tmp_path / "config.json"
    path.write_text(json.dumps({"algo_name": "bc", "train": {"batch_size": 7, "seed": 4}, "algo": GMM}))
    config = parsed("--config", str(path)).configuration()
    assert (config.preset, config.batch, config.seed) == ("robomimic", 7, 4)
    assert (config.mask, config.network.hint) == (None, None)
    numbers = "--batch 5 --seed 2 --learning-rate 1 --hint --hint-steers"
    flags = [*numbers.split(), "--mask", "valid", "--device", "mps", "--low-dim", "a"]
    config = parsed("--config", str(path), *flags).configuration()
    assert (config.batch, config.seed, config.mask, config.device, config.learning_rate) == (5, 2, "valid", "mps", 1)
    assert (config.network.hint, config.observation.low_dim) == (HintConfig(steers=True), ("a",))


def test_the_hint_of_a_robomimic_configuration_is_read_without_a_flag(tmp_path):
    path = tmp_path / "config.json"
    path.write_text(json.dumps({"algo_name": "bc", "algo": GMM | {"ocp_hint": {"enabled": True, "horizons": [1, 4]}}}))
    assert parsed("--config", str(path)).configuration().network.hint == HintConfig((1, 4))
    assert parsed("--config", str(path), "--hint-weight=2").configuration().network.hint == HintConfig((1, 4), 2.0)


@pytest.mark.parametrize("flag", [("--preset", "cpu"), ("--algorithm", "bc-rnn"), ("--observations", "image")])
def test_what_decides_the_network_is_given_once(tmp_path, flag):
    (tmp_path / "config.json").write_text(json.dumps({"algo_name": "bc", "algo": GMM}))
    with pytest.raises(InvalidValueError, match=f"{flag[0]} and --config both decide the network"):
        parsed("--config", str(tmp_path / "config.json"), *flag).configuration()


def test_a_robomimic_configuration_trains_and_the_run_has_what_was_resolved(tiny_square, tmp_path, capsys):
    train = {"data": str(tiny_square()), "hdf5_filter_key": "train", "batch_size": 8, "num_epochs": 2, "cuda": False}
    experiment = {"epoch_every_n_steps": 2, "name": "x", "rollout": {"enabled": True}}
    values = {"algo_name": "bc", "algo": GMM | {"actor_layer_dims": [8]}, "train": train, "experiment": experiment}
    path, run = tmp_path / "config.json", tmp_path / "run"
    path.write_text(json.dumps(values))
    assert main(["train-policy", "--config", str(path), "--run", str(run), "--seed", "3"]) == 0
    out, error = capsys.readouterr()
    assert error.splitlines()[0] == f"{path}: without effect on the training: experiment.name, experiment.rollout"
    written = yaml.safe_load((run / "config.yaml").read_text())
    assert (written["batch"], written["steps"], written["seed"]) == (8, 4, 3)
    assert written["network"]["hidden"] == [8]
    assert Policy.load(out.strip()).training.seed == 3


def test_a_policy_is_trained_and_described(tiny_square, tmp_path, capsys):
    flags = ["--steps", "3", "--save-every", "2", "--batch", "8"]
    assert main(["train-policy", "--data", str(tiny_square()), "--run", str(tmp_path / "run"), *flags]) == 0
    path = capsys.readouterr().out.strip()
    assert Policy.load(path).header.task == "Square"
    assert main(["info", path, "--json"]) == 0
    assert '"kind": "policy"' in capsys.readouterr().out


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (["--data", "absent.hdf5"], "no such file"),
        (["--data", "absent.hdf5", "--steps", "0"], "at least 1"),
        (["--data", "absent.hdf5", "--algorithm", "bcq", "--hint"], "bcq reads no hint"),
        (
            ["--data", "absent.hdf5", "--hint-steers", "--hint-weight", "0.5"],
            "--hint-steers, --hint-weight: no hint is",
        ),
        (["--data", "a", "--hint", "--hint-instead-of-pictures"], "needs pictures: --observations image"),
        (
            ["--data", "a", "--hint", "--hint-instead-of-pictures", "--observations", "image"],
            "--low-dim robot0_eef_pos robot0_eef_quat robot0_gripper_qpos ocp_hint",
        ),
        (["--data", "a", "--hint", "--hint-steers", "--hint-residual-penalty", "1"], "no residual to penalise"),
        (["--data", "absent.hdf5", "--processes", "3"], "a batch of 100 cannot be shared evenly by 3 processes"),
        ([], "no data set is named; give --data"),
        (["--algorithm", "iql"], "unknown algorithm 'iql'; known: bc, bc-rnn, bcq"),
        (["--algorithm", "bcq", "--sampler", "policy"], "give --sampler-from"),
        (["--config", "absent.json"], "absent.json: cannot be read"),
        (["--data", "absent.hdf5", "--device", "abacus"], "device 'abacus' cannot be used"),
    ],
)
def test_user_errors_are_one_line(tmp_path, capsys, flags, message):
    assert main(["train-policy", "--run", str(tmp_path / "run"), *flags]) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert message in error
    assert "Traceback" not in error

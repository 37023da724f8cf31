import pytest
import tyro

from ocplanner import Policy
from ocplanner.cli import main
from ocplanner.cli.train_policy import TrainPolicy
from ocplanner.policies.config import HintConfig, preset


def parsed(*flags: str) -> TrainPolicy:
    return tyro.cli(TrainPolicy, args=["--data", "d.hdf5", "--run", "r", *flags])


@pytest.mark.parametrize("name", ["cpu", "robomimic"])
@pytest.mark.parametrize("algorithm", ["bc", "bc-rnn"])
@pytest.mark.parametrize("kind", ["state", "image"])
def test_the_defaults_are_the_preset(name, algorithm, kind):
    flags = ("--preset", name, "--algorithm", algorithm, "--observations", kind)
    assert parsed(*flags).configuration() == preset(name, algorithm, kind)


def test_flags_reach_the_configuration():
    flags = (
        "--hint --hint-horizons 1 5 --mask all --seed 3 --steps 7 --batch 4 --learning-rate 0.01 --ema 0 --threads 2"
    )
    config = parsed(*flags.split(), "--cameras", "agentview", "--low-dim", "a", "b").configuration()
    assert config.network.hint == HintConfig((1, 5))
    assert (config.mask, config.seed, config.steps, config.batch, config.threads) == (None, 3, 7, 4, 2)
    assert (config.learning_rate, config.ema) == (0.01, 0)
    assert (config.observation.cameras, config.observation.low_dim) == (("agentview",), ("a", "b"))


def test_a_policy_is_trained_and_described(tiny_square, tmp_path, capsys):
    flags = ["--steps", "3", "--save-every", "2", "--batch", "8"]
    assert main(["train-policy", "--data", str(tiny_square()), "--run", str(tmp_path / "run"), *flags]) == 0
    path = capsys.readouterr().out.strip()
    assert Policy.load(path).config["task"] == "Square"
    assert main(["info", path, "--json"]) == 0
    assert '"kind": "policy"' in capsys.readouterr().out


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (["--data", "absent.hdf5"], "no such file"),
        (["--data", "absent.hdf5", "--steps", "0"], "at least 1"),
        (["--data", "absent.hdf5", "--processes", "3"], "a batch of 100 cannot be shared evenly by 3 processes"),
        (["--data", "absent.hdf5", "--device", "abacus"], "device 'abacus' cannot be used"),
    ],
)
def test_user_errors_are_one_line(tmp_path, capsys, flags, message):
    assert main(["train-policy", "--run", str(tmp_path / "run"), *flags]) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert message in error
    assert "Traceback" not in error

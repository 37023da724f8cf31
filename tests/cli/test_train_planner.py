import pytest
import tyro

from ocplanner.cli import main
from ocplanner.cli.train_planner import TrainPlanner
from ocplanner.planner.config import PlannerTraining, preset


def parsed(*flags: str) -> PlannerTraining:
    return tyro.cli(
        TrainPlanner, args=["--data", "d.hdf5", "--run", "r", *flags], default=TrainPlanner.defaults(flags)
    ).training


def test_the_defaults_are_the_preset():
    assert parsed() == preset("cpu")
    assert parsed("--preset", "robomimic") == parsed("--preset=robomimic") == preset("robomimic")


def test_the_help_names_the_steps_of_both_presets(capsys):
    with pytest.raises(SystemExit):
        main(["train-planner", "--help"])
    said = " ".join(capsys.readouterr().out.replace("│", " ").split())
    for stage in ("vae", "predictor", "finetune"):
        steps = [getattr(preset(name), stage).steps for name in ("cpu", "robomimic")]
        assert f"Default: cpu {steps[0]}, robomimic {steps[1]}." in said
    assert f"(default: {preset('cpu').loss.kl})" in said


def test_flags_reach_the_configuration():
    flags = (
        "--horizon 50 --outputs position --observe no-robot --seed 2 --modes 3 --latent-loss kl --c-rot 2 --threads 2"
    )
    config = parsed(*flags.split(), "--predictor-steps", "7", "--cameras", "a", "b")
    assert (config.network.horizon, config.network.outputs, config.network.modes) == (50, "position", 3)
    assert (config.observe, config.seed, config.cameras, config.threads) == ("no-robot", 2, ("a", "b"), 2)
    assert (config.loss.latent, config.loss.rotation, config.loss.position) == ("kl", 2.0, 1.0)
    assert config.predictor.steps == 7
    assert config.vae == preset("cpu").vae


def test_the_encoder_can_be_chosen_apart_from_the_preset():
    assert parsed("--encoder", "resnet18").network.encoder == preset("robomimic").network.encoder
    assert parsed("--preset", "robomimic", "--encoder", "small").network.encoder.type == "small"
    chosen = parsed("--channels", "8", "16", "--pool", "spatial_softmax").network.encoder
    assert (chosen.channels, chosen.pool, chosen.type) == ((8, 16), "spatial_softmax", "small")


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (["--data", "absent.hdf5"], "no such file"),
        (["--data", "absent.hdf5", "--horizon", "0"], "horizon 0 must be at least 1"),
    ],
)
def test_user_errors_are_one_line(tmp_path, capsys, flags, message):
    assert main(["train-planner", "--run", str(tmp_path / "run"), *flags]) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert message in error
    assert "Traceback" not in error

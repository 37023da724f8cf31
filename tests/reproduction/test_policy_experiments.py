"""The experiments of the tables."""

from itertools import pairwise
from pathlib import Path

from ocplanner.reproduction import reproduction
from ocplanner.reproduction.policy_experiments import PolicyExperiment, data, run_all


def test_trainings_share_the_data_that_their_labels_make():
    source, work = Path("square.hdf5"), Path("work")

    def used(algorithm: str, observations: str, variant: str = "") -> str:
        return data(PolicyExperiment(algorithm, observations, variant), source, work).name

    assert used("bc", "image", "k10") == used("bc-rnn", "image", "k10s") == "square_policy_k10-object.hdf5"
    assert used("bc", "image", "k1") == "square_policy_k1-object.hdf5"
    assert used("bcq", "state", "only") == "square_state_only-penalty.hdf5"
    assert used("bcq", "state", "only-literal") == "square_state_only-literal.hdf5"
    assert (used("bc", "state"), used("bc", "image")) == ("square.hdf5", "square_policy.hdf5")


def test_critics_stand_above_a_policy_that_is_trained_first_and_once(monkeypatch, tmp_path):
    ran = []

    def run(arguments, log):
        options = dict(pairwise(arguments))
        ran.append((arguments[0], Path(options.get("--run") or options["--policy"]).name))
        if arguments[0] == "train-policy":
            assert ("--observations" in arguments) != ("--sampler-from" in arguments)
            if "--sampler-from" in arguments:
                assert Path(options["--sampler-from"]).exists()
            folder = Path(options["--run"])
            folder.mkdir(parents=True)
            (folder / "policy.safetensors").touch()
        else:
            assert options["--last"] == "2"
            Path(options["--out"]).parent.mkdir(exist_ok=True)
            Path(options["--out"]).touch()

    monkeypatch.setattr(reproduction, "run_command", run)
    wanted = [PolicyExperiment("bcq-bc", "image", variant, 1) for variant in ("", "only-exp")]
    for _ in range(2):
        assert list(run_all(wanted, Path("square.hdf5"), tmp_path / "work", tmp_path, 50, workers=1)) == wanted
    names = ["bcq-bc_image_original_1", "bcq-bc_image_only-exp_1"]
    trained = [("train-policy", name) for name in names]
    evaluated = [("evaluate", name) for name in names]
    assert ran == [("train-policy", "bc_image_original_1"), *(one for pair in zip(trained, evaluated) for one in pair)]

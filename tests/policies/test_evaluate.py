import json

import pytest

from ocplanner import evaluate_policy
from ocplanner.cli import main
from ocplanner.errors import InvalidValueError, MismatchError, ModelFileError, OutputError
from ocplanner.files.records.evaluation import EvaluationSettings
from ocplanner.policies import evaluate
from ocplanner.policies.train import train_policy
from ocplanner.rollouts.settings import WorkerSettings


@pytest.fixture(scope="module")
def run_folder(tiny_square, tmp_path_factory, small):
    folder = tmp_path_factory.mktemp("policies") / "run"
    train_policy(small(), tiny_square(), folder)
    return folder


def short(folder, out=None, last=None, **options):
    settings = EvaluationSettings(episodes=2, last=last, horizon=3, seed_start=30000)
    return evaluate_policy(folder, settings=settings, out=out, **options)


def test_every_checkpoint_meets_episodes_of_its_own(run_folder, tmp_path):
    result = short(run_folder, tmp_path / "out.json")
    assert [checkpoint.step for checkpoint in result.checkpoints] == [10, 20]
    assert [[run.seed for run in checkpoint.runs] for checkpoint in result.checkpoints] == [
        [30000, 30001],
        [30002, 30003],
    ]
    written = json.loads((tmp_path / "out.json").read_text())
    assert written["training"]["algorithm"] == "bc"
    assert written["best"] == 0
    assert written["checkpoints"][1]["runs"][0] == {
        "seed": 30002,
        "success": False,
        "steps": 3,
        "failure": "missed grasp",
    }
    assert written["settings"] == {"episodes": 2, "last": None, "seed_start": 30000, "horizon": 3, "visual": None}
    assert (written["format"], written["privileged"], written["last_five_checkpoints"]) == (2, ["object pose"], 2)
    assert [checkpoint.step for checkpoint in short(run_folder / "policies", last=1).checkpoints] == [20]
    assert not (tmp_path / "out.json.journal").exists()


def test_bcq_is_evaluated_as_the_others_are(tiny_square, tmp_path, small):
    folder = train_policy(small("bcq", steps=10), tiny_square(), tmp_path / "run").parent
    result = short(folder)
    assert (result.algorithm, [run.steps for run in result.checkpoints[0].runs]) == ("bcq", [3, 3])


def test_workers_change_nothing(run_folder):
    assert short(run_folder, workers=WorkerSettings(2)).checkpoints == short(run_folder).checkpoints


def test_a_stopped_evaluation_goes_on(run_folder, tmp_path, monkeypatch):
    whole, out = short(run_folder), tmp_path / "out.json"
    seen = []

    def stop(path, run):
        seen.append(run.seed)
        if len(seen) == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        short(run_folder, out, on_episode=stop)
    played = []
    play = evaluate.EvaluationWorker.play
    monkeypatch.setattr(evaluate.EvaluationWorker, "play", lambda self, seed: played.append(seed) or play(self, seed))
    assert short(run_folder, out).checkpoints == whole.checkpoints
    assert played == [30003]


def test_refuses_what_does_not_fit(run_folder, tiny_square, tmp_path):
    with pytest.raises(InvalidValueError, match="at least 1"):
        EvaluationSettings(episodes=0)
    with pytest.raises(ModelFileError, match=r"no policies/step_\*\.safetensors"):
        evaluate_policy(tmp_path)
    with pytest.raises(MismatchError, match="drop the planner"):
        evaluate_policy(run_folder, tmp_path / "planner.safetensors")
    with pytest.raises(InvalidValueError, match="is a single policy"):
        short(run_folder / "policy.safetensors", last=2)
    with pytest.raises(ModelFileError, match="it is an HDF5 file, perhaps a data set"):
        evaluate_policy(tiny_square())
    short(run_folder, tmp_path / "out.json")
    with pytest.raises(OutputError, match="--overwrite"):
        short(run_folder, tmp_path / "out.json")
    short(run_folder, tmp_path / "out.json", overwrite=True)


def test_the_command(run_folder, capsys):
    flags = ["--policy", str(run_folder), "--episodes", "1", "--horizon", "2", "--last", "1"]
    assert main(["evaluate", *flags]) == 0
    said = capsys.readouterr().out
    assert "step 20: 0/1 succeeded" in said
    assert (run_folder / "evaluation.json").exists()
    assert main(["evaluate", *flags]) == 2

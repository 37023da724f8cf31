"""The search for the smallest encoder, with runs that are made up but complete."""

import json
import shutil
from pathlib import Path

import pytest
import tyro
from tests.random_planner import write_random_planner

from ocplanner.cli.train_planner import TrainPlanner
from ocplanner.errors import ResultFileError
from ocplanner.reproduction import encoders, reproduction
from ocplanner.reproduction.summary import NOTHING, encoder_table

EXPERIMENTS = encoders.encoder_experiments((0, 1))


def test_each_has_a_name_of_its_own_and_flags_that_say_what_it_is():
    assert len({experiment.name for experiment in EXPERIMENTS}) == len(EXPERIMENTS)
    for experiment in EXPERIMENTS:
        flags = ["--data", "d", "--run", "r", *experiment.flags]
        config = tyro.cli(TrainPlanner, args=flags, default=TrainPlanner.defaults(flags)).training
        assert (config.network.encoder.type, config.network.encoder.pool) == (experiment.encoder, experiment.pool)
        assert experiment.encoder == "resnet18" or config.network.encoder.channels == experiment.channels
        assert (config.predictor.steps, config.finetune.steps) == (
            experiment.predictor_steps,
            experiment.finetune_steps,
        )


@pytest.fixture
def trained(tmp_path, monkeypatch):
    planner = tmp_path / "planner.safetensors"
    write_random_planner(planner)

    def run(arguments: list[str], log: Path) -> None:
        folder = Path(arguments[arguments.index("--run") + 1])
        folder.mkdir(parents=True)
        shutil.copyfile(planner, folder / "planner.safetensors")
        rows = [
            {
                "stage": "final",
                "kept": kept,
                "appearance": appearance,
                "ade_mm": ade,
                "fde_mm": 2.0,
                "rotation_deg": 3.0,
            }
            for kept, appearance, ade in ((False, "source", 9.0), (True, "source", 1.0), (True, "IIWA", 8.0))
        ]
        (folder / "metrics.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))

    monkeypatch.setattr(reproduction, "run_command", run)
    return tmp_path / "work"


def test_the_rows_hold_the_kept_stage_on_the_recorded_robot(trained, tmp_path):
    done = list(encoders.train_encoders(EXPERIMENTS[:2], trained, workers=1))
    assert done == list(EXPERIMENTS[:2])
    encoders.write(EXPERIMENTS, trained, tmp_path, "the command")
    content = json.loads((tmp_path / encoders.NAME).read_text())
    assert [row["name"] for row in content["rows"]] == [experiment.name for experiment in done]
    assert all(row["ade_mm"] == 1.0 and row["plan_ms"] > 0 for row in content["rows"])
    table = encoder_table(tmp_path).splitlines()
    assert len(table) == 2 + 2
    assert "| ResNet18 | spatial softmax | 2000 | 0 |" in table[2]


def test_finished_runs_are_not_trained_again(trained, monkeypatch):
    list(encoders.train_encoders(EXPERIMENTS[:1], trained, workers=1))
    monkeypatch.setattr(reproduction, "run_command", lambda arguments, log: pytest.fail("trained again"))
    list(encoders.train_encoders(EXPERIMENTS[:1], trained, workers=1))


def test_no_file_says_so_and_a_damaged_one_is_named(tmp_path):
    assert encoder_table(tmp_path) == NOTHING
    (tmp_path / encoders.NAME).write_text('{"rows": [{}]}')
    with pytest.raises(ResultFileError, match=encoders.NAME):
        encoder_table(tmp_path)

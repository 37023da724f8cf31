"""``ocplanner transfer`` with a planner of random weights."""

from pathlib import Path

import pytest

from ocplanner.cli import main
from ocplanner.cli.transfer import Transfer
from ocplanner.control.settings import ControlSettings
from ocplanner.rollouts.settings import WorkerSettings
from ocplanner.zero_shot.result import read_result
from ocplanner.zero_shot.settings import TransferConfig
from random_planner import write_random_planner


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_random_planner(tmp_path / "p.safetensors")
    return tmp_path


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        ("--planner p.safetensors --robot Nobody", "unknown robot 'Nobody'; known:"),
        ("--planner absent.safetensors", "absent.safetensors"),
        ("--planner", "name its file with --planner"),
        ("--planner p.safetensors --pose-noise -5 0", "position is -5"),
        ("--planner p.safetensors --pose-latency -1", "-1 steps"),
        ("--planner p.safetensors --workers 0", "workers is 0"),
    ],
)
def test_what_is_wrong_is_one_line(folder, capsys, flags, message):
    assert main(["transfer", *flags.split()]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


@pytest.mark.parametrize("flags", ["--task Square", "--observe masked", "--matrix", "--pose-noise 5,2"])
def test_flags_of_no_choice_are_gone(folder, capsys, flags):
    with pytest.raises(SystemExit):
        main(["transfer", "--planner", "p.safetensors", *flags.split()])


def test_every_condition_is_a_flag(monkeypatch):
    seen = []
    monkeypatch.setattr(Transfer, "run", lambda transfer: seen.append(transfer))
    flags = "--follow time --visual stock --allow-mismatch --no-patches --control stock --mask-error 2"
    flags += " --pose-noise 5 2.5 --pose-latency 3 --pose-filter 8 --workers 2 --ray local"
    assert main(["transfer", "--planner", "p.safetensors", *flags.split()]) == 0
    config = TransferConfig(
        control=ControlSettings(follow="time"),
        visual="stock",
        allow_mismatch=True,
        patches=False,
        control_loop="stock",
        mask_error=2,
        pose_noise=(5.0, 2.5),
        pose_latency=3,
        pose_filter=8,
    )
    assert seen == [Transfer((Path("p.safetensors"),), config=config, workers=WorkerSettings(2, "local"))]


def test_the_result_file_is_named_by_what_was_run(folder, capsys):
    command = ["transfer", "--planner", "p.safetensors", "--robot", "Panda", "--episodes", "1", "--no-patches"]
    assert main([*command, "--seed-start", "500"]) == 0
    printed = capsys.readouterr().out
    assert "Square on Panda (gated, masked, no patches): 0/1" in printed
    path = folder / "results" / "transfer" / "square_panda_gated_masked_unpatched_0.json"
    assert [run.seed for run in read_result(path).runs] == [500]
    assert read_result(path).planners == ("p.safetensors",)

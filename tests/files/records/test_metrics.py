"""Run folders are read and written in one place: what training writes comes back, and damage is named."""

import json
from pathlib import Path

import pytest

from ocplanner.errors import ResultFileError
from ocplanner.files.records.metrics import (
    HeldOutErrors,
    RunConfig,
    StepMetrics,
    append_metrics,
    read_config,
    read_metrics,
    write_config,
    write_metrics,
)

PLANNER = StepMetrics("predictor", 200, {"seconds": 7.1, "loss": 0.5, "valid_loss": 0.6, "ade_mm": 30.0})
POLICY = StepMetrics("train", 60, {"seconds": 1.4, "loss": -0.5, "learning_rate": 1e-4, "steps_per_second": 43.6})
FINAL = HeldOutErrors({"ade_mm": 35.5}, "finetune", kept=True, appearance="IIWA")


def test_rows_come_back(tmp_path):
    path = tmp_path / "metrics.jsonl"
    for row in (PLANNER, POLICY, FINAL):
        append_metrics(path, row)
    assert read_metrics(path) == [PLANNER, POLICY, FINAL]
    write_metrics(path, [PLANNER])
    assert read_metrics(path) == [PLANNER]


def test_the_lines_are_those_of_todays_format(tmp_path):
    """Run folders of the first published version have these lines; both ways must stay."""
    lines = [
        '{"stage": "vae", "step": 200, "seconds": 7.1, "loss": 26.66, "valid_loss": 9.25, "frames": 66.0}',
        '{"stage": "final", "candidate": "finetune", "kept": true, "appearance": "IIWA", "ade_mm": 35.5}',
        '{"stage": "train", "step": 60, "seconds": 1.4, "loss": 0.6, "kl": 0.05, "steps_per_second": 43.6}',
    ]
    path = tmp_path / "metrics.jsonl"
    path.write_text("".join(line + "\n" for line in lines))
    rows = read_metrics(path)
    assert rows[1] == FINAL
    assert [json.dumps(row.to_json()) for row in rows] == lines


def test_a_last_line_cut_by_a_kill_is_left_out(tmp_path):
    path = tmp_path / "metrics.jsonl"
    append_metrics(path, PLANNER)
    with path.open("a") as file:
        file.write('{"step": 300, "sta')
    assert read_metrics(path) == [PLANNER]


@pytest.mark.parametrize("line", ['{"step": 1}', '{"stage": "vae"}', '{"stage": "vae", "step": "x"}', "[]", "3", "no"])
def test_another_damaged_line_is_an_error_that_names_it(tmp_path, line):
    path = tmp_path / "metrics.jsonl"
    path.write_text("\n".join([json.dumps(PLANNER.to_json()), line, json.dumps(POLICY.to_json())]))
    with pytest.raises(ResultFileError, match=r"line 2 of .*metrics\.jsonl is damaged"):
        read_metrics(path)


def test_a_missing_file_is_an_error(tmp_path):
    with pytest.raises(ResultFileError, match=r"cannot read .*metrics\.jsonl"):
        read_metrics(tmp_path / "metrics.jsonl")


@pytest.mark.parametrize(
    "config",
    [RunConfig({"seed": 0, "network": {"horizon": 20}}, {"train": "ab", "valid": "cd"}), RunConfig({"seed": 1}, "360")],
)
def test_a_configuration_comes_back(tmp_path, config):
    write_config(tmp_path / "config.yaml", config)
    assert read_config(tmp_path / "config.yaml") == config


@pytest.mark.parametrize("content", [b"", b"\xff\xfe", b"- 1\n- 2\n", b"a: [1", b"word"])
def test_a_damaged_configuration_is_named(tmp_path: Path, content):
    (tmp_path / "config.yaml").write_bytes(content)
    with pytest.raises(ResultFileError, match=r"config\.yaml is damaged"):
        read_config(tmp_path / "config.yaml")

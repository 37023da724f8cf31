import subprocess
import sys

import pytest

from ocplanner import cli


def test_a_closed_output_is_no_fault():
    process = subprocess.Popen(
        [sys.executable, "-m", "ocplanner", "--help"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    process.stdout.close()
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 141
    assert errors == ""


def test_another_broken_pipe_is_a_fault(monkeypatch):
    def broken(*_arguments, **_options):
        raise BrokenPipeError("a worker's")

    monkeypatch.setattr(cli.tyro, "cli", broken)
    with pytest.raises(BrokenPipeError, match="a worker's"):
        cli.main(["doctor"])


def test_settings_outside_their_domain_are_one_line(capsys):
    assert cli.main(["transfer", "--planner", "p.safetensors", "--workers", "0"]) == 2
    assert capsys.readouterr().err == "error: workers is 0, but must be at least 1\n"


def test_arguments_that_cannot_be_parsed_are_told_by_the_parser(capsys):
    with pytest.raises(SystemExit, match="2"):
        cli.main(["transfer", "--planner", "p.safetensors", "--workers", "many"])
    assert "--workers" in capsys.readouterr().err

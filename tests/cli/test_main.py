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

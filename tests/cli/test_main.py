import subprocess
import sys
from dataclasses import dataclass

import pytest

from ocplanner import cli
from ocplanner.errors import MismatchError, OcplannerError
from ocplanner.rollouts.worker import worker_error


def worker_fails() -> OcplannerError:
    try:
        raise ZeroDivisionError("a mistake")
    except ZeroDivisionError as error:
        return worker_error("the episode of seed 4", error)


ERRORS = {"user": MismatchError("no"), "worker": worker_fails(), "unexpected": KeyError("a mistake")}


@dataclass(frozen=True)
class Fails:
    """Fail."""

    how: str

    def run(self) -> None:
        raise ERRORS[self.how]


@pytest.fixture
def _fails(monkeypatch):
    monkeypatch.setattr(cli, "_commands", lambda: {"fails": Fails, "again": Fails})


@pytest.mark.usefixtures("_fails")
@pytest.mark.parametrize(
    ("how", "status", "line"),
    [
        ("user", 2, "error: no"),
        ("worker", 2, "error: the episode of seed 4 failed: ZeroDivisionError: a mistake"),
        ("unexpected", 1, "error: unexpected KeyError: 'a mistake'"),
    ],
)
def test_an_error_is_one_line_and_its_traceback_is_for_debug(capsys, how, status, line):
    assert cli.main(["fails", "--how", how]) == status
    said = capsys.readouterr().err
    remedy = [] if how == "user" else ["run 'ocplanner --debug VERB ...' with the same arguments to see the traceback"]
    assert said.splitlines() == [line, *remedy]
    assert cli.main(["--debug", "fails", "--how", how]) == status
    said = capsys.readouterr().err
    assert said.startswith("Traceback (most recent call last):")
    assert "raise ERRORS" in said
    assert (how == "worker") == ("in worker_fails" in said)
    assert said.splitlines()[-1] == line


def test_a_closed_output_is_no_fault():
    process = subprocess.Popen(
        [sys.executable, "-m", "ocplanner", "--help"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    process.stdout.close()
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 141
    assert errors == ""


def test_settings_outside_their_domain_are_one_line(capsys):
    assert cli.main(["transfer", "--planner", "p.safetensors", "--workers", "0"]) == 2
    assert capsys.readouterr().err == "error: workers is 0, but must be at least 1\n"


def test_arguments_that_cannot_be_parsed_are_told_by_the_parser(capsys):
    with pytest.raises(SystemExit, match="2"):
        cli.main(["transfer", "--planner", "p.safetensors", "--workers", "many"])
    assert "--workers" in capsys.readouterr().err


@pytest.mark.usefixtures("_fails")
def test_another_broken_pipe_is_a_fault(monkeypatch, capfd):
    monkeypatch.setitem(ERRORS, "pipe", BrokenPipeError("a worker's"))
    assert cli.main(["fails", "--how", "pipe"]) == 1
    assert "unexpected BrokenPipeError: a worker's" in capfd.readouterr().err

import hashlib
import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

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


@dataclass(frozen=True)
class Computes:
    """Compute for minutes where no signal is heard: in compiled code."""

    def run(self) -> None:
        sys.stderr.write("computing\n")
        hashlib.pbkdf2_hmac("sha256", b"", b"", 10**9)


DEAF = """
import signal, sys
sys.path.insert(0, sys.argv[1])
from test_main import Computes, cli
signal.signal(signal.SIGINT, signal.default_int_handler)
cli._commands = lambda: {"computes": Computes, "again": Computes}
sys.exit(cli.main(["computes"]))
"""


def test_ctrl_c_ends_what_does_not_hear_it():
    command = [sys.executable, "-c", DEAF, str(Path(__file__).parent)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        while process.stderr.readline() != "computing\n":
            pass
        time.sleep(0.5)
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=30)
    assert process.returncode == 130
    assert errors == "interrupted; run the same command again to resume\n"


def test_too_little_memory_is_told(capsys, monkeypatch):
    monkeypatch.setattr(cli, "_commands", lambda: {"fails": Fails, "again": Fails})
    monkeypatch.setitem(ERRORS, "memory", MemoryError("Unable to allocate 74.5 GiB"))
    assert cli.main(["fails", "--how", "memory"]) == 2
    assert capsys.readouterr().err == (
        "error: not enough memory (Unable to allocate 74.5 GiB); use fewer workers, a smaller batch or a smaller data "
        "set\n"
    )


@pytest.mark.parametrize(("given", "used"), [({}, "PASSIVE"), ({"OMP_WAIT_POLICY": "ACTIVE"}, "ACTIVE")])
def test_threads_do_not_spin_unless_asked_to(given, used):
    code = (
        "from contextlib import suppress\nfrom ocplanner import cli\nwith suppress(SystemExit): cli.main(['--help'])\n"
    )
    kept = {name: value for name, value in os.environ.items() if name != "OMP_WAIT_POLICY"}
    command = [sys.executable, "-c", f"{code}import torch"]
    environment = {**kept, "OMP_DISPLAY_ENV": "TRUE", **given}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=100, check=True)
    assert f"OMP_WAIT_POLICY = '{used}'" in done.stderr

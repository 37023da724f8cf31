"""A verb of the command line as a process of its own, forked from one that has imported what it needs.

Importing takes seconds, a verb on tiny data less: so hundreds of processes can be started and killed in minutes. The
importing process must never draw, train or start a thread.
"""

import atexit
import importlib
import os
import pkgutil
import resource
import signal
import sys
import time
import traceback
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NoReturn

_PATIENCE_S = 180.0
_POLL_S = 0.001
CHECKPOINT_EVERY = {"train-planner": 8, "train-policy": 20}
"""Training steps; on the command line checkpoints come every 500 and 1000, which tiny trainings never reach."""


def load(modules: Iterable[str]) -> None:
    """Import the command line and further modules, and let trainings write checkpoints often."""
    os.environ.setdefault("MUJOCO_GL", "egl")
    os.environ.setdefault("LP_NUM_THREADS", "1")
    command_line = importlib.import_module("ocplanner.cli")
    verbs = (module.name for module in pkgutil.iter_modules(command_line.__path__, "ocplanner.cli."))
    for module in (*verbs, *modules):
        importlib.import_module(module)
    _write_checkpoints_often()


def _write_checkpoints_often() -> None:
    from ocplanner.cli import train_planner, train_policy

    planner, policy = train_planner.preset, train_policy.preset
    every = CHECKPOINT_EVERY["train-planner"]
    train_planner.preset = lambda *names: replace(planner(*names), checkpoint_every=every, validate_every=every)
    often = CHECKPOINT_EVERY["train-policy"]
    train_policy.preset = lambda *names: replace(policy(*names), checkpoint_every=often, validate_every=2 * often)


@dataclass(frozen=True)
class Ending:
    """How a process ended."""

    code: int
    """Exit code; minus the signal that killed it."""
    text: str
    """What it printed."""
    memory_mb: float
    """The most memory it had."""

    @property
    def clear(self) -> bool:
        """Whether it said in one line what is wrong and ended with status 2."""
        return self.code == 2 and "error: " in self.text and "Traceback" not in self.text

    @property
    def complaint(self) -> str:
        """The exit code and the last line."""
        lines = [line for line in self.text.splitlines() if line.strip()]
        return f"exit {self.code}: {lines[-1] if lines else 'nothing said'}"


class VerbProcess:
    """A running verb, leader of its own process group.

    Args:
        arguments: the verb and its flags.
        log: where its output goes.
        largest_file: bytes beyond which the system refuses to let a file of it grow.
    """

    def __init__(self, arguments: list[str], log: Path, largest_file: int | None = None) -> None:
        self._log = log
        self._ending: Ending | None = None
        sys.stdout.flush()
        sys.stderr.flush()
        self.pid = os.fork()
        if self.pid == 0:
            _run_verb(arguments, log, largest_file)

    def poll(self) -> Ending | None:
        """How it ended, None while it runs."""
        if self._ending is None:
            pid, status, usage = os.wait4(self.pid, os.WNOHANG)
            if pid:
                text = self._log.read_text(encoding="utf-8", errors="replace")
                self._ending = Ending(os.waitstatus_to_exitcode(status), text, usage.ru_maxrss / 1024)
        return self._ending

    def wait(self, seconds: float = _PATIENCE_S) -> Ending:
        """Wait for its end; one that takes too long is killed."""
        deadline = time.monotonic() + seconds
        while (ending := self.poll()) is None:
            if time.monotonic() > deadline:
                self.kill()
            time.sleep(_POLL_S)
        return ending

    def kill(self) -> bool:
        """Kill -9 the whole group; False when it had ended by itself."""
        if self.poll() is not None:
            return False
        os.killpg(self.pid, signal.SIGKILL)
        return self.wait().code == -signal.SIGKILL


def _run_verb(arguments: list[str], log: Path, largest_file: int | None) -> NoReturn:
    code = 1
    try:
        os.setsid()
        descriptor = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
        os.dup2(descriptor, 1)
        os.dup2(descriptor, 2)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        if largest_file is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (largest_file, largest_file))
        sys.argv = ["ocplanner", *arguments]
        from ocplanner.cli import main

        code = main(arguments)
    except SystemExit as stop:
        code = stop.code if isinstance(stop.code, int) else 1
    except BaseException:
        traceback.print_exc()
    finally:
        atexit._run_exitfuncs()
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)

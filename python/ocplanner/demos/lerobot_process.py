"""lerobot, run by a Python of its own.

lerobot cannot be installed beside robosuite 1.5.2: the one needs NumPy 2, the other, through mink, an older NumPy. A
program that the Python of lerobot's own environment runs therefore reads and writes for us
(:mod:`ocplanner.integrations.lerobot`). That works with the lerobot that a user trains with, whichever it is.
"""

import contextlib
import importlib.util
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import IO, Any, Self, cast

import ocplanner
from ocplanner.errors import OcplannerError, VersionError

_INSTALL = (
    "make an environment for it, since it cannot be installed beside robosuite (python3.12 -m venv lerobot; "
    "lerobot/bin/pip install 'lerobot[dataset]'), and name its Python: --lerobot-python lerobot/bin/python"
)


class LeRobotProcess:
    """lerobot, run by a Python that has it; a context manager.

    Args:
        python: that Python; this one if None.
        failure: what an error of lerobot's is raised as.
        what: what is read or written, for the error.
        remedy: of the error.

    Raises:
        VersionError: there is no lerobot.
    """

    def __init__(self, python: Path | None, failure: type[OcplannerError], what: Path, remedy: str) -> None:
        if python is None and importlib.util.find_spec("lerobot") is None:
            raise VersionError(f"LeRobot data sets need lerobot 0.4 or later; {_INSTALL}")
        self._python, self._failure, self._what, self._remedy = Path(python or sys.executable), failure, what, remedy
        script = Path(ocplanner.__file__).parent / "integrations" / "lerobot.py"
        environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
        environment["HF_HUB_OFFLINE"] = "1"  # a damaged data set would be looked for on the Hub
        self._log = tempfile.TemporaryFile()  # noqa: SIM115 - closed when the process has ended
        try:
            self._process = subprocess.Popen(
                [self._python, script],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._log,
                env=environment,
                text=True,
            )
        except OSError as error:
            self._log.close()
            raise VersionError(f"cannot run {python} ({error.strerror}); {_INSTALL}") from error
        self._requests, self._answers = cast(IO[str], self._process.stdin), cast(IO[str], self._process.stdout)

    def ask(self, do: str, **arguments: Any) -> dict[str, Any]:
        """Have something done.

        Raises:
            VersionError: there is no lerobot.
            OcplannerError: lerobot failed.
        """
        with contextlib.suppress(BrokenPipeError):
            self._requests.write(json.dumps({"do": do, **arguments}) + "\n")
            self._requests.flush()
        line = self._answers.readline()
        if not line:
            raise self._failure(f"{self._what}: lerobot ended unexpectedly ({self._last_words()}); {self._remedy}")
        answer = json.loads(line)
        if "error" not in answer:
            return answer
        if answer["error"].startswith(("ImportError", "ModuleNotFoundError")):
            raise VersionError(f"{self._python} has no lerobot that works ({answer['error']}); {_INSTALL}")
        raise self._failure(f"{self._what}: lerobot failed ({answer['error']}); {self._remedy}")

    def __enter__(self) -> Self:
        """The process runs since it was made."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the process."""
        with contextlib.suppress(OSError):
            self._requests.close()
        try:
            self._process.wait(timeout=10)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._answers.close()
        self._log.close()

    def _last_words(self) -> str:
        self._process.wait()
        self._log.seek(0)
        lines = self._log.read().decode(errors="replace").strip().splitlines()
        return lines[-1] if lines else f"status {self._process.returncode}"

"""The command line: ``ocplanner VERB``, one module for each verb.

A verb's module binds the name ``COMMAND`` to a frozen dataclass whose fields are the flags and whose method ``run()``
does the work. Where defaults depend on other flags, as on ``--preset``, its classmethod ``defaults`` reads those flags
and returns an instance with the defaults.
"""

import contextlib
import importlib
import io
import multiprocessing
import os
import pkgutil
import select
import signal
import sys
import threading
import traceback
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any

import tyro

from ocplanner.errors import OcplannerError, WorkerError

_INTERRUPTED = "interrupted; run the same command again to resume\n"
_PATIENCE_S = 3.0
"""How long compiled code may go on after a Ctrl-C."""


def _commands() -> dict[str, Any]:
    names = sorted(module.name for module in pkgutil.iter_modules(__path__))
    return {name.replace("_", "-"): importlib.import_module(f"{__name__}.{name}").COMMAND for name in names}


def _parse(arguments: list[str] | None) -> Any:
    """The command line as an object with the chosen ``command`` and ``debug``.

    Raises:
        OcplannerError: a value is outside its domain; tyro would print it in a frame instead.
        SystemExit: the arguments cannot be parsed, or ask for help.
    """
    arguments = sys.argv[1:] if arguments is None else arguments
    union: Any = None
    for verb, command in _commands().items():
        depends = hasattr(command, "defaults") and verb in arguments[:2]  # --debug may precede it
        default = {"default": command.defaults(arguments)} if depends else {}
        member = Annotated[command, tyro.conf.subcommand(name=verb, **default)]
        union = member if union is None else union | member

    @dataclass(frozen=True)
    class Ocplanner:
        command: Annotated[union, tyro.conf.arg(name="")]  # pyright: ignore[reportInvalidTypeForm]
        """What to do."""
        debug: tyro.conf.FlagCreatePairsOff[bool] = False
        """Print the traceback of an error; must precede the verb."""

    config, framed = (tyro.conf.OmitSubcommandPrefixes,), io.StringIO()
    try:
        with contextlib.redirect_stderr(framed):
            return tyro.cli(Ocplanner, prog="ocplanner", description="", args=arguments, config=config)
    except SystemExit as ended:
        error: BaseException | None = ended
        while error is not None and not isinstance(error, OcplannerError):
            error = error.__context__
        if error is not None:
            raise error from None
        sys.stderr.write(framed.getvalue())
        raise


def main(arguments: list[str] | None = None) -> int:
    """Run one verb and return the exit status.

    An error becomes one line on standard error. The status is 2 for a user's error, 1 for an unexpected exception.
    """
    debug = False
    # OpenMP reads this when torch loads. Threads that wait by spinning starve each other where other processes compute.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    try:
        parsed = _parse(arguments)
        debug = parsed.debug
        with _prompt_interrupts():
            parsed.command.run()
        sys.stdout.flush()
    except KeyboardInterrupt:
        sys.stderr.write(_INTERRUPTED)
        return 130
    except Exception as error:
        if isinstance(error, BrokenPipeError) and _output_is_closed():
            return 141
        return _report(error, debug=debug)
    return 0


@contextlib.contextmanager
def _prompt_interrupts() -> Iterator[None]:
    """End the process if Ctrl-C is not heard for seconds, because compiled code computes on.

    Nothing is lost that a later Ctrl-C would keep: files appear whole, and locks end with the process.
    """
    if signal.getsignal(signal.SIGINT) is not signal.default_int_handler or not _is_main_thread():
        yield  # ignored, as in a shell's background job, or handled by a program that calls us
        return
    heard, over, (reading, writing) = threading.Event(), False, os.pipe()
    os.set_blocking(writing, False)

    def hear(*_: object) -> None:
        heard.set()
        raise KeyboardInterrupt

    def watch() -> None:
        while received := os.read(reading, 1):
            if received[0] == signal.SIGINT and not heard.wait(_PATIENCE_S) and not over:
                for child in multiprocessing.active_children():
                    child.kill()
                os.write(2, _INTERRUPTED.encode())
                os._exit(130)
            heard.clear()

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    signal.signal(signal.SIGINT, hear)
    before = signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    try:
        yield
    finally:
        over = True
        heard.set()
        signal.set_wakeup_fd(before)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        os.close(writing)
        watcher.join()
        os.close(reading)


def _is_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()


def _report(error: Exception, *, debug: bool) -> int:
    """Print an error and return the exit status."""
    if isinstance(error, MemoryError):
        error = WorkerError(f"not enough memory ({error}); use fewer workers, a smaller batch or a smaller data set")
    expected = isinstance(error, OcplannerError)
    if debug:
        traceback.print_exception(error)
    sys.stderr.write(f"error: {error}\n" if expected else f"error: unexpected {type(error).__name__}: {error}\n")
    if not debug and (not expected or hasattr(error, "__notes__")):
        sys.stderr.write("run 'ocplanner --debug VERB ...' with the same arguments to see the traceback\n")
    return 2 if expected else 1


def _output_is_closed() -> bool:
    """Whether nobody reads our output any more (``| head``); if so, the rest of it is discarded."""
    poll = select.poll()
    poll.register(sys.stdout, 0)
    closed = any(event & select.POLLERR for _, event in poll.poll(0))
    if closed:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return closed

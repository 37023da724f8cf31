"""The command line: ``ocplanner VERB``, one module for each verb.

A verb's module binds the name ``COMMAND`` to a frozen dataclass whose fields are the flags and whose method ``run()``
does the work. Where defaults depend on other flags, as on ``--preset``, its classmethod ``defaults`` reads those flags
and returns an instance with the defaults.
"""

import contextlib
import importlib
import io
import os
import pkgutil
import select
import sys
import traceback
from dataclasses import dataclass
from typing import Annotated, Any

import tyro

from ocplanner.errors import OcplannerError


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
    try:
        parsed = _parse(arguments)
        debug = parsed.debug
        parsed.command.run()
        sys.stdout.flush()
    except KeyboardInterrupt:
        sys.stderr.write("interrupted; run the same command again to resume\n")
        return 130
    except Exception as error:
        if isinstance(error, BrokenPipeError) and _output_is_closed():
            return 141
        return _report(error, debug=debug)
    return 0


def _report(error: Exception, *, debug: bool) -> int:
    """Print an error and return the exit status."""
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

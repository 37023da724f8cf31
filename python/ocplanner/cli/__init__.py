"""The command line: ``ocplanner VERB``, one module a verb.

A verb module holds a frozen dataclass whose fields are the flags, with a method ``run()``, bound to the name
``COMMAND``.
"""

import contextlib
import importlib
import io
import os
import pkgutil
import select
import sys
from typing import Annotated, Any

import tyro

from ocplanner.errors import OcplannerError


def _commands() -> dict[str, Any]:
    names = sorted(module.name for module in pkgutil.iter_modules(__path__))
    return {name.replace("_", "-"): importlib.import_module(f"{__name__}.{name}").COMMAND for name in names}


def main(arguments: list[str] | None = None) -> int:
    """Run one verb; a user's error is one line on stderr and exit status 2."""
    commands = _commands()
    union: Any = None
    for verb, command in commands.items():
        member = Annotated[command, tyro.conf.subcommand(name=verb)]
        union = member if union is None else union | member
    try:
        _parsed(union, arguments).run()
        sys.stdout.flush()
    except OcplannerError as error:
        sys.stderr.write(f"error: {error}\n")
        return 2
    except KeyboardInterrupt:
        sys.stderr.write("interrupted; run the same command again to resume\n")
        return 130
    except BrokenPipeError:
        if not _output_is_closed():
            raise
        return 141
    return 0


def _parsed(union: Any, arguments: list[str] | None) -> Any:
    """The verb that the arguments choose.

    Raises:
        OcplannerError: a value is outside its domain; tyro would frame the message instead.
        SystemExit: the arguments cannot be parsed, or ask for help.
    """
    framed = io.StringIO()
    try:
        with contextlib.redirect_stderr(framed):
            return tyro.cli(union, prog="ocplanner", args=arguments, config=(tyro.conf.OmitSubcommandPrefixes,))
    except SystemExit as ended:
        error: BaseException | None = ended
        while error is not None and not isinstance(error, OcplannerError):
            error = error.__context__
        if error is not None:
            raise error from None
        sys.stderr.write(framed.getvalue())
        raise


def _output_is_closed() -> bool:
    """Whether nobody reads our output any more (``| head``); then the rest of it goes nowhere."""
    poll = select.poll()
    poll.register(sys.stdout, 0)
    closed = any(event & select.POLLERR for _, event in poll.poll(0))
    if closed:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return closed

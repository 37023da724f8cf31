"""Which demonstrations of a data set can be used: one rule for every verb, applied before anything long begins."""

from collections.abc import Callable, Sequence

from ocplanner.demos.dataset import Demonstrations
from ocplanner.demos.demonstration import Demonstration
from ocplanner.errors import DatasetError, OcplannerError

Check = Callable[[Demonstration], object]
"""Reads what a verb needs of a demonstration; an error means that it cannot be used."""

HARDLY_HELD = 0.02
"""Share of the steps: people hold the object in a third of them, and in 7 % where they pause most of the time."""

_LEAVE_OUT = "leave the demonstration out (--skip-bad) or "
_SHORTEST = 2
_NAMED = 12


def faults(demos: Demonstrations, names: Sequence[str], check: Check) -> dict[str, str]:
    """Why each of the named demonstrations that cannot be used cannot, by name."""
    found = {}
    for name in names:
        try:
            demo = demos[name]
            if demo.length < _SHORTEST:
                raise DatasetError(f"{demo.length} step(s), but a motion has at least {_SHORTEST}")
            if not len(demo.actions[0]):
                raise DatasetError("actions without numbers")
            check(demo)
        except OcplannerError as error:
            found[name] = _reason(str(error), demos, name)
    return found


def sound_names(
    demos: Demonstrations, names: Sequence[str], check: Check, say: Callable[[str], None] | None = None
) -> list[str]:
    """Those of the named demonstrations that can be used.

    Args:
        demos: the data set; its ``reading.skip_bad`` decides whether the others are left out or an error.
        names: the demonstrations.
        check: what is needed of each.
        say: called with a line for each that is left out.

    Raises:
        DatasetError: some cannot be used; the message has all of them, each with its reason. Or none can.
    """
    if not names:
        raise DatasetError(f"{demos.path}: no demonstration to use; name a mask that is not empty")
    bad = faults(demos, names, check)
    sound = [name for name in names if name not in bad]
    lines = "".join(f"\n  {name}: {reason}" for name, reason in list(bad.items())[:_NAMED])
    more = f"\n  and {len(bad) - _NAMED} more" if len(bad) > _NAMED else ""
    if not sound and len({*bad.values()}) == 1:
        lines, more = f" {bad[names[0]]}", ""
    if not sound:
        raise DatasetError(f"{demos.path}: none of {len(names)} demonstrations can be used:{lines}{more}")
    if bad and not demos.reading.skip_bad:
        raise DatasetError(
            f"{demos.path}: {len(bad)} of {len(names)} demonstrations cannot be used; leave them out with --skip-bad "
            f"(skip_bad=True), or record them again:{lines}{more}"
        )
    for name, reason in bad.items():
        if say is not None:
            say(f"{name} is left out: {reason}")
    return sound


def _reason(text: str, demos: Demonstrations, name: str) -> str:
    """An error without what the line that names the demonstration says already."""
    for told in (f"{demos.path}: ", f"{demos[name]!r}", ": ", " ", f"data/{name}/", f"{name}/"):
        text = text.removeprefix(told)
    return text.replace(_LEAVE_OUT, "")

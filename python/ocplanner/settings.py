"""What frozen settings check about themselves, and how they are made from plain mappings."""

import dataclasses
from collections.abc import Mapping
from typing import Any, get_args

from ocplanner.errors import InvalidValueError, UnknownNameError


def require(condition: bool, message: str) -> None:
    """Stand by a condition.

    Raises:
        InvalidValueError: it does not hold.
    """
    if not condition:
        raise InvalidValueError(message)


def require_choice(kind: str, value: str, alias: Any) -> None:
    """Stand by one of the names of a ``Literal``.

    Raises:
        UnknownNameError: it is none of them.
    """
    if value not in get_args(alias):
        raise UnknownNameError(kind, value, get_args(alias))


def build(kind: Any, values: Mapping[str, Any]) -> Any:
    """An instance of a dataclass; lists become tuples.

    Raises:
        InvalidValueError: a key is unknown, or a value is outside its domain.
    """
    names = {entry.name for entry in dataclasses.fields(kind)}
    unknown = sorted(set(values) - names)
    require(not unknown, f"unknown {kind.__name__} keys {unknown}; known: {sorted(names)}")
    return kind(**{key: tuple(value) if isinstance(value, list) else value for key, value in values.items()})

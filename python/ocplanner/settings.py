"""Frozen settings and records: the checks they share, and their way to plain JSON or YAML values and back."""

import dataclasses
import json
import math
import numbers
import types
import typing
from collections.abc import Mapping
from typing import Any, Literal, TypeVar, get_args, get_origin

from ocplanner.errors import InvalidValueError, UnknownNameError

T = TypeVar("T")


def require(condition: bool, message: str) -> None:
    """Check a condition.

    Raises:
        InvalidValueError: it does not hold.
    """
    if not condition:
        raise InvalidValueError(message)


def require_choice(kind: str, value: str, alias: Any) -> None:
    """Check that a name is one of a ``Literal``.

    Raises:
        UnknownNameError: it is not; the message lists the known names.
    """
    if value not in get_args(alias):
        raise UnknownNameError(kind, value, get_args(alias))


_MOST_SEED = 2**63 - 1
"""The largest that every random generator and every file takes."""


def require_seed(seed: Any, name: str = "seed") -> int:
    """Check a seed.

    Returns:
        The seed as a plain number.

    Raises:
        InvalidValueError: it is no whole number from 0 to 2**63 - 1.
    """
    if not isinstance(seed, numbers.Integral) or not 0 <= int(seed) <= _MOST_SEED:
        raise InvalidValueError(f"{name} is {seed!r}, but must be a whole number from 0 to 2**63 - 1")
    return int(seed)


def require_finite(name: str, values: Any) -> None:
    """Check an array of numbers.

    Raises:
        InvalidValueError: one is NaN or infinite.
    """
    for index, value in enumerate(values.ravel().tolist()):
        if not math.isfinite(value):
            raise InvalidValueError(f"{name} must be finite, but its number {index} is {value}")


def require_names(field: str, names: Any) -> tuple[str, ...]:
    """Check a list of names.

    Raises:
        InvalidValueError: it is one text, whose letters would be taken for names.
    """
    if isinstance(names, str):
        raise InvalidValueError(f"{field} is {names!r}, but must be a tuple of names: write ({names!r},)")
    return tuple(names)


def to_dict(instance: Any) -> dict[str, Any]:
    """A dataclass as plain JSON and YAML values: nested dataclasses become dictionaries, tuples become lists."""
    return json.loads(json.dumps(dataclasses.asdict(instance)))


def build(kind: type[T], values: Any, *, ignore_unknown: bool = False) -> T:
    """The inverse of :func:`to_dict`: an instance of a dataclass from plain values, checked against its annotations.

    Args:
        kind: a dataclass. Its fields may be numbers, texts, ``Literal``, ``X | None``, tuples, mappings with text keys,
            and dataclasses in turn.
        values: a mapping from field names; fields left out take their defaults. Instances of a nested dataclass are
            taken as they are.
        ignore_unknown: accept names that are no field, as a file of a later version may hold.

    Raises:
        InvalidValueError: a field is missing, unknown, of another type, or outside its domain.
        UnknownNameError: a text is none of the names of a ``Literal``.
    """
    return _build(kind, values, "", ignore_unknown)


def _build(kind: type[T], values: Any, path: str, ignore_unknown: bool) -> T:
    if isinstance(values, kind):
        return values
    require(isinstance(values, Mapping), f"{path or kind.__name__} is {values!r}, expected a mapping")
    fields = {field.name: field for field in dataclasses.fields(kind)}  # type: ignore[arg-type]
    unknown = sorted(map(str, set(values) - set(fields)))
    require(ignore_unknown or not unknown, f"unknown {kind.__name__} keys {unknown}; known: {sorted(fields)}")
    annotations, found = typing.get_type_hints(kind), {}
    for name, field in fields.items():
        inner = f"{path}.{name}" if path else name
        if name in values:
            found[name] = _value(annotations[name], values[name], inner, ignore_unknown)
        else:
            optional = field.default is not dataclasses.MISSING or field.default_factory is not dataclasses.MISSING
            require(optional, f"{inner} is missing")
    return kind(**found)


def _value(annotation: Any, value: Any, path: str, ignore_unknown: bool) -> Any:
    origin, arguments = get_origin(annotation), get_args(annotation)
    if annotation is Any:
        return value
    if origin in (types.UnionType, typing.Union):
        if value is None and type(None) in arguments:
            return None
        (annotation,) = (argument for argument in arguments if argument is not type(None))
        return _value(annotation, value, path, ignore_unknown)
    if dataclasses.is_dataclass(annotation):
        return _build(annotation, value, path, ignore_unknown)  # type: ignore[arg-type]
    if origin is Literal:
        require(isinstance(value, str), f"{path} is {value!r}, expected one of {', '.join(map(str, arguments))}")
        require_choice(path, value, annotation)
        return value
    if origin is tuple:
        return _tuple(arguments, value, path, ignore_unknown)
    if origin in (dict, Mapping):
        right = isinstance(value, Mapping) and all(isinstance(key, str) for key in value)
        require(right, f"{path} is {value!r}, expected a mapping with text keys")
        return {key: _value(arguments[1], item, f"{path}.{key}", ignore_unknown) for key, item in value.items()}
    if annotation is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    right = isinstance(value, annotation) and not (annotation is int and isinstance(value, bool))
    require(right, f"{path} is {value!r}, expected {_EXPECTED.get(annotation, annotation)}")
    return value


_EXPECTED: dict[Any, str] = {int: "a whole number", float: "a number", str: "a text", bool: "true or false"}


def _tuple(arguments: tuple[Any, ...], value: Any, path: str, ignore_unknown: bool) -> tuple[Any, ...]:
    require(isinstance(value, list | tuple), f"{path} is {value!r}, expected a list")
    variadic = arguments[1:] == (...,)
    kinds = (arguments[0],) * len(value) if variadic else arguments
    require(len(value) == len(kinds), f"{path} is {value!r}, expected {len(kinds)} entries")
    return tuple(_value(kind, item, f"{path}[{i}]", ignore_unknown) for i, (kind, item) in enumerate(zip(kinds, value)))

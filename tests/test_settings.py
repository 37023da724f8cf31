from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import pytest

from ocplanner.errors import InvalidValueError, UnknownNameError
from ocplanner.settings import build, require, to_dict


@dataclass(frozen=True)
class Inner:
    rate: float = 0.5
    sizes: tuple[int, ...] = (3,)

    def __post_init__(self) -> None:
        require(self.rate > 0, f"rate {self.rate} must be positive")


@dataclass(frozen=True)
class Outer:
    name: str
    kind: Literal["a", "b"] = "a"
    pair: tuple[int, float] = (1, 2.0)
    inner: Inner = field(default_factory=Inner)
    optional: Inner | None = None
    extra: Mapping[str, Any] = field(default_factory=dict)
    on: bool = False


FULL = Outer("x", "b", (4, 0.25), Inner(0.1, (1, 2)), Inner(), {"free": [1, None]}, on=True)


@pytest.mark.parametrize("instance", [Outer("x"), FULL])
def test_plain_values_lead_back(instance):
    assert build(Outer, to_dict(instance)) == instance


def test_instances_are_taken_as_they_are():
    assert build(Outer, {"name": "x", "inner": Inner(0.2)}) == Outer("x", inner=Inner(0.2))


def test_whole_numbers_are_numbers():
    found = build(Inner, {"rate": 1})
    assert isinstance(found.rate, float)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({}, "name is missing"),
        ([], r"Outer is \[\], expected a mapping"),
        ({"name": 1}, "name is 1, expected a text"),
        ({"name": "x", "on": 1}, "on is 1, expected true or false"),
        ({"name": "x", "pair": [1]}, r"pair is \[1\], expected 2 entries"),
        ({"name": "x", "pair": [1, "2"]}, r"pair\[1\] is '2', expected a number"),
        ({"name": "x", "inner": {"sizes": [1.5]}}, r"inner.sizes\[0\] is 1.5, expected a whole number"),
        ({"name": "x", "inner": {"rate": -1}}, "rate -1.0 must be positive"),
        ({"name": "x", "inner": None}, "inner is None, expected a mapping"),
        ({"name": "x", "optional": {"rates": 1}}, r"unknown Inner keys \['rates'\]; known: \['rate', 'sizes'\]"),
        ({"name": "x", "kind": 1}, "kind is 1, expected one of a, b"),
        ({"name": "x", "extra": {1: 2}}, "extra is .*, expected a mapping with text keys"),
    ],
)
def test_the_fault_is_named(values, message):
    with pytest.raises(InvalidValueError, match=message):
        build(Outer, values)


def test_unknown_names_list_the_known():
    with pytest.raises(UnknownNameError, match="unknown kind 'c'; known: a, b"):
        build(Outer, {"name": "x", "kind": "c"})


def test_unknown_fields_may_be_ignored():
    assert build(Outer, {"name": "x", "later": 1, "inner": {"later": 2}}, ignore_unknown=True) == Outer("x")

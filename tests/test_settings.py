from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import pytest

from ocplanner.collection.settings import CollectSettings, RenderSettings
from ocplanner.envs import make_env
from ocplanner.errors import InvalidValueError, UnknownNameError
from ocplanner.files.records.evaluation import EvaluationSettings
from ocplanner.planner.config import PlannerTraining
from ocplanner.policies.config import ObservationConfig, PolicyTraining
from ocplanner.settings import build, require, require_names, require_seed, to_dict
from ocplanner.zero_shot.matrix import transfer_matrix
from ocplanner.zero_shot.transfer import seeds_of


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


@pytest.mark.parametrize("seed", [-1, 2**63, 2**70, 1.5, "7", None, float("nan")])
def test_seeds_that_are_refused(seed):
    with pytest.raises(InvalidValueError, match=r"start is .*, but must be a whole number from 0 to 2\*\*63 - 1"):
        require_seed(seed, "start")


def test_seeds_of_any_integer_type():
    assert [require_seed(seed) for seed in (0, np.int64(7), 2**63 - 1)] == [0, 7, 2**63 - 1]


def test_one_text_is_not_several_names():
    with pytest.raises(InvalidValueError, match=r"cameras is 'agentview'.*write \('agentview',\)"):
        require_names("cameras", "agentview")
    assert require_names("cameras", ["a", "b"]) == ("a", "b")


@pytest.mark.parametrize(
    "make",
    [
        lambda: RenderSettings(cameras="agentview"),
        lambda: RenderSettings(silhouettes="IIWA"),
        lambda: PlannerTraining(cameras="agentview"),
        lambda: ObservationConfig(cameras="agentview"),
        lambda: ObservationConfig(low_dim="object"),
        lambda: make_env("Lift", cameras="agentview"),
        lambda: make_env("Lift", patches="sawyer-base-contact"),
        lambda: transfer_matrix([], "Panda", out="matrix.json"),
    ],
)
def test_every_list_of_names_refuses_one_text(make):
    with pytest.raises(InvalidValueError, match="but must be a tuple of names: write"):
        make()


@pytest.mark.parametrize("seed", [-1, 2**63])
@pytest.mark.parametrize(
    "make",
    [
        lambda seed: CollectSettings(seed=seed),
        lambda seed: PlannerTraining(seed=seed),
        lambda seed: PolicyTraining(seed=seed),
        lambda seed: EvaluationSettings(seed_start=seed),
        lambda seed: seeds_of(3, seed),
        lambda seed: seeds_of([1, seed]),
        lambda seed: make_env("Lift", seed=seed),
    ],
)
def test_every_seed_is_checked(make, seed):
    with pytest.raises(InvalidValueError, match=r"seed|start"):
        make(seed)


@pytest.mark.parametrize("make", [lambda: EvaluationSettings(10**9), lambda: seeds_of(10**12)])
def test_more_episodes_than_anyone_runs_are_refused(make):
    with pytest.raises(InvalidValueError, match="must be at most 1000000"):
        make()

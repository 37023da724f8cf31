import pickle
from dataclasses import replace
from typing import get_args

import pytest

from ocplanner.errors import InvalidValueError, UnknownNameError
from ocplanner.guidance.rewards import Form, RewardConfig


def test_the_defaults_are_the_papers_weights_and_a_penalty():
    config = RewardConfig()
    assert (config.a, config.b, config.form) == (0.003, 0.003, "penalty")


def test_an_unknown_form_lists_the_known():
    with pytest.raises(UnknownNameError, match="'bonus'; known: exp, literal, penalty, potential"):
        RewardConfig(form="bonus")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"a": -1.0}, "position weight a: found -1"),
        ({"b": float("nan")}, "rotation weight b: found NaN"),
        ({"a": float("inf")}, "position weight a: found inf"),
        ({"form": "exp", "scale": 0.0}, "scale: found 0"),
        ({"form": "potential", "gamma": 1.5}, "gamma: found 1.5"),
    ],
)
def test_bad_numbers_are_named(change, message):
    with pytest.raises(InvalidValueError, match=message):
        RewardConfig(**change)


@pytest.mark.parametrize("form", get_args(Form))
def test_survives_copies(form):
    config = replace(RewardConfig(), form=form)
    assert pickle.loads(pickle.dumps(config)) == config  # noqa: S301

from math import sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocplanner.errors import InvalidValueError
from ocplanner.rollouts.intervals import seed_level_interval, wilson


@pytest.mark.parametrize(
    ("successes", "episodes", "low", "high"),
    [(0, 10, 0.0, 0.2775), (10, 10, 0.7225, 1.0), (88, 100, 0.8019, 0.9300), (50, 100, 0.4038, 0.5962)],
)
def test_known_values(successes, episodes, low, high):
    assert wilson(successes, episodes) == pytest.approx((low, high), abs=1e-4)


@given(st.integers(1, 500).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_holds_the_rate_and_mirrors(counts):
    successes, episodes = counts
    low, high = wilson(successes, episodes)
    assert 0 <= low <= successes / episodes <= high <= 1
    assert wilson(episodes - successes, episodes) == pytest.approx((1 - high, 1 - low))


@given(st.integers(1, 500).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_is_wilsons_formula(counts):
    successes, episodes = counts
    rate, weight = successes / episodes, 1.959963984540054**2 / episodes
    centre = (rate + weight / 2) / (1 + weight)
    half = sqrt(weight * rate * (1 - rate) + weight**2 / 4) / (1 + weight)
    low = 0.0 if successes == 0 else max(0.0, centre - half)
    high = 1.0 if successes == episodes else min(1.0, centre + half)
    assert wilson(successes, episodes) == pytest.approx((low, high), abs=1e-12)


def test_no_episodes_tell_nothing():
    assert wilson(0, 0) == (0.0, 1.0)


@pytest.mark.parametrize("counts", [(-1, 5), (6, 5)])
def test_impossible_counts(counts):
    with pytest.raises(InvalidValueError):
        wilson(*counts)


def outcomes(*successes: int, episodes: int = 50) -> list[np.ndarray]:
    return [np.arange(episodes) < count for count in successes]


def width(interval: tuple[float, float]) -> float:
    return interval[1] - interval[0]


def test_the_bootstrap_agrees_with_the_exact_distribution_of_one_training():
    from scipy.stats import binom

    exact = binom.ppf([0.025, 0.975], 50, 0.6) / 50
    assert seed_level_interval(outcomes(30)) == pytest.approx(tuple(exact), abs=0.021)


def test_trainings_that_differ_widen_the_interval():
    pooled = wilson(90, 150)
    alike, apart = seed_level_interval(outcomes(30, 30, 30)), seed_level_interval(outcomes(10, 30, 50))
    assert width(alike) == pytest.approx(width(pooled), abs=0.02)
    assert width(apart) > 2 * width(pooled)
    assert apart[0] < 0.6 < apart[1]


def test_checkpoints_of_the_same_episodes_are_no_new_episodes():
    once = outcomes(20, 30, 40)
    five_times = [np.tile(training, (5, 1)) for training in once]
    assert seed_level_interval(five_times) == seed_level_interval(once)


def test_the_rate_is_the_mean_over_trainings_of_any_number_of_episodes():
    low, high = seed_level_interval([np.arange(200) < 100, np.arange(20) < 10])
    assert (low + high) / 2 == pytest.approx(0.5, abs=0.02)


@pytest.mark.parametrize("successes", [0, 50])
def test_equal_outcomes_are_not_certain(successes):
    assert seed_level_interval(outcomes(successes, successes)) == wilson(2 * successes, 100)


def test_is_repeatable_and_converges():
    trainings = outcomes(10, 30, 50)
    assert seed_level_interval(trainings) == seed_level_interval(trainings)
    assert seed_level_interval(trainings, seed=1) == pytest.approx(seed_level_interval(trainings), abs=0.02)


@pytest.mark.parametrize("wrong", [[], [[]], [[0, 2]], [[[[1]]]], [[np.nan]]])
def test_impossible_outcomes(wrong):
    with pytest.raises(InvalidValueError, match="training"):
        seed_level_interval([np.array(each) for each in wrong])


def test_rates_near_one_are_not_more_certain_than_all_episodes_together():
    nearly = outcomes(99, 100, 100, episodes=100)
    low, high = seed_level_interval(nearly)
    assert (low, high) == (wilson(299, 300)[0], 1.0)
    assert low < 0.982  # the bootstrap alone would say 0.987

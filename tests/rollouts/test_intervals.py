import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocplanner.errors import InvalidValueError
from ocplanner.rollouts.intervals import wilson


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


@pytest.mark.parametrize("counts", [(-1, 5), (6, 5)])
def test_impossible_counts(counts):
    with pytest.raises(InvalidValueError):
        wilson(*counts)

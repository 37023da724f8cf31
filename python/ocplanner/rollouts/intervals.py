"""Confidence intervals of success rates."""

from math import sqrt

from ocplanner.errors import InvalidValueError

_Z_95 = 1.959963984540054


def wilson(successes: int, episodes: int) -> tuple[float, float]:
    """The 95 % Wilson score interval of a success rate.

    Raises:
        InvalidValueError: not 0 <= successes <= episodes.
    """
    if not 0 <= successes <= episodes:
        raise InvalidValueError(f"{successes} successes of {episodes} episodes")
    if episodes == 0:
        return 0.0, 1.0
    rate = successes / episodes
    weight = _Z_95**2 / episodes
    centre = (rate + weight / 2) / (1 + weight)
    half = _Z_95 / (1 + weight) * sqrt(rate * (1 - rate) / episodes + weight / (4 * episodes))
    low = 0.0 if successes == 0 else max(0.0, centre - half)
    return low, 1.0 if successes == episodes else min(1.0, centre + half)

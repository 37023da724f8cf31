"""95 % confidence intervals of success rates."""

from collections.abc import Sequence

import numpy as np

from ocplanner.errors import InvalidValueError


def wilson(successes: int, episodes: int) -> tuple[float, float]:
    """The Wilson score interval of the success rate of one policy or planner.

    Raises:
        InvalidValueError: not 0 <= successes <= episodes.
    """
    from scipy.stats import binomtest  # takes a second to import

    if not 0 <= successes <= episodes:
        raise InvalidValueError(f"successes must lie between 0 and the {episodes} episodes, not be {successes}")
    if episodes == 0:
        return 0.0, 1.0
    interval = binomtest(successes, episodes).proportion_ci(method="wilson")
    return float(interval.low), float(interval.high)


def seed_level_interval(
    outcomes: Sequence[np.ndarray], *, resamples: int = 10_000, seed: int = 0
) -> tuple[float, float]:
    """The interval of a success rate over several trainings, by a stratified bootstrap.

    The episodes of one training depend on that training, so the episodes of several are not one binomial sample. As in
    rliable (Agarwal et al. 2021), each resample draws trainings with replacement, and then episodes within each drawn
    training. The interval spans the 2.5th to the 97.5th percentile of the resampled rates. An episode is drawn with its
    outcomes at all checkpoints, so that checkpoints which start from the same states do not count as new episodes.

    Resamples of rates near 0 and 1 differ too little, so the interval is never narrower than the Wilson interval of all
    outcomes together. If all outcomes are equal, the result is the Wilson interval of the episodes that all trainings
    have at one checkpoint. With one training, the interval says nothing about other trainings.

    Args:
        outcomes: for each training, whether its episodes succeeded: (episodes,) or (checkpoints, episodes) of bool, or
            of 0 and 1. The rate is the mean of the trainings' rates.
        resamples: number of resamples.
        seed: seed of the resampling.

    Raises:
        InvalidValueError: there is no training, or one has no episodes, a wrong shape or other values.
    """
    trainings = [np.atleast_2d(np.asarray(outcome, dtype=np.float64)) for outcome in outcomes]
    if not trainings:
        raise InvalidValueError("an interval over trainings needs the outcomes of at least one training")
    for number, training in enumerate(trainings):
        if training.ndim != 2 or training.size == 0 or not np.isin(training, (0, 1)).all():
            raise InvalidValueError(
                f"outcomes of training {number} must be (episodes,) or (checkpoints, episodes) of 0 and 1, "
                f"found an array of shape {np.shape(outcomes[number])}"
            )
    episodes = [training.mean(axis=0) for training in trainings]
    everything = np.concatenate(episodes)
    if (everything == everything[0]).all() and everything[0] in (0, 1):
        return wilson(round(everything[0]) * len(everything), len(everything))
    rng = np.random.default_rng(seed)
    drawn = rng.integers(len(trainings), size=(resamples, len(trainings)))
    rates = np.empty(drawn.shape)
    for number, rate in enumerate(episodes):
        chosen = drawn == number
        rates[chosen] = rate[rng.integers(len(rate), size=(int(chosen.sum()), len(rate)))].mean(axis=1)
    low, high = np.quantile(rates.mean(axis=1), (0.025, 0.975))
    pooled = wilson(sum(int(training.sum()) for training in trainings), sum(training.size for training in trainings))
    return min(float(low), pooled[0]), max(float(high), pooled[1])


def rate_interval(outcomes: Sequence[np.ndarray]) -> tuple[float, float]:
    """95 % interval of a success rate: Wilson's of a single training, over trainings and episodes of several.

    Args:
        outcomes: for each training (episodes,) bool, whether each succeeded; no two start from the same state.
    """
    if len(outcomes) == 1:
        return wilson(int(outcomes[0].sum()), len(outcomes[0]))
    return seed_level_interval(outcomes)

import itertools
import math

import pytest

from ocplanner.training.schedule import learning_rate


def test_warms_up_and_decays():
    rates = [learning_rate(step, base=1.0, steps=100, warmup=10) for step in range(100)]
    assert rates[0] < rates[5] < rates[9]
    assert all(a > b for a, b in itertools.pairwise(rates[10:]))
    assert rates[-1] < 0.01


def test_is_constant_after_the_warm_up():
    rates = [learning_rate(step, base=0.3, steps=8, warmup=4, schedule="constant") for step in range(8)]
    assert rates == pytest.approx([0.075, 0.15, 0.225, 0.3, 0.3, 0.3, 0.3, 0.3])


@pytest.mark.parametrize(("base", "steps", "warmup"), [(1e-3, 6000, 100), (3.3e-4, 777, 13), (1e-4, 5, 0)])
def test_the_order_of_the_factors_changes_no_bit(base, steps, warmup):
    """Planners and policies multiplied in different orders; halving is exact."""
    for step in range(steps):
        warm = min(1.0, (step + 1) / max(1, warmup))
        planners = base * warm * 0.5 * (1 + math.cos(math.pi * step / steps))
        assert learning_rate(step, base=base, steps=steps, warmup=warmup) == planners

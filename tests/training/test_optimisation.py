import pytest

from ocplanner.errors import InvalidValueError
from ocplanner.training.optimisation import BatchOrder


def test_a_batch_far_beyond_the_data_is_refused():
    with pytest.raises(
        InvalidValueError, match="batch is 10000000000, but there are 153 samples to learn from: give at"
    ):
        BatchOrder(153, 10**10, (0,))
    assert len(BatchOrder(153, 256, (0,)).rows(3)) == 256

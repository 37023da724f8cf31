import pytest

from ocplanner.errors import DatasetError, MismatchError
from ocplanner.report.fitting import first_fitting


def refuse(*names):
    def check(demos):
        if demos in names:
            raise MismatchError(f"{demos} does not fit")

    return check


def test_the_first_that_fits_is_taken():
    assert first_fitting(["a", "b", "c"], refuse("a")) == "b"


def test_if_none_fits_every_reason_is_given():
    with pytest.raises(MismatchError, match="a does not fit; b does not fit"):
        first_fitting(["a", "b"], refuse("a", "b"))
    with pytest.raises(MismatchError, match="--data"):
        first_fitting([], refuse())


def test_damage_is_not_passed_over():
    def damaged(_):
        raise DatasetError("truncated")

    with pytest.raises(DatasetError, match="truncated"):
        first_fitting(["a", "b"], damaged)

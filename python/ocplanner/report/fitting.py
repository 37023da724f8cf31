"""Choose, of several data sets, the one that a planner or policy can be drawn on."""

from collections.abc import Callable, Sequence

from ocplanner.demos.dataset import Demonstrations
from ocplanner.errors import MismatchError


def first_fitting(datasets: Sequence[Demonstrations], check: Callable[[Demonstrations], object]) -> Demonstrations:
    """The first data set that ``check`` lets pass.

    Raises:
        MismatchError: there is none; it says what ``check`` said of each.
    """
    faults = []
    for demos in datasets:
        try:
            check(demos)
        except MismatchError as error:
            faults.append(str(error))
        else:
            return demos
    raise MismatchError("; ".join(faults) or "no data set was given; give one with --data")

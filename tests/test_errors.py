import inspect
import pickle

import pytest

from ocplanner import errors


@pytest.mark.parametrize(
    "error", [cls for _, cls in inspect.getmembers(errors, inspect.isclass) if issubclass(cls, errors.OcplannerError)]
)
def test_errors_survive_the_way_back_from_a_worker(error):
    raised = error("robot", "PR2", ("UR5e", "Panda")) if error is errors.UnknownNameError else error("wrong")
    copy = pickle.loads(pickle.dumps(raised))  # noqa: S301
    assert type(copy) is error
    assert str(copy) == str(raised)


def test_an_unknown_name_lists_the_known():
    assert str(errors.UnknownNameError("robot", "PR2", ("UR5e", "Panda"))) == "unknown robot 'PR2'; known: Panda, UR5e"

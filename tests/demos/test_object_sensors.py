"""Which robosuite recorded ``object``: told by the numbers and the version, which must agree."""

import json

import h5py
import numpy as np
import pytest

from ocplanner.demos.dataset import Demonstrations
from ocplanner.demos.layouts import ORDERS, Order
from ocplanner.demos.object_sensors import OBJECT_SENSORS, object_order, rearranged, sensors_of
from ocplanner.errors import ObjectLayoutError, UnknownNameError

STEPS = 20
VERSIONS: dict[Order, str] = {"absolute-first": "1.4.1", "relative-first": "1.5.1"}


@pytest.fixture
def lift(tmp_path):
    """``lift("absolute-first", env_version="1.4.1", eef=True)``: a recording of Lift of that order."""

    def make(order: Order, env_version: str | None, eef: bool = True, width: int = 10) -> Demonstrations:
        rng = np.random.default_rng(0)
        cube, hand = rng.uniform(-0.1, 0.1, (STEPS, 3)), rng.uniform(-0.1, 0.1, (STEPS, 3))
        turn = np.tile([0.0, 0.0, 0.0, 1.0], (STEPS, 1))
        vector = cube - hand if order == "relative-first" else hand - cube
        path = tmp_path / "lift.hdf5"
        with h5py.File(path, "w") as file:
            args = {"env_name": "Lift", "type": 1, "env_version": env_version, "env_kwargs": {"robots": ["Panda"]}}
            file.create_group("data").attrs["env_args"] = json.dumps(args)
            demo = file.create_group("data/demo_0")
            demo["actions"] = np.zeros((STEPS, 7))
            demo["obs/object"] = np.concatenate([cube, turn, vector], axis=1)[:, :width]
            if eef:
                demo["obs/robot0_eef_pos"], demo["obs/robot0_eef_quat"] = hand, turn
        return Demonstrations(path)

    return make


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize(("says", "eef"), [(True, True), (True, False), (False, True)])
def test_each_witness_alone_settles_it(lift, order, says, eef):
    with lift(order, VERSIONS[order] if says else None, eef) as demos:
        assert object_order(demos, "demo_0") == order


@pytest.mark.parametrize("order", ORDERS)
def test_a_version_that_lies_is_found_out(lift, order):
    other = next(version for known, version in VERSIONS.items() if known != order)
    with lift(order, other) as demos, pytest.raises(ObjectLayoutError, match=rf"{other}.*fit {order}; name the robo"):
        object_order(demos, "demo_0")


def test_what_nothing_settles_is_refused_with_a_remedy(lift):
    with lift("absolute-first", None, eef=False) as demos, pytest.raises(ObjectLayoutError, match=r"--low-dim"):
        object_order(demos, "demo_0")
    with lift("absolute-first", "1.4.1", width=9) as demos, pytest.raises(ObjectLayoutError, match=r"\(steps, 10\)"):
        object_order(demos, "demo_0")
    with pytest.raises(ObjectLayoutError, match="unknown for environment 'Door'"):
        sensors_of("Door", "absolute-first")
    with pytest.raises(UnknownNameError, match="relative-first"):
        sensors_of("Lift", "sideways")  # type: ignore[arg-type]


@pytest.mark.parametrize("env_name", sorted(OBJECT_SENSORS))
def test_rearranging_there_and_back_changes_nothing(env_name):
    first, second = (OBJECT_SENSORS[env_name][order] for order in ORDERS)
    widths = [
        4 if one.endswith("_quat") else 1 if one in ("frame_is_assembled", "tool_on_frame") else 3 for one in first
    ]
    seen = np.random.default_rng(0).normal(size=(5, sum(widths)))
    there = rearranged(seen, first, second)
    assert not np.array_equal(there, seen)
    np.testing.assert_array_equal(rearranged(there, second, first), seen)

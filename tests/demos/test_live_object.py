import h5py
import pytest

from ocplanner.collection.collect import collect
from ocplanner.collection.settings import CollectSettings
from ocplanner.demos.dataset import Demonstrations
from ocplanner.demos.live_object import check_live_object
from ocplanner.demos.object_sensors import object_order, sensors_of
from ocplanner.errors import MismatchError


def test_what_was_recorded_is_what_the_simulator_gives(square_ph):
    with Demonstrations(square_ph) as demos:
        check_live_object(demos, "demo_0", sensors_of(demos.env_name, object_order(demos, "demo_0")))


def test_observations_of_other_states_are_found_out(tmp_path):
    """Of the stand, which no free joint of the states carries."""
    path = collect(tmp_path / "hang.hdf5", CollectSettings("ToolHang", episodes=1)).path
    with Demonstrations(path) as demos:
        name, sensors = demos.names[0], sensors_of("ToolHang", object_order(demos, demos.names[0]))
        check_live_object(demos, name, sensors)
    with h5py.File(path, "a") as file:
        file[f"data/{name}/obs/object"][:, 7] += 0.005
    with Demonstrations(path) as demos, pytest.raises(MismatchError, match=r"base_pos in obs/object is 5\.0 mm"):
        check_live_object(demos, name, sensors)

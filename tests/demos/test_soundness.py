import h5py
import numpy as np
import pytest

from ocplanner.demos.dataset import Demonstrations
from ocplanner.demos.settings import ReadSettings
from ocplanner.demos.soundness import sound_names
from ocplanner.errors import DatasetError


@pytest.fixture
def odd(tiny_square, tmp_path):
    """Of seven demonstrations two are sound."""
    path = tmp_path / "odd.hdf5"
    path.write_bytes(tiny_square().read_bytes())
    with h5py.File(path, "r+") as file:
        data = file["data"]
        data["demo_0/actions"][4, 2] = np.nan
        data["demo_1/obs/object"][:] = data["demo_1/obs/object"][0]
        data.create_group("demo_3")
        for name, steps in (("demo_4", 0), ("demo_5", 1)):
            data[f"{name}/actions"] = np.zeros((steps, 7))
    return path


def _needed(demo):
    demo.manipulation()


def test_all_bad_ones_are_named_at_once_each_with_its_reason(odd):
    with Demonstrations(odd) as demos, pytest.raises(DatasetError) as caught:
        sound_names(demos, demos.names, _needed)
    lines = str(caught.value).splitlines()
    assert "5 of 7 demonstrations cannot be used; leave them out with --skip-bad" in lines[0]
    assert [line.split(":")[0].strip() for line in lines[1:]] == ["demo_0", "demo_1", "demo_3", "demo_4", "demo_5"]
    for line, reason in zip(lines[1:], ("nan", "layout|no manipulation|belong", "not there", "0 step", "1 step")):
        assert any(part in line for part in reason.split("|")), line


def test_bad_ones_are_left_out_on_demand_and_told(odd):
    said = []
    with Demonstrations(odd, reading=ReadSettings(skip_bad=True)) as demos:
        assert sound_names(demos, demos.names, _needed, said.append) == ["demo_2", "demo_10"]
        assert len(said) == 5
        assert said[0].startswith("demo_0 is left out: actions: nan at [4, 2]")
        with pytest.raises(DatasetError, match="none of 1 demonstrations can be used"):
            sound_names(demos, ["demo_0"], _needed)


def test_leaving_out_is_no_remedy_where_none_is_sound(odd):
    with Demonstrations(odd) as demos, pytest.raises(DatasetError, match="none of 2 demonstrations") as caught:
        sound_names(demos, ["demo_0", "demo_5"], _needed)
    assert "--skip-bad" not in str(caught.value)
    assert str(caught.value).endswith(
        "demo_0: actions: nan at [4, 2]; record it again\n  demo_5: 1 step(s), but a motion has at least 2"
    )
    with Demonstrations(odd) as demos, pytest.raises(DatasetError, match="name a mask that is not empty"):
        sound_names(demos, [], _needed)

import h5py
import numpy as np
import pytest

from ocplanner.demos.dataset import Demonstrations
from ocplanner.errors import DatasetError, InvalidValueError, ShapeError
from ocplanner.files.records.labels import LABEL_ATTRIBUTE, LabelRecord
from ocplanner.report.reward_figures import JudgedEpisode, judged_figure

PLAN = np.linspace(0, 1, 90)


@pytest.fixture
def labelled(tiny_square, tmp_path):
    """A data set whose demo_0 has the plan's reward, as ``ocplanner label`` leaves it."""

    def make(mode: str) -> Demonstrations:
        path = tmp_path / f"{mode}.hdf5"
        path.write_bytes(tiny_square().read_bytes())
        with h5py.File(path, "r+") as file:
            file["data"].attrs[LABEL_ATTRIBUTE] = LabelRecord("ab", {"reward": mode}).to_json()
            demo = file["data/demo_0"]
            recorded = demo["rewards"][()]
            demo["rewards_sparse"] = recorded
            del demo["rewards"]
            demo["rewards"] = PLAN + (recorded if mode == "augment" else 0)
        return Demonstrations(path)

    return make


@pytest.mark.parametrize("mode", ["augment", "only"])
def test_the_plans_part_of_the_reward_is_told_apart(labelled, mode):
    with labelled(mode) as demos:
        np.testing.assert_allclose(JudgedEpisode("success", demos, "demo_0").plan_reward(), PLAN, atol=1e-6)


def test_episodes_stand_side_by_side(labelled):
    values = np.arange(90.0)
    with labelled("only") as demos:
        episodes = [JudgedEpisode("valued", demos, "demo_0", values), JudgedEpisode("not", demos, "demo_0")]
        figure = judged_figure(episodes, size=64)
    picture, _, reward, other_reward, value, none = figure.axes
    assert picture.images[0].get_array().shape == (64, 192, 3)
    assert picture.get_title("left") == "valued"
    for axes in (reward, other_reward):
        np.testing.assert_allclose(axes.lines[0].get_ydata(), PLAN, atol=1e-6)
    np.testing.assert_array_equal(value.lines[0].get_ydata(), values)
    assert none.texts[0].get_text() == "not valued"


def test_without_values_there_are_only_rewards(labelled):
    with labelled("only") as demos:
        assert len(judged_figure([JudgedEpisode("one", demos, "demo_0")], size=64).axes) == 2


def test_what_does_not_fit_is_an_error(labelled, tiny_square):
    with pytest.raises(InvalidValueError, match="no episode"):
        judged_figure([])
    with Demonstrations(tiny_square()) as demos, pytest.raises(DatasetError, match="ocplanner label --reward"):
        judged_figure([JudgedEpisode("one", demos, "demo_0")], size=64)
    with labelled("only") as demos, pytest.raises(ShapeError, match="found 5"):
        judged_figure([JudgedEpisode("one", demos, "demo_0", np.zeros(5))], size=64)

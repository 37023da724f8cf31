import pytest

from ocplanner.envs.tasks.task import ObjectSpec, Task, top_grasp
from ocplanner.errors import InvalidValueError, UnknownNameError
from ocplanner.report.task_figures import grasps_figure


def test_a_task_of_ones_own_is_shown_with_the_hand_at_the_grasp():
    cube = ObjectSpec("cubeA", "cubeA_joint0", (top_grasp("sides", (0.0, 0.0, 0.0)),), yaw_fold=4)
    axes = grasps_figure(Task("Stack", "Stack", (cube,)), ["Panda"], size=64).axes
    assert [one.get_title("left") for one in axes] == ["Panda: sides, 0 mm off"]
    assert axes[0].images[0].get_array().shape == (64, 64, 3)


def test_a_grasp_out_of_reach_is_told_by_its_distance():
    far = ObjectSpec("cube", "cube_joint0", (top_grasp("above", (0.0, 0.0, 1.5)),))
    (title,) = [one.get_title("left") for one in grasps_figure(Task("Far", "Lift", (far,)), ["Panda"], size=64).axes]
    assert int(title.split()[2]) > 100


def test_the_grasp_that_is_reached_is_taken():
    grasps = (top_grasp("above", (0.0, 0.0, 1.5)), top_grasp("sides", (0.0, 0.0, 0.0)))
    task = Task("Near", "Lift", (ObjectSpec("cube", "cube_joint0", grasps),))
    assert grasps_figure(task, ["Panda"], size=64).axes[0].get_title("left") == "Panda: sides, 0 mm off"


def test_what_is_not_there_is_an_error():
    with pytest.raises(InvalidValueError, match="no arm named"):
        grasps_figure("Square", [])
    with pytest.raises(UnknownNameError, match="Sawyer"):
        grasps_figure("Square", ["Sawer"])

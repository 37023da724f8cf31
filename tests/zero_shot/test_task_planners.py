"""Planners with random weights: one a task, or one an object of it."""

import pytest

from ocplanner.errors import MismatchError
from ocplanner.planner.planner import Planner
from ocplanner.zero_shot.matrix import find_planners
from ocplanner.zero_shot.setup import TransferSetup
from ocplanner.zero_shot.task_planners import TaskPlanners
from random_planner import planner_config, random_tensors, write_planner


@pytest.fixture
def write(tmp_path):
    def write(name: str, **config):
        path = tmp_path / f"{name}.safetensors"
        config = planner_config(**{"task": "ToolHang", "object": name, **config})
        return write_planner(path, config, random_tensors(config))

    return write


def test_planners_stand_in_the_tasks_order(write):
    tool, frame = Planner.load(write("tool")), Planner.load(write("frame"))
    planners = TaskPlanners.of([tool, frame])
    assert planners.by_object == {"frame": frame, "tool": tool}
    assert planners.sha256 == f"{frame.sha256}+{tool.sha256}"
    assert TaskPlanners.of(planners) is planners
    assert TransferSetup.of(planners, "Sawyer").planners == (frame.path.absolute(), tool.path.absolute())


def test_a_planner_alone_is_that_of_its_task(write):
    path = write("SquareNut", task="Square")
    assert TaskPlanners.of(path).sha256 == Planner.load(path).sha256


def test_each_arm_that_carries_an_object_has_a_planner_for_its_part(write):
    names = ("payload:1", "trash", "payload:0", "lid")
    planners = [Planner.load(write(name.replace(":", "-"), task="Transport", object=name)) for name in names]
    assert list(TaskPlanners.of(planners).by_object) == ["lid", "trash", "payload:0", "payload:1"]
    with pytest.raises(MismatchError, match="Transport has no planner for payload:1"):
        TaskPlanners.of(planners[1:])


def test_each_object_has_one_planner(write):
    frame = write("frame")
    with pytest.raises(MismatchError, match=r"ToolHang has no planner for tool .*--object"):
        TaskPlanners.of(frame)
    with pytest.raises(MismatchError, match="both plan for frame of ToolHang"):
        TaskPlanners.of([frame, frame, write("tool")])
    with pytest.raises(MismatchError, match="the object 'stand', which ToolHang does not have"):
        TaskPlanners.of([frame, write("stand")])


@pytest.mark.parametrize("unlike", [{"observe": "full"}, {"seed": 1}, {"visual": "stock"}])
def test_planners_that_see_otherwise_do_not_work_together(write, unlike):
    with pytest.raises(MismatchError, match="cannot work together: " + next(iter(unlike))):
        TaskPlanners.of([write("frame"), write("tool", **unlike)])


def test_a_matrix_takes_the_planners_of_all_objects(write, tmp_path):
    write("frame"), write("tool"), write("cube", task="Lift")
    lift, tool_hang = find_planners([tmp_path])
    assert (lift.task.name, tool_hang.task.name) == ("Lift", "ToolHang")
    assert list(tool_hang.by_object) == ["frame", "tool"]

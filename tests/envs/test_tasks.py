from collections.abc import Callable

import numpy as np
import pytest
from gymnasium.envs.registration import registry

from ocplanner.demos.recorded_task import recorded_task
from ocplanner.envs import ManipulationEnv, make_env
from ocplanner.envs import tasks as package
from ocplanner.envs.registration import register
from ocplanner.envs.tasks import task, task_of_env, tasks
from ocplanner.errors import UnknownNameError


@pytest.mark.parametrize("name", sorted(tasks()))
def test_every_task_is_found_by_both_names(name: str):
    found = task(name)
    assert found.name == name
    assert task_of_env(found.env_name) is found
    assert found.object() is found.objects[0]


@pytest.mark.parametrize("name", sorted(tasks()))
def test_grasp_frames_are_rotations(name: str):
    for spec in task(name).objects:
        assert len({grasp.name for grasp in spec.grasps}) == len(spec.grasps) > 0
        for grasp in spec.grasps:
            rotation = grasp.pose_object_eef.rotation
            np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
            assert np.linalg.det(rotation) == pytest.approx(1.0)
            assert spec.grasp(grasp.name) is grasp


@pytest.mark.parametrize("name", sorted(tasks()))
def test_objects_lie_so_that_their_grasps_come_from_above(name: str, shared_env: Callable[..., ManipulationEnv]):
    env = shared_env(name)
    env.reset(500)
    for _ in range(10):
        env.step(np.tile([0, 0, 0, 0, 0, 0, -1.0], len(env.arms)))
    for spec in env.task.objects:
        pose = env.object_pose(spec.name)
        approaches = np.stack([(pose @ grasp.pose_object_eef).rotation[:, 2] for grasp in spec.grasps])
        steep = approaches @ [0, 0, -1]
        from_above = steep > np.cos(0.1)
        assert from_above.any()
        assert np.all(from_above | (steep < -np.cos(0.1)))  # the others, where it lies on its other side


def test_a_tasks_arms_are_those_of_its_objects():
    assert {name: found.arms for name, found in tasks().items() if found.arms > 1} == {"Transport": 2}


def test_unknown_names_list_the_known():
    with pytest.raises(UnknownNameError, match="Square"):
        task("Sqare")
    with pytest.raises(UnknownNameError, match="NutAssemblySquare"):
        task_of_env("Door")
    with pytest.raises(UnknownNameError, match="SquareNut"):
        task("Square").object("RoundNut")
    with pytest.raises(UnknownNameError, match="handle"):
        task("Square").object().grasp("hole")


def test_a_new_task_is_one_file(tmp_path, monkeypatch):
    """It is known by its names, to Gymnasium, to data sets and to the experts' lookup, and can be simulated."""
    (tmp_path / "round.py").write_text(
        "from ocplanner.envs.tasks.task import ObjectSpec, Task, top_grasp\n"
        'NUT = ObjectSpec("RoundNut", "RoundNut_joint0", (top_grasp("handle", (0.06, 0.0, 0.0)),), yaw_fold=0)\n'
        'TASK = Task("RoundNut", "NutAssemblyRound", (NUT,))\n'
    )
    monkeypatch.setattr(package, "__path__", [*package.__path__, str(tmp_path)])
    registered = dict(registry)
    tasks.cache_clear()
    try:
        register()
        assert registry["ocplanner/RoundNut-v0"].kwargs == {"task": "RoundNut"}
        assert recorded_task("NutAssemblyRound") == ("RoundNut", ("RoundNut",), ("RoundNut",))
        with make_env("RoundNut", cameras=()) as env:
            assert env.object_pose().position.shape == (3,)
    finally:
        monkeypatch.undo()
        tasks.cache_clear()
        registry.clear()
        registry.update(registered)

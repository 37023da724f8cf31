"""The executor on a work cell without a simulator, as on a real arm: grasp, follow, hand over and let go."""

import numpy as np
import pytest

from floating_cell import DOWN, FLOOR, FloatingCell, Toward
from ocplanner.control.arm_program import HorizonReached
from ocplanner.control.executor import Executor
from ocplanner.control.noisy_pose import NoisyPoseCell, PoseError
from ocplanner.control.settings import ControlSettings, GraspSettings
from ocplanner.envs.tasks import ObjectSpec
from ocplanner.envs.tasks.task import top_grasp
from ocplanner.geometry.pose import Pose

LEFT, RIGHT = (Pose(np.array([0.0, y, 1.1]), DOWN) for y in (-0.3, 0.3))
GOAL = np.array([0.15, -0.2, FLOOR + 0.01])


def on_the_floor(x: float, y: float) -> Pose:
    return Pose(np.array([x, y, FLOOR]), np.eye(3))


def cube(name: str = "cube", **how) -> ObjectSpec:
    return ObjectSpec(name, f"{name}_joint", (top_grasp("top", (0.0, 0.0, 0.0)),), yaw_fold=0, **how)


def bar() -> ObjectSpec:
    ends = (top_grasp("near", (0.0, -0.06, 0.0)), top_grasp("far", (0.0, 0.06, 0.0)))
    return ObjectSpec("bar", "bar_joint", ends, yaw_fold=0, arms=(0, 1), ends=(("near", "far"), ("far", "near")))


def run(cell, specs, planners, horizon=600, settings=None, **how) -> tuple[Executor, list[str]]:
    phases = []

    def note(reading):
        phases.append(executor.progress.phase)

    executor = Executor(cell, specs, planners, dict, settings or ControlSettings(), horizon, on_step=note, **how)
    executor.run()
    return executor, list(dict.fromkeys(phases))


def test_an_object_is_taken_carried_and_let_go_of():
    spec = cube()
    cell = FloatingCell({"cube": (spec, on_the_floor(0.0, 0.05))}, [LEFT])
    executor, phases = run(cell, [spec], {"cube": Toward(cell, "cube", GOAL)})
    assert executor.finished
    assert phases == ["grasp", "lift", "transit", "align", "lower", "release"]
    assert cell.poses["cube"].position == pytest.approx([*GOAL[:2], FLOOR], abs=0.006)
    assert cell.arms[0].pose.position[2] > FLOOR + 0.1  # the hand has withdrawn


def test_an_object_that_slips_away_is_taken_again():
    spec = cube()
    cell = FloatingCell({"cube": (spec, on_the_floor(0.0, 0.05))}, [LEFT])
    planner = Toward(cell, "cube", GOAL)
    slipped = []

    class Slippery:
        def plan(self, images):
            if not slipped and cell.poses["cube"].position[2] > FLOOR + 0.1:
                slipped.append(cell.poses["cube"])
                cell.holders["cube"].clear()
            return planner.plan(images)

    executor, phases = run(cell, [spec], {"cube": Slippery()})
    assert executor.finished
    assert slipped
    assert "recover" in phases


def test_an_object_that_cannot_be_taken_is_given_up():
    spec = cube()
    cell = FloatingCell({"cube": (spec, on_the_floor(0.0, 0.05))}, [LEFT])
    cell.specs["cube"] = ObjectSpec("cube", "", (top_grasp("elsewhere", (0.5, 0.0, 0.0)),))
    executor, phases = run(cell, [spec], {}, settings=ControlSettings(grasp=GraspSettings(tries=2)))
    assert not executor.finished
    assert not executor.progress.held_once
    assert phases == ["grasp", "recover"]


def test_the_budget_of_steps_ends_the_run():
    spec = cube()
    cell = FloatingCell({"cube": (spec, on_the_floor(0.0, 0.05))}, [LEFT])
    with pytest.raises(HorizonReached):
        run(cell, [spec], {"cube": Toward(cell, "cube", GOAL)}, horizon=40)


def test_one_arm_hands_an_object_over_to_another():
    spec = bar()
    cell = FloatingCell({"bar": (spec, on_the_floor(0.0, -0.25))}, [LEFT, RIGHT])
    meeting, goal = np.array([0.0, 0.0, 1.05]), np.array([0.1, 0.3, FLOOR + 0.01])
    planners = {"bar:0": Toward(cell, "bar", meeting, over=False), "bar:1": Toward(cell, "bar", goal)}
    executor, phases = run(cell, [spec], planners, horizon=900)
    assert executor.finished
    assert executor.progress.arm == 1
    assert "hand over" in phases
    assert cell.poses["bar"].position == pytest.approx([*goal[:2], FLOOR], abs=0.006)
    assert cell.arms[0].pose.position == pytest.approx(LEFT.position, abs=0.02)  # the giver has gone home


def errors_of_readings(cell, noisy, specs, planners, **how):
    """(name, arm) -> the errors (N, 3) of the active object's position in each step, metres."""
    found = {}

    def note(reading):
        progress = executor.progress
        true = cell.object_pose(progress.spec.name).position
        found.setdefault((progress.spec.name, progress.arm), []).append(reading.object.position - true)

    executor = Executor(noisy, specs, planners, dict, ControlSettings(), 900, on_step=note)
    executor.run()
    assert executor.finished
    return {key: np.array(errors) for key, errors in found.items()}


def test_each_object_and_each_hand_over_gets_fresh_draws_of_the_noise_of_poses():
    specs = [cube(), bar()]
    lying = {"cube": on_the_floor(0.2, -0.3), "bar": on_the_floor(0.0, -0.25)}
    cell = FloatingCell({spec.name: (spec, lying[spec.name]) for spec in specs}, [LEFT, RIGHT])
    goals = {"cube": np.array([-0.2, -0.3, FLOOR]), "bar:1": np.array([0.1, 0.3, FLOOR])}
    planners = {name: Toward(cell, name.split(":")[0], goal) for name, goal in goals.items()}
    planners["bar:0"] = Toward(cell, "bar", np.array([0.0, 0.0, 1.05]), over=False)
    noisy = NoisyPoseCell(cell, ["cube", "bar"], PoseError(0.5, 0.0), 7)
    errors = errors_of_readings(cell, noisy, specs, planners)
    assert list(errors) == [("cube", 0), ("bar", 0), ("bar", 1)]
    draws = np.concatenate([part[:20] for part in errors.values()]).round(9)
    assert len(np.unique(draws, axis=0)) == len(draws)


def test_an_arm_waits_where_the_next_object_is_estimated_to_be():
    specs = [cube("first"), cube("second", arms=(1,))]
    lying = {"first": on_the_floor(0.2, -0.3), "second": on_the_floor(0.1, 0.2)}
    cell = FloatingCell({spec.name: (spec, lying[spec.name]) for spec in specs}, [LEFT, RIGHT])
    noisy = NoisyPoseCell(cell, ["first", "second"], PoseError(30.0, 0.0), 3)
    estimate = noisy.object_pose("second").position[:2]
    assert np.linalg.norm(estimate - lying["second"].position[:2]) > 0.02
    executor = Executor(noisy, specs, {}, dict, ControlSettings(), 60)
    with pytest.raises(HorizonReached):
        executor.run()
    assert cell.arms[1].pose.position[:2] == pytest.approx(estimate, abs=0.002)

import gc
import os
import subprocess
import sys

import numpy as np
import pytest

from ocplanner.envs import make_env, rendering
from ocplanner.envs.simulator import robosuite
from ocplanner.envs.visuals import MASK_RGB
from ocplanner.errors import RenderingError


def _over_the_nut(env) -> None:
    env.reset(2)
    held = env.object_pose() @ env.task.object().grasps[0].pose_object_eef
    env.place_eef(type(held)(held.position + np.array([0, 0, 0.03]), held.rotation @ env.robot.rotation_grasp_site))


@pytest.mark.parametrize("visual", ["fast", "stock"])
@pytest.mark.parametrize("robot", ["Panda", "Sawyer", "UR5e"])
def test_masked_is_the_empty_scene_with_the_robots_pixels_painted(shared_env, robot: str, visual: str):
    if visual == "stock" and robot != "Panda":
        pytest.skip("one arm is enough for the slow preset")
    env = shared_env("Square", robot, visual)
    _over_the_nut(env)
    mask = env.robot_mask("agentview")
    empty = env.render("agentview", 84, 84, "no-robot")
    expected = np.where(mask[..., None], np.array(MASK_RGB, np.uint8), empty)
    np.testing.assert_array_equal(env.render("agentview", 84, 84, "masked"), expected)
    assert 0.02 < mask.mean() < 0.5
    np.testing.assert_array_equal(env.render("agentview", 84, 84, "no-robot"), empty)


def test_the_mask_leaves_the_full_picture_unchanged(shared_env):
    env = shared_env()
    _over_the_nut(env)
    before = env.render("agentview", 84, 84)
    env.render("agentview", 84, 84, "masked")
    env.robot_mask("agentview")
    np.testing.assert_array_equal(env.render("agentview", 84, 84), before)
    mask = env.robot_mask("agentview")
    changed = (before != env.render("agentview", 84, 84, "no-robot")).any(-1)
    assert not (changed & ~mask).any()


def test_without_robot_all_arms_see_the_same(shared_env):
    pictures = []
    for robot in ("Panda", "Sawyer", "IIWA"):
        env = shared_env("Square", robot)
        env.reset(0)
        pose = type(env.object_pose())(np.array([-0.1, 0.15, 0.84]), np.eye(3))
        env.place_object(pose)
        pictures.append(env.render("agentview", 84, 84, "no-robot"))
    np.testing.assert_array_equal(pictures[0], pictures[1])
    np.testing.assert_array_equal(pictures[0], pictures[2])


def test_stock_is_robosuites_own_picture(shared_env):
    env = shared_env("Square", "Panda", "stock")
    env.reset(5)
    theirs = robosuite.make(
        "NutAssemblySquare",
        robots="Panda",
        has_renderer=False,
        has_offscreen_renderer=True,
        use_camera_obs=True,
        camera_heights=84,
        camera_widths=84,
        hard_reset=False,
        seed=0,
    )
    theirs.reset()
    theirs.sim.set_state_from_flattened(env.sim.get_state().flatten())
    theirs.sim.forward()
    picture = theirs.sim.render(84, 84, camera_name="agentview")[::-1]
    np.testing.assert_array_equal(env.render("agentview", 84, 84), picture)
    # robosuite frees its pictures' memory in whatever context is current.
    theirs.sim._render_context_offscreen.gl_ctx.make_current()
    theirs.close()
    del theirs
    gc.collect()
    np.testing.assert_array_equal(env.render("agentview", 84, 84), picture)


def test_fast_looks_like_stock(shared_env):
    pictures = []
    for visual in ("fast", "stock"):
        env = shared_env("Square", "Panda", visual)
        _over_the_nut(env)
        pictures.append(env.render("agentview", 84, 84).astype(float))
    assert np.abs(pictures[0] - pictures[1]).mean() < 8.0


def test_environments_side_by_side_do_not_disturb_each_other(shared_env):
    first = shared_env("Square", "Panda")
    first.reset(0)
    before = first.render("agentview", 84, 84)
    with make_env("Lift", "UR5e", image_size=64) as second:
        other = second.observe()["agentview"]
        assert other.shape == (64, 64, 3)
        np.testing.assert_array_equal(first.render("agentview", 84, 84), before)
        np.testing.assert_array_equal(second.observe()["agentview"], other)
    np.testing.assert_array_equal(first.render("agentview", 84, 84), before)


def test_closing_frees_the_context():
    open_before = len(rendering._open)
    env = make_env("Lift")
    env.observe()
    env.render("frontview", 40, 30)
    assert len(rendering._open) == open_before + 2
    env.close()
    assert len(rendering._open) == open_before


def test_forgetting_to_close_does_no_harm(shared_env):
    env = shared_env()
    env.reset(0)
    before = env.render("agentview", 84, 84)
    forgotten = make_env("Lift")
    forgotten.observe()
    env.render("agentview", 84, 84)
    del forgotten
    gc.collect()
    np.testing.assert_array_equal(env.render("agentview", 84, 84), before)


def test_a_failing_context_names_the_package(shared_env, monkeypatch):
    env = shared_env()

    def fail(*_):
        raise ImportError("Cannot initialize a EGL device display.")

    monkeypatch.setattr(rendering, "gl_context", fail)
    monkeypatch.setenv("MUJOCO_GL", "egl")
    with pytest.raises(RenderingError, match="apt-get install libegl1"):
        env.render("agentview", 33, 33)


def test_mujoco_may_be_imported_first():
    code = "import mujoco\nfrom ocplanner.envs import make_env\nprint(make_env('Lift').observe()['agentview'].std())"
    environment = {name: value for name, value in os.environ.items() if name != "MUJOCO_GL"}
    command = [sys.executable, "-W", "ignore", "-c", code]
    result = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert float(result.stdout) > 10


def _drawing(backend: str) -> str:
    """What another process says that draws with a MUJOCO_GL."""
    code = (
        "from ocplanner.errors import RenderingError\n"
        "try:\n    from ocplanner.envs import make_env; print(make_env('Lift').observe()['agentview'].shape)\n"
        "except RenderingError as error:\n    print(error)\n"
    )
    environment = {**os.environ, "MUJOCO_GL": backend}
    command = [sys.executable, "-W", "ignore", "-c", code]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout.strip()


@pytest.mark.parametrize("backend", ["bogus", "cuda"])
def test_a_wrong_variable_is_named_with_its_value_and_not_a_package(backend):
    said = _drawing(backend)
    assert said.startswith(f"the environment variable MUJOCO_GL is {backend!r}, which is no OpenGL to draw with; set")
    assert "apt-get" not in said


def test_the_remedy_for_a_wrong_variable_works():
    assert "set it to egl" in _drawing("bogus")
    assert _drawing("EGL") == "(84, 84, 3)"


def test_both_arms_are_masked(shared_env):
    env = shared_env("Transport")
    env.reset(0)
    mask = env.robot_mask("agentview")
    hands = np.concatenate([arm.eef_pose().position[None] + [[0.0, 0.0, 0.12]] for arm in env.arms])
    pixels = env.project("agentview", hands, *mask.shape[::-1]).astype(int)
    assert mask[pixels[:, 1], pixels[:, 0]].all()


EXITS = {
    "an open environment": "env = make_env('Lift'); env.observe()",
    "a forked process": "env = make_env('Lift'); env.observe(); os.fork() or sys.exit(0); os.wait()",
    "a picture that could not be drawn": """
rendering.mujoco.MjrContext = lambda *_: 1 / 0
env = make_env('Lift')
try:
    env.observe()
except RenderingError:
    pass
""",
}


@pytest.mark.parametrize("kind", EXITS)
def test_the_end_of_the_process_is_silent(kind):
    code = (
        "import os, sys\nfrom ocplanner.envs import make_env, rendering\nfrom ocplanner.errors import RenderingError\n"
    )
    command = [sys.executable, "-W", "ignore", "-c", code + EXITS[kind]]
    done = subprocess.run(command, capture_output=True, text=True, timeout=100, check=False)
    assert (done.returncode, done.stderr) == (0, "")

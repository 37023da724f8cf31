import warnings
from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np
import pytest
from robosuite.controllers import load_composite_controller_config

from ocplanner import _core
from ocplanner.envs import make_env
from ocplanner.envs.native_control import attach
from ocplanner.envs.simulator import robosuite
from ocplanner.errors import InvalidValueError, ShapeError
from ocplanner.geometry.pose import Pose

ARMS = ("Panda", "Sawyer", "UR5e", "IIWA", "Kinova3", "Jaco", "XArm7")


def _make(robot: str, seed: int = 0, **options: Any) -> Any:
    settings = {
        "has_renderer": False,
        "has_offscreen_renderer": False,
        "use_camera_obs": False,
        "control_freq": 20,
        "hard_reset": False,
        "seed": seed,
    }
    return robosuite.make(options.pop("task", "Lift"), robots=robot, **(settings | options))


def _loop(env: Any, data: Any, number: int = 0, **options: Any) -> _core.ControlLoop:
    robot = env.robots[number]
    arm = robot.part_controllers["right"]
    site = env.sim.model.site_name2id
    arguments = {
        "eef_site": site(arm.ref_name),
        "base_site": site(f"{arm.naming_prefix}right_center"),
        "joint_qpos": arm.qpos_index,
        "joint_qvel": arm.qvel_index,
        "arm_actuators": robot._ref_actuators_indexes_dict["right"],
        "gripper_actuators": robot._ref_actuators_indexes_dict["right_gripper"],
    }
    return _core.ControlLoop(env.sim.model._model, data, **(arguments | options))


@pytest.fixture(scope="module")
def panda() -> Iterator[Any]:
    env = _make("Panda")
    yield env
    env.close()


@pytest.mark.parametrize("robot", ARMS)
def test_torques_are_robosuites(robot: str) -> None:
    """In every substep of random control steps, from the same simulation state."""
    env = _make(robot)
    env.reset()
    model, twin = env.sim.model._model, mujoco.MjData(env.sim.model._model)
    controller = env.robots[0].part_controllers["right"]
    loop = _loop(env, twin)
    command = np.zeros(len(env.robots[0]._ref_actuators_indexes_dict["right_gripper"]))
    robosuites, errors, pending = controller.run_controller, [], []

    def run() -> np.ndarray:
        mujoco.mj_copyData(twin, model, env.sim.data._data)
        measured_at_reset = not controller.new_update and not errors
        if measured_at_reset:
            c = controller
            velocity = np.concatenate((c.ref_pos_vel, c.ref_ori_vel))
            inertia = np.ascontiguousarray(c.mass_matrix)
            loop.remember(c.ref_pos, c.ref_ori_mat, velocity, c.J_full, inertia, c.joint_pos, c.joint_vel)
        torques = robosuites()
        if pending:
            delta = controller.scale_action(pending.pop()[:6])
            loop.begin(delta, command, controller.kp, controller.kd, controller.initial_joint)
            np.testing.assert_allclose(loop.goal_position, controller.goal_pos, atol=1e-12)
            np.testing.assert_allclose(loop.goal_rotation, controller.goal_ori, atol=1e-12)
        loop.advance(1)
        errors.append(np.abs(loop.torques - torques).max())
        return torques

    controller.run_controller = run
    rng = np.random.default_rng(1)
    for _ in range(6):
        action = rng.uniform(-1, 1, env.action_dim)
        pending.append(action)
        env.step(action)
    env.close()
    assert len(errors) == 6 * 25
    assert max(errors) < 1e-6


@pytest.mark.parametrize("robot", ARMS)
def test_rollouts_are_robosuites(robot: str) -> None:
    """The same actions from the same state lead to the same places.

    The Robotiq grippers' linkages are chaotic: a change of 1e-15 rad in one joint grows as much as rounding does.
    """
    env = _make(robot)
    rng = np.random.default_rng(0)
    actions = rng.uniform(-1, 1, (25, env.action_dim))

    def run(disturbance: float = 0.0) -> np.ndarray:
        env.rng = np.random.default_rng(4)
        env.reset()
        env.sim.data.qpos[0] += disturbance
        for action in actions:
            env.step(action)
        data = env.sim.data
        return np.concatenate([data.site_xpos[env.robots[0].eef_site_id["right"]], data.body_xpos[env.cube_body_id]])

    robosuites = run()
    chaos = np.abs(run(1e-15) - robosuites).max()
    assert attach(env) is not None
    np.testing.assert_allclose(run(), robosuites, atol=max(1e-5, 10 * chaos))
    env.close()


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"robots": "IIWA"},
        {"lite_physics": False},
        {"control_freq": 10, "reward_shaping": True},
        {"horizon": 6},
        {"hard_reset": True},
        {"task": "TwoArmTransport", "robots": ["Panda", "IIWA"]},
    ],
    ids=["panda", "moving base", "full physics", "10 Hz", "horizon", "hard reset", "two arms"],
)
def test_a_step_returns_and_leaves_what_robosuites_does(options: dict[str, Any]) -> None:
    robot = options.pop("robots", "Panda")
    stock, ours = _make(robot, **options), _make(robot, **options)
    attach(ours)
    rng = np.random.default_rng(2)
    for episode in range(2):
        expected, found = stock.reset(), ours.reset()
        np.testing.assert_array_equal(found["robot0_joint_pos"], expected["robot0_joint_pos"])
        for _ in range(6):
            action = 0.2 * rng.uniform(-1, 1, stock.action_dim)
            (expected, reward, done, _), (found, our_reward, our_done, _) = stock.step(action), ours.step(action)
            assert found.keys() == expected.keys()
            for name, value in expected.items():
                close = np.abs(np.subtract(found[name], value, dtype=np.float64)) <= 1e-6
                assert np.all(close), f"{name} in episode {episode}: {found[name]}, not {value}"
            assert our_reward == pytest.approx(reward, abs=1e-6)
            assert our_done == done
            _assert_same_bookkeeping(stock, ours)
    for env in (stock, ours):
        env.close()


def _assert_same_bookkeeping(stock: Any, ours: Any) -> None:
    assert (ours.timestep, ours.cur_time, ours.done) == (stock.timestep, stock.cur_time, stock.done)
    assert ours.sim.data.time == stock.sim.data.time
    for robot, our_robot in zip(stock.robots, ours.robots, strict=True):
        _assert_same_robot(robot, our_robot)


def _assert_same_robot(robot: Any, our_robot: Any) -> None:
    for name in ("recent_qpos", "recent_actions"):
        np.testing.assert_allclose(getattr(our_robot, name).current, getattr(robot, name).current, atol=1e-8)
    for name in ("forcetorques", "pose", "vel", "acc"):
        buffers = (getattr(each, f"recent_ee_{name}")["right"] for each in (our_robot, robot))
        np.testing.assert_allclose(*(buffer.current for buffer in buffers), atol=1e-6, err_msg=name)
    arm, our_arm = robot.part_controllers["right"], our_robot.part_controllers["right"]
    for name in ("goal_pos", "goal_ori", "ref_pos", "ref_ori_mat", "ref_pos_vel", "ref_ori_vel", "J_full", "J_ori"):
        np.testing.assert_allclose(getattr(our_arm, name), getattr(arm, name), atol=1e-7, err_msg=name)
    for name in ("mass_matrix", "joint_pos", "joint_vel", "torques"):
        np.testing.assert_allclose(getattr(our_arm, name), getattr(arm, name), atol=1e-5, err_msg=name)
    assert our_arm.new_update == arm.new_update


def test_a_lean_step_moves_alike() -> None:
    stock, native = make_env("Lift", control="stock"), make_env("Lift")
    assert (stock.control, native.control) == ("stock", "native")
    rng = np.random.default_rng(3)
    for env in (stock, native):
        env.reset(seed=5)
    for _ in range(10):
        action = rng.uniform(-1, 1, 7)
        for env in (stock, native):
            env.step(action)
    np.testing.assert_allclose(native.eef_pose().position, stock.eef_pose().position, atol=1e-9)
    np.testing.assert_allclose(native.object_pose().rotation, stock.object_pose().rotation, atol=1e-9)
    assert native.robosuite_env.timestep == stock.robosuite_env.timestep == 10
    stock.close()
    native.close()


def test_attaching_twice_is_attaching_once(panda: Any) -> None:
    assert attach(panda) is attach(panda)
    panda.reset()


def test_an_unsupported_controller_keeps_robosuites_loop() -> None:
    configuration = load_composite_controller_config(robot="Panda")
    configuration["body_parts"]["right"]["type"] = "JOINT_POSITION"
    configuration["body_parts"]["right"] |= {"output_max": 0.05, "output_min": -0.05}
    env = _make("Panda", controller_configs=configuration)
    with pytest.warns(RuntimeWarning, match="robosuite's own control loop is used.*JOINT_POSITION"):
        assert attach(env) is None
    env.reset()
    env.step(np.zeros(env.action_dim))
    env.close()


def test_an_unknown_mujoco_falls_back_with_one_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mujoco, "__version__", "99.0.0")
    with pytest.warns(RuntimeWarning, match=r"robosuite's own control loop is used.*mujoco 99\.0\.0 has loaded no"):
        env = make_env("Lift")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for seed in range(2):
            env.reset(seed)
            env.step(np.zeros(7))
    assert (env.control, env.steps) == ("stock", 1)
    env.close()


def test_a_controller_changed_at_run_time_falls_back_with_one_warning() -> None:
    env = _make("Panda")
    assert attach(env) is not None
    env.robots[0].composite_controller_config["body_parts"]["right"]["input_type"] = "absolute"
    env.reset()
    with pytest.warns(RuntimeWarning, match="absolute"):
        env.step(np.zeros(env.action_dim))
    env.reset()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env.step(np.zeros(env.action_dim))
    env.close()


def test_actions_are_checked(panda: Any) -> None:
    control = attach(panda)
    assert control is not None
    panda.reset()
    for step in (panda.step, control.advance):
        with pytest.raises(ShapeError, match="expected \\(7,\\)"):
            step(np.zeros(6))
        with pytest.raises(InvalidValueError, match="delta: NaN"):
            step(np.full(7, np.nan))
    panda.done = True
    with pytest.raises(ValueError, match="terminated"):
        panda.step(np.zeros(7))


@pytest.mark.parametrize(
    ("wrong", "error", "message"),
    [
        ({"eef_site": 10_000}, InvalidValueError, "eef_site: 10000 is not below"),
        ({"base_site": 10_000}, InvalidValueError, "base_site"),
        ({"joint_qpos": [0] * 6}, ShapeError, "joint_qvel has 7 indices, joint_qpos has 6"),
        ({"joint_qpos": [99] * 7}, InvalidValueError, "joint_qpos: 99"),
        ({"joint_qvel": [99] * 7}, InvalidValueError, "joint_qvel: 99"),
        ({"arm_actuators": [99] * 7}, InvalidValueError, "arm_actuators: 99"),
        ({"gripper_actuators": [99]}, InvalidValueError, "gripper_actuators: 99"),
        ({"joint_qpos": [], "joint_qvel": [], "arm_actuators": []}, InvalidValueError, "joints"),
        ({"eef_site": -1}, InvalidValueError, "-1 is not a count or an index"),
    ],
)
def test_wrong_indices_are_errors(panda: Any, wrong: dict[str, Any], error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        _loop(panda, panda.sim.data._data, **wrong)


def test_wrong_objects_are_errors(panda: Any) -> None:
    other = mujoco.MjModel.from_xml_string("<mujoco/>")
    with pytest.raises(InvalidValueError, match="another model"):
        _loop(panda, mujoco.MjData(other))
    with pytest.raises(InvalidValueError, match=r"expected mujoco\.MjData"):
        _loop(panda, panda.sim.data)


def test_a_loop_that_has_not_begun_does_not_advance(panda: Any) -> None:
    loop = _loop(panda, mujoco.MjData(panda.sim.model._model))
    with pytest.raises(InvalidValueError, match="begun"):
        loop.advance(1)
    six, command, posture = np.ones(6), np.zeros(2), np.zeros(7)
    with pytest.raises(ShapeError, match="gripper"):
        loop.begin(six, np.zeros(3), six, six, posture)
    with pytest.raises(ShapeError, match="posture"):
        loop.begin(six, command, six, six, np.zeros(6))
    with pytest.raises(InvalidValueError, match="stiffness: inf"):
        loop.begin(six, command, np.full(6, np.inf), six, posture)
    with pytest.raises(ShapeError, match=r"delta: expected .*float64.*, found dtype float32"):
        loop.begin(six.astype(np.float32), command, six, six, posture)


def test_several_arms_are_led_by_one_loop() -> None:
    env = _make(["Panda", "Panda"], task="TwoArmTransport")
    data = mujoco.MjData(env.sim.model._model)
    first, second = _loop(env, data, 0), _loop(env, data, 1)
    first.add(second)
    six, command, posture = np.ones(6), np.zeros(2), np.zeros(7)
    first.begin(six, command, six, six, posture)
    with pytest.raises(InvalidValueError, match="begun"):
        first.advance(1)
    second.begin(six, command, six, six, posture)
    with pytest.raises(InvalidValueError, match="added to another"):
        second.advance(1)
    first.advance(25)
    assert data.time == pytest.approx(0.05)
    lone, full = _loop(env, data, 1), _loop(env, data, 1, lite_physics=False)
    elsewhere = _loop(env, mujoco.MjData(env.sim.model._model), 1)
    for leader, added, message in [
        (first, first, "itself"),
        (first, second, "added to another before"),
        (second, lone, "added to another before"),
        (lone, first, "loops of its own"),
        (first, full, "lite_physics"),
        (first, elsewhere, "data differ"),
    ]:
        with pytest.raises(InvalidValueError, match=message):
            leader.add(added)
    env.close()


def test_two_arms_with_full_physics_keep_robosuites_loop() -> None:
    env = _make(["Panda", "Panda"], task="TwoArmTransport", lite_physics=False)
    with pytest.warns(RuntimeWarning, match="several arms with full physics"):
        assert attach(env) is None
    env.close()


def test_a_loop_outlives_its_environment() -> None:
    env = _make("Panda")
    loop = _loop(env, mujoco.MjData(env.sim.model._model))
    env.close()
    six = np.ones(6)
    loop.begin(np.zeros(6), np.zeros(2), six, six, np.zeros(7))
    loop.advance(25)
    assert np.isfinite(loop.torques).all()


@pytest.mark.parametrize("control", ["native", "stock"])
def test_a_step_after_a_placement_starts_there(control: str) -> None:
    """robosuite alone would pull the arm to where the reset had put it."""
    with make_env("Lift", control=control) as env:
        env.reset(seed=0)
        start = env.eef_pose()
        goal = Pose(start.position + np.array([0.0, 0.0, 0.1]), start.rotation)
        env.place_eef(goal)
        env.step(np.zeros(7))
        np.testing.assert_allclose(env.eef_pose().position, goal.position, atol=3e-3)

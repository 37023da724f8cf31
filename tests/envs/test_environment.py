import numpy as np
import pytest

from ocplanner.envs import make_env
from ocplanner.envs.robots import ROBOTS
from ocplanner.errors import InvalidValueError, ShapeError, UnknownNameError
from ocplanner.geometry.pose import Pose

OPEN = np.array([0, 0, 0, 0, 0, 0, -1.0])
CLOSE = -OPEN


@pytest.mark.parametrize("robot", sorted(ROBOTS))
def test_every_arm_does_square(shared_env, robot: str):
    env = shared_env("Square", robot)
    env.reset(1)
    before = env.eef_pose()
    for _ in range(3):
        env.step(np.array([0, 0, 1.0, 0, 0, 0, -1]))
    assert env.steps == 3
    assert env.eef_pose().position[2] > before.position[2] + 0.005
    assert env.eef_pose().rotation[2, 2] < -0.9  # the palm looks down
    assert env.observe()["agentview"].shape == (84, 84, 3)
    assert not env.success()
    assert not env.in_contact()
    np.testing.assert_allclose(env.base_rotation @ env.base_rotation.T, np.eye(3), atol=1e-9)


@pytest.mark.parametrize("task", ["Lift", "Can"])
def test_other_tasks_start(shared_env, task: str):
    env = shared_env(task, "Panda")
    env.reset(0)
    env.step(OPEN)
    pose = env.object_pose()
    assert 0.5 < pose.position[2] < 1.2
    assert not env.success()


@pytest.mark.parametrize("robot", ["Panda", "Sawyer"])
def test_a_seed_fixes_the_episode_whatever_came_before(shared_env, robot: str):
    env = shared_env("Square", robot)
    actions = np.random.default_rng(0).uniform(-1, 1, (10, 7))

    def play() -> np.ndarray:
        env.reset(7)
        for action in actions:
            env.step(action)
        return np.concatenate([env.data.qpos, env.data.qvel])

    first = play()
    env.reset(8)
    assert not np.array_equal(env.data.qpos, first[: env.model.nq])
    env.step(CLOSE)
    np.testing.assert_array_equal(play(), first)


@pytest.mark.parametrize("robot", ["Panda", "Sawyer", "UR5e", "IIWA"])
@pytest.mark.parametrize("grasp", [0, 1])
def test_inverse_kinematics_reaches_the_grasp(shared_env, robot: str, grasp: int):
    env = shared_env("Square", robot)
    env.reset(3)
    held = env.object_pose() @ env.task.object().grasps[grasp].pose_object_eef
    wanted = Pose(held.position + np.array([0, 0, 0.05]), held.rotation @ env.robot.rotation_grasp_site)
    error = env.place_eef(wanted)
    assert error < 2e-3
    np.testing.assert_allclose(env.eef_pose().position, wanted.position, atol=1e-3)
    np.testing.assert_allclose(env.eef_pose().rotation, wanted.rotation, atol=1e-2)
    assert env.place_eef(wanted) <= error + 1e-9


def test_what_is_out_of_reach_is_said(shared_env):
    env = shared_env()
    env.reset(0)
    assert env.place_eef(Pose(np.array([3.0, 0, 1]), env.eef_pose().rotation), restarts=1) > 1.0


@pytest.mark.parametrize("robot", ["Panda", "IIWA", "Kinova3"])
def test_a_gripper_opens_as_far_as_asked(shared_env, robot: str):
    env = shared_env("Square", robot)
    env.reset(0)
    pose = env.eef_pose()
    for opening in (0.06, 0.075):
        env.place_eef(pose, opening, restarts=0)
        assert env.gripper_opening == pytest.approx(opening, abs=4e-3)


def test_objects_go_where_they_are_put(shared_env):
    env = shared_env()
    env.reset(0)
    turned = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    env.place_object(Pose(np.array([0.1, 0.2, 0.9]), turned))
    np.testing.assert_allclose(env.object_pose().position, [0.1, 0.2, 0.9])
    np.testing.assert_allclose(env.object_pose().rotation, turned, atol=1e-12)


def test_a_held_nut_is_in_contact_and_a_placed_nut_is_a_success(shared_env):
    env = shared_env()
    env.reset(0)
    for _ in range(10):
        env.step(OPEN)
    held = env.object_pose() @ env.task.object().grasps[0].pose_object_eef
    env.place_eef(held, 0.08)
    assert not env.in_contact()
    for _ in range(12):
        env.step(CLOSE)
    assert env.in_contact()
    assert 0.01 < env.gripper_opening < 0.04
    env.reset(0)
    peg = env.data.body("peg1").xpos
    env.place_object(Pose(np.array([peg[0], peg[1], 0.83]), np.eye(3)))
    assert env.success()


def test_states_of_the_recordings_are_reproduced(shared_env, square_ph):
    from ocplanner.demos.dataset import Demonstrations

    env = shared_env()
    with Demonstrations(square_ph) as demos:
        for name in ("demo_0", "demo_191"):
            demo = demos[name]
            positions, rotations = demo.object_poses("SquareNut")
            states, eef = demo.states, demo.eef_positions
            for row in range(0, demo.length, 25):
                env.set_state(states[row])
                np.testing.assert_allclose(env.object_pose().position, positions[row], atol=1e-12)
                np.testing.assert_allclose(env.object_pose().rotation, rotations[row], atol=1e-6)
                np.testing.assert_allclose(env.eef_pose().position, eef[row], atol=1e-9)


def test_projection_meets_the_picture(shared_env):
    env = shared_env()
    env.reset(0)
    full = env.render("agentview", 168, 168, "no-robot").astype(int)
    position = env.object_pose().position
    env.place_object(Pose(np.array([5.0, 5, 0.9]), np.eye(3)))
    rows, columns = np.nonzero(np.abs(full - env.render("agentview", 168, 168, "no-robot")).sum(-1) > 60)
    x, y = env.project("agentview", position[None], 168, 168)[0]
    assert columns.min() - 1 <= x <= columns.max() + 1
    assert rows.min() - 1 <= y <= rows.max() + 1
    assert np.isnan(env.project("agentview", np.array([[50.0, 0, 0]]), 168, 168)).all()


def test_bad_input_is_told_apart(shared_env):
    env = shared_env()
    for wrong in ({"robot": "PR2"}, {"task": "Cook"}, {"cameras": ("wrist",)}, {"observe": "half"}):
        with pytest.raises(UnknownNameError, match="known"):
            make_env(**{"task": "Square", **wrong})
    for wrong in ({"visual": "ray-traced"}, {"control": "manual"}, {"patches": ("wings",)}):
        with pytest.raises(UnknownNameError, match="known"):
            make_env("Square", **wrong)
    with pytest.raises(UnknownNameError, match="agentview"):
        env.render("behind", 84, 84)
    with pytest.raises(ShapeError, match=r"\(7,\)"):
        env.step(np.zeros(6))
    with pytest.raises(ShapeError, match=r"\(45,\)"):
        env.set_state(np.zeros(47))


def test_a_task_for_two_arms_has_two_alike(shared_env):
    env = shared_env("Transport", "Panda")
    env.reset(1)
    assert (env.control, env.action_dim, len(env.arms)) == ("native", 14, 2)
    starts = [arm.eef_pose().position for arm in env.arms]
    for _ in range(5):
        env.step(np.concatenate([np.zeros(7), [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]]))
    rises = [arm.eef_pose().position[2] - start[2] for arm, start in zip(env.arms, starts)]
    assert abs(rises[0]) < 0.003
    assert rises[1] > 0.01
    assert env.arms[1].gripper_opening < env.arms[0].gripper_opening - 0.01
    np.testing.assert_array_equal(env.eef_pose().position, env.arms[0].eef_pose().position)
    assert not env.in_contact("payload", arm=1)
    with pytest.raises(ShapeError, match=r"shape \(7,\), expected \(14,\)"):
        env.step(np.zeros(7))


def test_either_arm_is_placed(shared_env):
    env = shared_env("Transport", "Panda")
    env.reset(1)
    first, second = (arm.eef_pose() for arm in env.arms)
    goal = Pose(second.position + np.array([0.0, 0.0, 0.05]), second.rotation)
    assert env.place_eef(goal, arm=1) < 1e-3
    np.testing.assert_allclose(env.arms[1].eef_pose().position, goal.position, atol=1e-3)
    np.testing.assert_array_equal(env.arms[0].eef_pose().position, first.position)


@pytest.mark.parametrize("frequency", [5.0, 12.5, 20.0, 30.0, 100.0])
def test_both_control_loops_keep_the_frequency(frequency):
    """As many physics steps a control step as robosuite takes, and the same hand's path."""
    ends, times = [], []
    for control in ("native", "stock"):
        with make_env("Lift", "Panda", cameras=(), control=control, control_freq=frequency) as env:
            for _ in range(4):
                env.step(np.array([0.3, -0.2, 0.1, 0, 0, 0.1, -1]))
            ends.append(env.eef_pose().position)
            times.append(env.data.time)
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-9)
    np.testing.assert_allclose(times, 4 / frequency, atol=4 * 0.002)


def test_a_frequency_beyond_the_simulations_is_refused():
    for frequency in (0.5, 1000.0, float("nan")):
        with pytest.raises(InvalidValueError, match="control_freq"):
            make_env("Lift", "Panda", cameras=(), control_freq=frequency)


@pytest.mark.parametrize("wrong", [{"image_size": 0}, {"image_size": -1}, {"image_size": 10**6}, {"image_size": 8.5}])
def test_pictures_that_cannot_be_drawn_are_refused_at_once(wrong):
    with pytest.raises(InvalidValueError, match=r"image_size is .*, but must be 1 to 2048 pixels"):
        make_env("Square", **wrong)


def test_a_picture_without_size_is_refused(shared_env):
    with pytest.raises(InvalidValueError, match="width is 0, but must be 1 to 2048 pixels"):
        shared_env().render("agentview", 0, 84)


@pytest.mark.parametrize("control", ["native", "stock"])
@pytest.mark.parametrize("number", [0, 6])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_refused_action_leaves_no_trace(control, number, value):
    wrong, right = np.zeros(7), np.full(7, 0.3)
    wrong[number] = value
    with make_env("Lift", cameras=(), control=control) as env:
        states = []
        for refused in (False, True):
            env.reset(3)
            env.step(right)
            if refused:
                with pytest.raises(InvalidValueError, match=f"an action must be finite, but its number {number} is"):
                    env.step(wrong)
            env.step(right)
            states.append(env.sim.get_state().flatten())
            assert env.steps == 2
    np.testing.assert_array_equal(*states)


def test_states_and_poses_of_nan_move_nothing(shared_env):
    env = shared_env()
    env.reset(0)
    before = env.sim.get_state().flatten()
    nowhere = Pose(np.full(3, np.nan), np.eye(3))
    for move in (
        lambda: env.set_state(before * np.nan),
        lambda: env.place_object(nowhere),
        lambda: env.place_eef(nowhere),
    ):
        with pytest.raises(InvalidValueError, match="must be finite"):
            move()
    np.testing.assert_array_equal(env.sim.get_state().flatten(), before)

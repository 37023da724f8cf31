import json
import shutil
from typing import get_args

import h5py
import numpy as np
import pytest

from ocplanner import _core
from ocplanner.control.grasp_detection import held_steps
from ocplanner.demos.dataset import Demonstrations
from ocplanner.errors import DatasetError, InvalidValueError, MismatchError, UnknownNameError
from ocplanner.guidance.labels import Labeller
from ocplanner.guidance.rewards import Form, RewardConfig
from ocplanner.guidance.settings import LabelSettings
from ocplanner.planner.planner import Planner
from random_planner import write_random_planner

EVERYTHING = LabelSettings(horizon_steps=(1, 4), reward="augment", batch=7)


def labels(path, planner, settings=EVERYTHING, demo="demo_1"):
    with Demonstrations(path) as demos, Labeller(planner, demos, settings) as labeller:
        return labeller.label(demos[demo])


@pytest.fixture(scope="module")
def path(tiny_square):
    return tiny_square("1.4.1", images=True)


@pytest.fixture(scope="module")
def demo(path):
    return Demonstrations(path)["demo_1"]


@pytest.fixture(scope="module")
def held(demo):
    return held_steps(*demo.object_poses("SquareNut"), demo.eef_positions, demo.actions[:, -1])


def test_with_unit_weights_the_hint_is_the_cores_command(path, demo, held, noise_planner):
    hint = labels(path, noise_planner)["obs/ocp_hint"]
    assert hint.shape == (90, 13)
    assert hint.dtype == np.float32
    plan = noise_planner.plan({"agentview": demo.images("agentview")})
    positions, rotations = demo.object_poses("SquareNut")
    assert 30 < held.sum() < 60
    for row in np.flatnonzero(held):
        here, hand = (positions[row], rotations[row]), (demo.eef_positions[row], np.eye(3))
        for place, k in enumerate((1, 4)):
            target = (plan.position[row, k - 1], plan.rotation[row, k - 1])
            command = _core.delta_pose_action(here, target, hand, np.eye(3))
            np.testing.assert_allclose(hint[row, 6 * place : 6 * place + 6], command, rtol=0, atol=1e-5)


def test_nothing_is_hinted_or_rewarded_while_nothing_is_held(path, held, noise_planner):
    found = labels(path, noise_planner)
    np.testing.assert_array_equal(found["obs/ocp_hint"][:, -1], held)
    for key in ("obs/ocp_hint", "obs/ocp_plan", "ocp_reward_position", "ocp_reward_rotation"):
        assert not found[key][~held].any()
        assert found[key][held].any(axis=tuple(range(1, found[key].ndim))).all()


def test_plans_are_stored_in_metres(path, demo, held, noise_planner):
    found = labels(path, noise_planner)["obs/ocp_plan"]
    plan = noise_planner.plan({"agentview": demo.images("agentview")})
    assert found.shape == (90, 6, 9)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found[held][..., :3], plan.position[held], atol=1e-5)
    np.testing.assert_allclose(found[held][..., 3:6], plan.rotation[held][..., 0], atol=1e-5)
    np.testing.assert_allclose(found[held][..., 6:], plan.rotation[held][..., 1], atol=1e-5)


@pytest.mark.parametrize("mode", ["augment", "only"])
def test_the_reward_is_the_papers_in_plain_numpy(path, demo, held, noise_planner, mode):
    found = labels(path, noise_planner, LabelSettings(hints=False, reward=mode))
    plan = noise_planner.plan({"agentview": demo.images("agentview")})
    positions, rotations = demo.object_poses("SquareNut")
    expected = np.zeros((2, 90))
    for t in np.flatnonzero(held):
        expected[0, t] = np.sum((plan.position[t, 0] - positions[t + 1]) ** 2)
        expected[1, t] = np.sum((plan.rotation[t, 0][:, :2] - rotations[t + 1][:, :2]) ** 2)
    np.testing.assert_allclose(found["ocp_reward_position"], expected[0], rtol=0, atol=1e-5)
    np.testing.assert_allclose(found["ocp_reward_rotation"], expected[1], rtol=0, atol=1e-5)
    sparse = demo.rewards
    assert sparse.sum() == 3
    total = -0.003 * expected.sum(axis=0) + (sparse if mode == "augment" else 0)
    np.testing.assert_allclose(found["rewards"], total, rtol=0, atol=1e-7)
    np.testing.assert_array_equal(found["rewards_sparse"], sparse)
    assert found["rewards"].dtype == np.float64
    assert not any("ocp_hint" in key or "ocp_plan" in key for key in found)


@pytest.mark.parametrize("form", get_args(Form))
def test_every_form(path, demo, held, noise_planner, form):
    config = RewardConfig(1.0, 0.1, form=form, scale=2.0, gamma=0.9)
    found = labels(path, noise_planner, LabelSettings(hints=False, reward="only", reward_config=config))
    error = found["ocp_reward_position"] + 0.1 * found["ocp_reward_rotation"]
    before = np.concatenate([[0.0], error[:-1]])  # the demonstrations end done, so their last potential is 0
    expected = {
        "penalty": -error,
        "literal": error,
        "exp": np.where(held, np.exp(-error / 2.0), 0.0),
        "potential": before - 0.9 * error,
    }
    np.testing.assert_allclose(found["rewards"], expected[form], rtol=0, atol=1e-12)


def test_hints_from_the_plan(path, demo, held, noise_planner):
    hint = labels(path, noise_planner, LabelSettings(hint_from="plan", horizon_steps=(2,)))["obs/ocp_hint"]
    plan = noise_planner.plan({"agentview": demo.images("agentview")})
    rotations = demo.object_poses("SquareNut")[1]
    for row in np.flatnonzero(held)[::7]:
        first, third = ((plan.position[row, k], plan.rotation[row, k]) for k in (0, 2))
        grip = first[1] @ rotations[row].T @ (demo.eef_positions[row] - demo.object_poses("SquareNut")[0][row])
        command = _core.delta_pose_action(first, third, (first[0] + grip, np.eye(3)), np.eye(3))
        np.testing.assert_allclose(hint[row, :6], command, rtol=0, atol=1e-5)


def test_hints_alone_leave_rewards_alone(path, noise_planner):
    found = labels(path, noise_planner, LabelSettings())
    assert set(found) == {"obs/ocp_hint", "obs/ocp_plan"}
    assert found["obs/ocp_hint"].shape == (90, 7)


def test_next_observations(tiny_square, path, demo, noise_planner):
    found = labels(path, noise_planner)
    added = {"ocp_hint", "ocp_plan"}
    assert {key for key in found if key.startswith("next_obs/")} == {
        f"next_obs/{key}" for key in {*demo.observation_keys, *added}
    }
    for key in (*demo.observation_keys, *added):
        now = found[f"obs/{key}"] if key in added else demo.observation(key)
        np.testing.assert_array_equal(found[f"next_obs/{key}"], np.concatenate([now[1:], now[-1:]]))
    with_next = labels(tiny_square("1.5.1", images=True), noise_planner, LabelSettings())
    assert {key for key in with_next if key.startswith("next_obs/")} == {"next_obs/ocp_hint", "next_obs/ocp_plan"}


def test_a_planner_of_positions(path, held, tmp_path):
    write_random_planner(tmp_path / "p.safetensors", outputs="position", observe="full", visual=None, mask_rgb=None)
    found = labels(path, Planner.load(tmp_path / "p.safetensors"))
    assert found["obs/ocp_plan"].shape == (90, 6, 3)
    np.testing.assert_allclose(found["obs/ocp_hint"][:, [3, 4, 5, 9, 10, 11]], 0, atol=1e-7)
    assert "ocp_reward_rotation" not in found
    np.testing.assert_allclose(found["rewards"] - found["rewards_sparse"], -0.003 * found["ocp_reward_position"])


def test_a_demonstration_without_a_grasp_gets_zeros(path, tmp_path, noise_planner):
    failed = shutil.copy(path, tmp_path / "failed.hdf5")
    with h5py.File(failed, "r+") as file:
        file["data/demo_1/actions"][:, -1] = -1.0
    found = labels(failed, noise_planner)
    assert not found["obs/ocp_hint"].any()
    assert not found["obs/ocp_plan"].any()
    np.testing.assert_array_equal(found["rewards"], found["rewards_sparse"])


def test_images_that_were_not_drawn_are_refused(path, tmp_path, held, noise_planner):
    broken = shutil.copy(path, tmp_path / "black.hdf5")
    with h5py.File(broken, "r+") as file:
        images = file["data/demo_1/obs/agentview_image"]
        images[0] = 0  # nothing is held there
        images[int(np.flatnonzero(held)[9])] = 0
    with pytest.raises(DatasetError, match=rf"agentview at step {np.flatnonzero(held)[9]}, .*--frames all"):
        labels(broken, noise_planner)
    labels(broken, noise_planner, demo="demo_2")


@pytest.mark.parametrize(
    ("settings", "error", "message"),
    [
        ({"hints": False}, InvalidValueError, "nothing to write"),
        ({"hint_from": "hand"}, UnknownNameError, "known: object, plan"),
        ({"hint_from": "plan", "horizon_steps": (6,)}, InvalidValueError, "step 6 .* from 1 to 5"),
        ({"reward": "dense"}, UnknownNameError, "known: augment, off, only"),
        ({"batch": 0}, InvalidValueError, "batch must be at least 1"),
        ({"threads": 0}, InvalidValueError, "threads must be at least 1"),
        ({"horizon_steps": ()}, InvalidValueError, "horizon steps"),
        ({"horizon_steps": (1, 1)}, InvalidValueError, "horizon steps"),
        ({"horizon_steps": (7,)}, InvalidValueError, "step 7 .* from 1 to 6"),
        ({"horizon_steps": (0,)}, InvalidValueError, "step 0 .* from 1 to 6"),
    ],
)
def test_settings_that_make_no_sense(path, noise_planner, settings, error, message):
    with pytest.raises(error, match=message):
        labels(path, noise_planner, LabelSettings(**settings))


def test_planner_and_data_set_must_fit(tiny_square, path, tmp_path, noise_planner):
    with pytest.raises(MismatchError, match="ocplanner render"):
        labels(tiny_square("1.4.1"), noise_planner)
    write_random_planner(tmp_path / "p.safetensors")
    with pytest.raises(MismatchError, match="observe=full"):
        labels(path, Planner.load(tmp_path / "p.safetensors"))


def test_the_planners_pictures_may_be_another_files(tiny_square, noise_planner, path):
    with Demonstrations(tiny_square("1.4.1")) as demos, Demonstrations(path) as pictures:
        with pytest.raises(MismatchError, match="no images of camera agentview"):
            Labeller(noise_planner, demos, EVERYTHING)
        with Labeller(noise_planner, demos, EVERYTHING, pictures=pictures) as labeller:
            found = labeller.label(demos["demo_1"])
    expected = labels(path, noise_planner)
    assert {key for key in expected if "image" not in key} == set(found)
    np.testing.assert_array_equal(found["obs/ocp_hint"], expected["obs/ocp_hint"])


def test_pictures_of_another_recording_are_refused(tiny_square, noise_planner, path, tmp_path):
    other = tmp_path / "other.hdf5"
    shutil.copyfile(path, other)
    with h5py.File(other, "r+") as file:
        file["data/demo_1/actions"][3, 0] += 0.1
    with (
        Demonstrations(tiny_square("1.4.1")) as demos,
        Demonstrations(other) as pictures,
        Labeller(noise_planner, demos, EVERYTHING, pictures=pictures) as labeller,
    ):
        labeller.label(demos["demo_0"])
        with pytest.raises(MismatchError, match="another recording"):
            labeller.label(demos["demo_1"])


@pytest.fixture(scope="module")
def handed_over(carried_objects, tmp_path_factory):
    """The hammer of Transport changes hands at step 145: each hand moves with it while its own gripper is closed."""
    path = tmp_path_factory.mktemp("two arms") / "transport.hdf5"
    shutil.copy(carried_objects("TwoArmTransport"), path)
    with h5py.File(path, "r+") as file:
        for demo in file["data"].values():
            hammer, steps = demo["obs/payload_pos"][:], len(demo["actions"])
            demo["obs/robot0_eef_pos"] = np.where(np.arange(steps)[:, None] < 145, hammer, hammer[145]) + 0.01
            demo["obs/robot1_eef_pos"] = np.where(np.arange(steps)[:, None] >= 145, hammer, hammer[145]) - 0.01
            demo["rewards"], demo["dones"] = np.zeros(steps), np.zeros(steps, np.int64)
            demo["obs/agentview_image"] = np.full((steps, 84, 84, 3), 90, np.uint8)
    return path


@pytest.mark.parametrize(("part", "carried"), [("payload:0", range(115, 140)), ("payload:1", range(165, 190))])
def test_each_arms_hand_goes_with_its_own_gripper(handed_over, tmp_path, part, carried):
    path = tmp_path / "p.safetensors"
    write_random_planner(path, task="Transport", object=part, observe="full", visual=None, mask_rgb=None)
    found = labels(handed_over, Planner.load(path), LabelSettings(hints=False, reward="only"), "demo_0")
    held = np.flatnonzero(found["ocp_reward_position"])
    assert set(carried) <= set(held)
    assert carried[0] - 10 < held[0] <= held[-1] < carried[-1] + 12


def test_the_gripper_is_the_last_of_one_arms_actions_under_another_controller(path, tmp_path, noise_planner, held):
    joints = shutil.copy(path, tmp_path / "joints.hdf5")
    with h5py.File(joints, "r+") as file:
        for demo in file["data"].values():
            actions = np.insert(demo["actions"][:], 0, 0.0, axis=1)
            actions[:, 6], actions[:, 7] = 1.0, demo["actions"][:, 6]
            del demo["actions"]
            demo["actions"] = actions
        env_args = json.loads(file["data"].attrs["env_args"])
        env_args["env_kwargs"]["controller_configs"]["type"] = "JOINT_POSITION"
        file["data"].attrs["env_args"] = json.dumps(env_args)
    found = labels(joints, noise_planner, LabelSettings(hints=False, reward="only"))
    np.testing.assert_array_equal(found["ocp_reward_position"] > 0, held)

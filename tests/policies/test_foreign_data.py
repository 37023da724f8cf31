"""Data sets that say other things than they hold, and those of robots that nobody can simulate."""

import json
import shutil
from dataclasses import replace

import h5py
import numpy as np
import pytest

from ocplanner.cli import main
from ocplanner.demos.dataset import Demonstrations
from ocplanner.errors import DatasetError, InvalidValueError, MismatchError
from ocplanner.files.records.evaluation import EvaluationSettings
from ocplanner.policies.config import ObservationConfig
from ocplanner.policies.evaluate import evaluate_policy
from ocplanner.policies.policy import Policy
from ocplanner.policies.train import read, train_policy

STEPS = 30


@pytest.fixture
def changed(tiny_square, tmp_path):
    """``changed(edit, images=False)``: a copy of the synthetic Square data set after ``edit(file)``."""

    def make(edit, images=False):
        path = tmp_path / "changed.hdf5"
        shutil.copy(tiny_square(images=images), path)
        with h5py.File(path, "a") as file:
            edit(file)
        return path

    return make


def env_kwargs(file, **changes):
    args = json.loads(file["data"].attrs["env_args"])
    args["env_kwargs"] |= changes
    file["data"].attrs["env_args"] = json.dumps(args)


@pytest.fixture
def franka(tmp_path):
    """A real robot's recording: no env_args, 8 absolute joint commands, states of mixed shapes or a group."""
    path, rng = tmp_path / "franka.hdf5", np.random.default_rng(0)
    with h5py.File(path, "w") as file:
        for number, states in enumerate((np.zeros(1), np.zeros((STEPS, 1)), None)):
            demo = file.create_group(f"data/demo_{number}")
            joints = np.cumsum(rng.normal(0, 0.05, (STEPS, 7)), axis=0) + np.arange(-3, 4)
            demo["actions"] = np.concatenate([joints, np.full((STEPS, 1), 80.0)], axis=1)
            demo["obs/joints"], demo["obs/width"] = joints, rng.random((STEPS, 1))
            if states is None:
                demo.create_group("states/joints")
            else:
                demo["states"] = states
    return path


def test_another_robots_actions_come_back_in_their_own_units(franka, tmp_path, capsys):
    run = tmp_path / "run"
    flags = ["--low-dim", "joints", "width", "--mask", "all", "--steps", "300", "--batch", "32", "--learning-rate"]
    assert main(["train-policy", "--data", str(franka), "--run", str(run), *flags, "3e-3"]) == 0
    said = capsys.readouterr().err
    assert said.count("warning: `ocplanner evaluate` will refuse this policy") == 1
    policy = Policy.load(run)
    with Demonstrations(franka) as demos:
        actions = np.concatenate([demo.actions for demo in demos])
        seen = {key: demos[0].observation(key) for key in ("joints", "width")}
        recorded = demos[0].actions
    ranges = np.array(policy.header.action_range)
    np.testing.assert_allclose(ranges[:7], np.stack([actions.min(0), actions.max(0)], axis=1)[:7])
    np.testing.assert_allclose(ranges[7], [79, 81])  # a number that never changes is learned as the middle
    drawn = policy.act(seen)
    assert drawn.shape == (STEPS, 8)
    assert np.abs(drawn - recorded).mean() < 0.5
    with pytest.raises(MismatchError, match=r"task is not named.*no robot.*no OSC_POSE deltas"):
        evaluate_policy(run / "policy.safetensors")


def test_a_data_set_without_masks_is_learned_from_whole(franka, small, capsys):
    recorded = read(replace(small(), observation=ObservationConfig(("joints",))), franka)
    assert recorded.train is not None
    assert recorded.valid is None
    assert "has no masks: training on every demonstration, none is held out" in capsys.readouterr().err


def test_masks_that_share_demonstrations_are_refused(changed, small, tiny_square):
    def overlap(file):
        del file["mask/valid"]
        file["mask/valid"] = np.array([b"demo_10", b"demo_2"])

    def same(file):
        del file["mask/valid"]
        file["mask/valid"] = file["mask/train"][:]

    for edit in (overlap, same):
        with pytest.raises(DatasetError, match=r"mask/train and mask/valid share .*demo_10.*--mask all"):
            read(small(), changed(edit))
    assert read(small(mask=None), changed(same)).valid is None
    assert read(small(), tiny_square()).valid is not None


def test_absolute_actions_that_nobody_flagged_are_refused_and_the_remedy_works(changed, small, tmp_path):
    def absolute(file):
        for demo in file["data"].values():
            places = demo["obs/robot0_eef_pos"][:]
            demo["actions"][:, :3] = np.concatenate([places[1:], places[-1:]])

    def flagged(file):
        absolute(file)
        env_kwargs(file, controller_configs={"type": "OSC_POSE", "control_delta": False})

    with pytest.raises(
        MismatchError, match=r"in 4 of 4 demonstrations, as absolute actions do.*control_delta to false"
    ):
        read(small(), changed(absolute))
    recorded = read(small(), changed(flagged))
    assert recorded.header.action_frame is None
    assert "absolute actions" in recorded.warnings[0]


@pytest.mark.parametrize("both", [True, False])
def test_a_policy_acts_as_often_as_its_data_were_recorded(changed, small, tmp_path, monkeypatch, both):
    def slow(file):
        for demo in file["data"].values():
            demo["states"][:, 0] *= 4
        if both:
            env_kwargs(file, control_freq=5)

    path = changed(slow)
    if not both:
        with pytest.raises(MismatchError, match=r"control_freq in env_args is 20 Hz, but .* 200 ms apart \(5 Hz\)"):
            read(small(), path)
        return
    train_policy(small(steps=1), path, tmp_path / "run")
    assert Policy.load(tmp_path / "run").header.control_freq == 5
    times = []
    from ocplanner.envs.environment import ManipulationEnv

    success = ManipulationEnv.success
    monkeypatch.setattr(ManipulationEnv, "success", lambda env: times.append(env.data.time) or success(env))
    evaluate_policy(tmp_path / "run" / "policy.safetensors", settings=EvaluationSettings(episodes=1, horizon=3))
    np.testing.assert_allclose(np.diff(times[-3:]), 0.2)


def test_a_preset_that_is_not_on_record_must_be_named(changed, small, tmp_path):
    """The pictures are noise, so nothing can be measured."""
    path = changed(lambda file: None, images=True)
    config = small(steps=1, cameras=("agentview",))
    assert "--visual" in read(config, path).warnings[0]
    train_policy(config, path, tmp_path / "seeing")
    train_policy(small(steps=1), path, tmp_path / "blind")

    def evaluated(run, visual=None):
        settings = EvaluationSettings(episodes=1, horizon=1, visual=visual)
        return evaluate_policy(tmp_path / run / "policy.safetensors", settings=settings)

    with pytest.raises(MismatchError, match="say it with --visual fast or --visual stock"):
        evaluated("seeing")
    assert evaluated("seeing", "stock").settings.visual == "stock"
    with pytest.raises(InvalidValueError, match="reads no pictures: drop --visual"):
        evaluated("blind", "fast")


def test_a_camera_that_the_task_lacks_is_refused_before_training(changed, small, tmp_path):
    def rename(file):
        for demo in file["data"].values():
            demo.move("obs/agentview_image", "obs/kitchen_image")

    with pytest.raises(MismatchError, match=r"cannot be had live: unknown camera 'kitchen'.*--cameras"):
        train_policy(small(cameras=("kitchen",)), changed(rename, images=True), tmp_path / "run")


def test_states_of_another_recording_or_arm_are_refused(changed, small):
    def shifted(file):
        for demo in file["data"].values():
            demo["states"][:, 10] += 0.01
            demo["obs/object"][:, :3] += [0.01 + 2e-3, 0, 0]

    def another_arm(file):
        env_kwargs(file, robots=["UR5e"])

    with pytest.raises((DatasetError, MismatchError), match=r"SquareNut|free joint"):
        read(small(), changed(shifted))
    with pytest.raises((DatasetError, MismatchError)):
        read(small(), changed(another_arm))

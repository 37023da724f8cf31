"""What ``info`` says about a data set, on synthetic recordings that are each odd in one way."""

import json

import h5py
import numpy as np
import pytest

from ocplanner.demos.dataset import Demonstrations
from ocplanner.demos.findings import findings


@pytest.fixture
def changed(tiny_square, tmp_path):
    def make(change, images=False):
        path = tmp_path / "changed.hdf5"
        path.write_bytes(tiny_square(images=images).read_bytes())
        with h5py.File(path, "r+") as file:
            change(file)
        with Demonstrations(path) as demos:
            return findings(demos)

    return make


def _each(file, change):
    for demo in file["data"].values():
        change(demo)


def _mask(name, *listed):
    def change(file):
        del file[f"mask/{name}"]
        file[f"mask/{name}"] = np.array([entry.encode() for entry in listed])

    return change


def _kwargs(**values):
    def change(file):
        env_args = json.loads(file["data"].attrs["env_args"])
        env_args["env_kwargs"] |= values
        file["data"].attrs["env_args"] = json.dumps(env_args)

    return change


def _flip(demo):
    demo["actions"][:, 6] *= -1


def _shift(demo):
    demo["obs/robot0_eef_pos"][:, 1] += 0.05


def _black(demo):
    demo["obs/agentview_image"][:] = 0


def _beyond(demo):
    demo["actions"][5, 0] = 3.75


def test_nothing_to_say(changed):
    assert changed(lambda file: None) == []


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (_mask("train", "demo_0", "demo_1", "demo_0"), "mask/train names demo_0 more than once; each counts once"),
        (_mask("train", "demo_0", "demo_99"), "mask/train names demo_99, which data does not contain"),
        (_mask("valid", "demo_0", "demo_2"), "mask/train and mask/valid share demo_0; training refuses that"),
        (lambda file: _each(file, _beyond), "of 4 of 360 steps lie outside [-1, 1]; they are clipped"),
        (lambda file: _each(file, _flip), "carried only while the gripper's action is negative"),
        (lambda file: _each(file, _shift), "5.0 cm from its recorded place"),
        (_kwargs(control_freq=5), "control_freq in env_args is 5 Hz, but the states of demo_0 are 50 ms apart"),
        (_kwargs(gripper_types="RethinkGripper"), "RethinkGripper, but Panda is simulated with PandaGripper"),
        (_kwargs(controller_configs={"type": "JOINT_VELOCITY"}), "controllers JOINT_VELOCITY of Panda"),
        (lambda file: file["data"].attrs.__delitem__("env_args"), "does not say its task and robot"),
        (lambda file: file["data/demo_1/actions"].__setitem__((3, 3), np.nan), "demo_1 cannot be used: actions: nan"),
    ],
)
def test_each_is_told(changed, change, said):
    lines = changed(change)
    assert any(said in line for line in lines), lines


def test_black_pictures_are_told(changed):
    lines = changed(lambda file: _each(file, _black), images=True)
    assert "agentview has black pictures in demo_0, demo_1, demo_2 and 1 more" in lines

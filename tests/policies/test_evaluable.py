import json
import shutil
from dataclasses import replace

import h5py
import pytest

from ocplanner.errors import MismatchError
from ocplanner.policies.evaluable import object_of, obstacles
from ocplanner.policies.evaluate import evaluate_policy
from ocplanner.policies.train import train_policy
from random_policy import header_of


def reading(config, *keys):
    return replace(config, observation=replace(config.observation, low_dim=keys))


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        ({"task": ""}, "task is not named"),
        ({"task": "Door"}, "task is Door"),
        ({"robots": ()}, "no robot"),
        ({"robots": ("Panda", "Panda")}, "Panda and Panda"),
        ({"robots": ("Baxter",)}, "Baxter as its robot; one of these can act: Panda"),
        ({"action_frame": None, "action_scale": None}, "no OSC_POSE deltas"),
        ({"object_layout": None}, "object, which cannot be had live"),
        ({"task": "Lift"}, "its file does not name them; train it again"),
        ({"object_sensors": ("SquareNut_pos", "/etc/passwd")}, "object, which cannot be had live"),
    ],
)
def test_what_cannot_be_evaluated_says_why(small, changes, fault):
    config = small()
    found = obstacles(header_of(config, **changes), config)
    assert [fault in str(one) for one in found] == [True]


def test_hints_that_nobody_labelled_cannot_be_made(small):
    config = small(hint=(1,))
    (found,) = obstacles(header_of(config), config)
    assert "ocplanner label" in str(found)


def test_files_without_sensors_are_read_as_before(small):
    config = small()
    assert not obstacles(header_of(config), config)
    assert object_of(header_of(config)) == (
        "SquareNut_pos",
        "SquareNut_quat",
        "SquareNut_to_robot0_eef_pos",
        "SquareNut_to_robot0_eef_quat",
    )


def test_observations_that_are_never_live_are_refused_before_training(tiny_square, tmp_path, small):
    path = tmp_path / "more.hdf5"
    shutil.copy(tiny_square(), path)
    with h5py.File(path, "a") as file:
        for demo in file["data"].values():
            demo["obs/weather"] = demo["obs/robot0_eef_pos"][:]
    with pytest.raises(MismatchError, match=r"would refuse.*weather, which cannot be had live.*--low-dim"):
        train_policy(reading(small(), "object", "weather"), path, tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_other_actions_and_robots_are_warned_of_once(tiny_square, tmp_path, small, capsys):
    path = tmp_path / "joints.hdf5"
    shutil.copy(tiny_square(), path)
    with h5py.File(path, "a") as file:
        args = json.loads(file["data"].attrs["env_args"])
        args["env_kwargs"] |= {"robots": ["Ufactory850"], "controller_configs": {"type": "JOINT_VELOCITY"}}
        file["data"].attrs["env_args"] = json.dumps(args)
    train_policy(small(steps=1), path, tmp_path / "run")
    said = capsys.readouterr().err
    assert said.count("warning: `ocplanner evaluate` will refuse this policy") == 1
    assert "JOINT_VELOCITY" in said
    assert "Ufactory850" in said
    with pytest.raises(MismatchError, match=r"Ufactory850.*no OSC_POSE deltas"):
        evaluate_policy(tmp_path / "run" / "policy.safetensors")

"""What an error tells to do is done, word for word, and then the verb goes through."""

import re
import shlex
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest
from inputs import INPUTS
from table import call, render_flags, train_planner_flags, train_policy_flags

SOURCE, TARGET = "source.hdf5", "target.hdf5"


@pytest.fixture
def work(border, tmp_path, monkeypatch) -> Path:
    """An empty folder to work in."""
    _ = border.base.lift
    monkeypatch.chdir(tmp_path)
    return tmp_path


def told(arguments: list[str]) -> str:
    """The error of a verb that must fail."""
    code, text = call(arguments)
    assert code == 2, text
    return text


def done(arguments: list[str]) -> str:
    """What a verb says that must succeed."""
    code, text = call(arguments)
    assert code == 0, text
    return text


def command(error: str, *further: str) -> list[str]:
    """The command that an error names between backticks, on our files."""
    named = re.search(r"`ocplanner ([^`]*)`", error)
    assert named, error
    words = [
        {"SOURCE": SOURCE, "TARGET": TARGET, "DATA": SOURCE, "OUT": TARGET}.get(w, w) for w in shlex.split(named[1])
    ]
    return [*words, *further]


def make(border, name: str) -> None:
    with INPUTS[name].at(border.base, Path.cwd()) as path:
        path.rename(SOURCE)


@pytest.mark.parametrize("verb", ["convert", "render", "label", "train-policy"])
def test_skip_bad_after_a_nan(border, work, verb):
    make(border, "nan-action")
    arguments = {
        "convert": [SOURCE, TARGET],
        "render": [SOURCE, TARGET, *render_flags()],
        "label": [SOURCE, TARGET, "--planner", str(border.planner)],
        "train-policy": train_policy_flags(SOURCE, "run"),
    }[verb]
    error = told([verb, *arguments])
    flag = re.search(r"leave them out with (--[a-z-]+)", error)
    assert flag, error
    said = done([verb, *arguments, flag[1]])
    assert "demo_1 is left out: actions: nan at [4, 2]" in said
    if Path(TARGET).exists():
        with h5py.File(TARGET) as file:
            assert sorted(file["data"]) == ["demo_0", "demo_2"]
            assert sorted(file["mask/train"][:].tolist()) == [b"demo_0"]


def test_the_rendering_that_train_planner_asks_for(border, work):
    make(border, "states-only")
    error = told(["train-planner", *train_planner_flags(SOURCE, "run")])
    done(command(error, "--workers", "1"))
    done(["train-planner", *train_planner_flags(TARGET, "run")])


def test_the_rendering_that_label_asks_for(border, work):
    make(border, "states-only")
    error = told(["label", SOURCE, "labelled.hdf5", "--planner", str(border.planner)])
    done(command(error, "--workers", "1"))
    done(["label", TARGET, "labelled.hdf5", "--planner", str(border.planner)])


def test_label_where_hints_are_missing(border, work):
    make(border, "plain")
    arguments = [*train_policy_flags(SOURCE, "run"), "--hint"]
    error = told(["train-policy", *arguments])
    assert command(error) == ["label"]
    done(["label", SOURCE, TARGET, "--planner", str(border.planner)])
    done(["train-policy", *train_policy_flags(TARGET, "run"), "--hint"])


def test_a_gripper_is_turned_round(border, work):
    make(border, "flipped-gripper")
    label = ["--planner", str(border.planner)]
    error = told(["label", SOURCE, "labelled.hdf5", *label])
    verb, flag = command(error)
    done([verb, SOURCE, TARGET, flag])
    assert "held in 92 of 213 steps" in done(["label", TARGET, "labelled.hdf5", *label])


def test_pictures_are_turned_over(border, work):
    make(border, "upside-down")
    error = told(["train-planner", *train_planner_flags(SOURCE, "run")])
    done(command(error))
    done(["train-planner", *train_planner_flags(TARGET, "run")])
    with h5py.File(TARGET) as turned, h5py.File(border.base.lift) as before:
        for name in before["data"]:
            key = f"data/{name}/obs/agentview_image"
            np.testing.assert_array_equal(turned[key][:], before[key][:])


def test_training_without_masks_that_overlap(border, work):
    make(border, "overlapping-masks")
    error = told(["train-policy", *train_policy_flags(SOURCE, "run")])
    flags = re.search(r"\((--mask all)\)", error)
    assert flags, error
    done(["train-policy", *train_policy_flags(SOURCE, "run"), *flags[1].split()])


def test_absolute_actions_are_named_as_such(border, work):
    make(border, "unflagged-absolute")
    label = ["--planner", str(border.planner)]
    error = told(["label", SOURCE, TARGET, *label])
    assert "set control_delta to false in the controller of env_args" in error
    shutil.copyfile(SOURCE, "told.hdf5")
    with h5py.File("told.hdf5", "r+") as file:
        env_args = file["data"].attrs["env_args"]
        file["data"].attrs["env_args"] = env_args.replace(
            '"type": "OSC_POSE"', '"type": "OSC_POSE", "control_delta": false'
        )
    error = told(["label", "told.hdf5", TARGET, *label])
    assert "--no-hints" in error
    done(["label", "told.hdf5", TARGET, *label, "--no-hints", "--reward", "augment"])

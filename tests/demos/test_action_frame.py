import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from ocplanner.demos.action_frame import ActionFrame
from ocplanner.demos.dataset import Demonstrations
from ocplanner.envs import make_env
from ocplanner.errors import DatasetError, MismatchError
from ocplanner.files.records.labels import ActionScale


@pytest.fixture
def with_controller(tiny_square, tmp_path) -> Callable[..., Demonstrations]:
    def make(controllers: Any, version: str = "1.4.1", robots: tuple[str, ...] = ("Panda",)) -> Demonstrations:
        path: Path = tmp_path / "changed.hdf5"
        shutil.copy(tiny_square(version), path)
        with h5py.File(path, "r+") as file:
            env_args = json.loads(file["data"].attrs["env_args"])
            env_args["env_kwargs"] |= {"controller_configs": controllers, "robots": list(robots)}
            file["data"].attrs["env_args"] = json.dumps(env_args)
        return Demonstrations(path)

    return make


def test_up_to_1_4_deltas_are_in_the_world_frame(square_ph):
    with Demonstrations(square_ph) as demos, ActionFrame(demos) as frame:
        assert (frame.name, frame.scale) == ("world", ActionScale(0.05, 0.5))
        assert np.array_equal(frame.rotations_world(demos[0], np.array([3, 8])), np.tile(np.eye(3), (2, 1, 1)))


def test_from_1_5_they_are_in_the_base_frame_unless_it_says_world(tiny_square, with_controller):
    with Demonstrations(tiny_square("1.5.1")) as demos, ActionFrame(demos) as frame:
        assert frame.name == "base"
    osc = {"type": "OSC_POSE", "input_ref_frame": "world"}
    for nested in ({"right": osc}, {"arms": {"right": osc}}):
        with with_controller({"type": "BASIC", "body_parts": nested}, "1.5.1") as demos:
            assert ActionFrame(demos).name == "world"


def test_the_base_frame_turns_with_the_first_joint_of_an_iiwa(with_controller):
    with make_env("Square", "IIWA", cameras=()) as env:
        states, expected = [], []
        env.reset(0)
        for turn in (0.0, 0.5):
            env.data.qpos[0] += turn
            env.sim.forward()
            states.append(np.concatenate([[0.0], env.data.qpos, env.data.qvel]))
            expected.append(env.base_rotation)
    assert np.arccos(np.trace(expected[0].T @ expected[1]) / 2 - 0.5) == pytest.approx(0.5, abs=1e-6)
    controllers = {"type": "BASIC", "body_parts": {"right": {"type": "OSC_POSE"}}}
    with with_controller(controllers, "1.5.1", ("IIWA",)) as demos:
        demos.close()  # it opens again when asked
        with h5py.File(demos.path, "r+") as file:
            del file["data/demo_0/states"], file["data/demo_0/obs/robot0_eef_pos"]
            file["data/demo_0/states"] = np.stack([states[0]] * 88 + states)
        with ActionFrame(demos) as frame:
            found = frame.rotations_world(demos["demo_0"], np.array([3, 89]))
            np.testing.assert_allclose(found, expected, atol=1e-9)
            with pytest.raises(DatasetError, match=r"demo_1.*state"):
                frame.rotations_world(demos["demo_1"], np.array([0]))


def test_another_scale(with_controller):
    osc = {"type": "OSC_POSE", "output_max": [0.02] * 3 + [0.25] * 3, "output_min": [-0.02] * 3 + [-0.25] * 3}
    with with_controller(osc) as demos:
        assert ActionFrame(demos).scale == ActionScale(0.02, 0.25)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"type": "JOINT_VELOCITY"}, "JOINT_VELOCITY of Panda"),
        ({"control_delta": False}, "absolute actions"),
        ({"input_type": "absolute"}, "absolute actions"),
        ({"output_max": [0.05, 0.05, 0.02, 0.5, 0.5, 0.5]}, "symmetric scale"),
        ({"output_min": [-0.01, -0.01, -0.01, -0.5, -0.5, -0.5]}, "symmetric scale"),
        ({"input_max": 2}, "symmetric scale"),
        ({"output_max": "far"}, "cannot be read"),
        ({"input_ref_frame": "tool"}, "'tool'"),
    ],
)
def test_other_actions_are_refused(with_controller, changes, message):
    with (
        with_controller({"type": "OSC_POSE", **changes}) as demos,
        pytest.raises(MismatchError, match=message) as raised,
    ):
        ActionFrame(demos)
    assert str(demos.path) in str(raised.value)


def test_two_arms_are_refused(with_controller):
    osc = {"type": "OSC_POSE"}
    with (
        with_controller([osc, osc], robots=("Panda", "Panda")) as demos,
        pytest.raises(MismatchError, match="one arm"),
    ):
        ActionFrame(demos)

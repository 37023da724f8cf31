import numpy as np
import pytest

from ocplanner.demos.dataset import Demonstrations
from ocplanner.demos.recorded_observation import recorded_observation
from ocplanner.envs import make_env
from ocplanner.errors import MismatchError, UnknownNameError

KEYS = ("object", "robot0_eef_pos", "robot0_eef_quat", "robot0_gripper_qpos")


def test_it_is_what_robomimic_recorded(square_ph):
    rows = range(0, 120, 7)
    with make_env("Square", "Panda", cameras=()) as env, Demonstrations(square_ph) as demos:
        for demo in demos[::40]:
            states, recorded = demo.states, {key: demo.observation(key) for key in KEYS}
            for row in (row for row in rows if row < demo.length):
                env.set_state(states[row])
                seen = recorded_observation(env, demo.object_layout())
                for key in KEYS:
                    np.testing.assert_allclose(seen[key], recorded[key][row], atol=1e-6, err_msg=f"{key} at {row}")


def test_the_other_order_swaps_the_poses():
    with make_env("Square", "Panda", cameras=()) as env:
        first = recorded_observation(env, "absolute-first")["object"]
        other = recorded_observation(env, "relative-first")["object"]
        np.testing.assert_array_equal(other, np.concatenate([first[7:], first[:7]]))
        np.testing.assert_array_equal(first[:3], env.object_pose().position)
        assert "object" not in recorded_observation(env)
        with pytest.raises(UnknownNameError, match="absolute-first"):
            recorded_observation(env, "absolute-last")  # type: ignore[arg-type]


def test_lifts_object_cannot_be_made():
    with make_env("Lift", "Panda", cameras=()) as env, pytest.raises(MismatchError, match="--low-dim"):
        recorded_observation(env, "absolute-first")

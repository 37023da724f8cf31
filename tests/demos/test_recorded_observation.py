import numpy as np
import pytest

from ocplanner.demos.dataset import Demonstrations
from ocplanner.demos.layouts import ORDERS
from ocplanner.demos.object_sensors import OBJECT_SENSORS
from ocplanner.demos.recorded_observation import HAND_KEYS, recorded_observation
from ocplanner.envs import make_env
from ocplanner.errors import ObjectLayoutError, UnknownNameError

KEYS = ("object", *HAND_KEYS)


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


@pytest.mark.parametrize("task", ["Lift", "Stack", "Can", "Square", "ToolHang"])
def test_it_is_what_robosuite_1_5_gives_of_every_task(task):
    """In motion, so that a lag of one step would show: robosuite's sensors are read twice at each state."""
    rng = np.random.default_rng(0)
    with make_env(task, "Panda", cameras=(), seed=3) as env:
        sensors = env.robosuite_env
        names = tuple(
            name for name, one in sensors._observables.items() if one.modality == "object" and one.is_active()
        )
        assert OBJECT_SENSORS[env.task.env_name]["relative-first"] == names
        for _ in range(3):
            for _ in range(5):
                env.step(rng.uniform(-1, 1, 7))
            env.set_state(np.array(env.sim.get_state().flatten()))
            sensors._get_observations(force_update=True)
            expected = sensors._get_observations(force_update=True)["object-state"]
            for layout in ("relative-first", names):
                np.testing.assert_allclose(recorded_observation(env, layout)["object"], expected, atol=1e-6)


def test_lift_and_stack_up_to_1_4():
    """The vector to Lift's cube had the other sign, and Stack's three vectors another order."""
    with make_env("Lift", "Panda", cameras=()) as env:
        first, other = (recorded_observation(env, order)["object"] for order in ORDERS)
        np.testing.assert_array_equal(first, [*other[:7], *-other[7:]])
        np.testing.assert_allclose(first[7:], env.eef_pose().position - env.object_pose().position, atol=1e-12)
    with make_env("Stack", "Panda", cameras=()) as env:
        first, other = (recorded_observation(env, order)["object"] for order in ORDERS)
        np.testing.assert_array_equal(first, [*other[:14], *other[17:], *other[14:17]])
        np.testing.assert_allclose(first[20:], first[7:10] - first[:3], atol=1e-12)


@pytest.mark.parametrize(("task", "objects"), [("Square", 1), ("ToolHang", 3)])
def test_the_other_order_swaps_the_poses(task, objects):
    with make_env(task, "Panda", cameras=()) as env:
        first, other = (recorded_observation(env, order)["object"] for order in ORDERS)
        for block in range(0, 14 * objects, 14):
            np.testing.assert_array_equal(other[block : block + 7], first[block + 7 : block + 14])
            np.testing.assert_array_equal(other[block + 7 : block + 14], first[block : block + 7])
        if task == "Square":
            np.testing.assert_array_equal(first[:3], env.object_pose().position)
        assert "object" not in recorded_observation(env)
        with pytest.raises(UnknownNameError, match="absolute-first"):
            recorded_observation(env, "absolute-last")  # type: ignore[arg-type]


def test_an_unknown_object_is_refused():
    with make_env("Transport", "Panda", cameras=()) as env, pytest.raises(ObjectLayoutError, match="--low-dim"):
        recorded_observation(env, "absolute-first")

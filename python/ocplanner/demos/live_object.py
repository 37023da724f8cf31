"""A recorded ``object`` against the one that the simulator gives for the same states."""

import numpy as np

from ocplanner.demos.dataset import Demonstrations
from ocplanner.demos.object_sensors import Sensors, is_computed, sensor_columns
from ocplanner.demos.recorded_observation import recorded_observation
from ocplanner.demos.recorded_world import RecordedWorld
from ocplanner.envs import make_env
from ocplanner.envs.robots import ROBOTS
from ocplanner.envs.tasks import task_of_env
from ocplanner.errors import DatasetError, MismatchError

POSITION_M = 1e-3
"""Largest distance of a recorded position from the simulated one, in the median step."""
_COMPARED = 9


def check_live_object(demos: Demonstrations, name: str, sensors: Sensors) -> None:
    """Check that the simulator, set to a demonstration's states, gives the positions in ``object``, and its hand.

    What relates the hand and an object follows from both. Recordings without states are taken at their word.

    Raises:
        DatasetError: the states have another model's size.
        MismatchError: it does not give them, or another arm, gripper or scene was recorded.
    """
    demo = demos[name]
    if not demos.robots or demos.robots[0] not in ROBOTS or "object" in demo.derived_keys:
        return
    try:
        _ = demo.states
    except DatasetError:
        return
    seen = sensor_columns(demo.observation("object"), sensors)
    places = {sensor: seen[sensor] for sensor in sensors if sensor.endswith("_pos") and not is_computed(sensor)}
    with make_env(task_of_env(demos.env_name), demos.robots[0], cameras=()) as env:
        world = RecordedWorld(env, demos.grippers)
        states = world.open(demo)
        rows = np.unique(np.linspace(0, demo.length - 1, _COMPARED).astype(int))
        live = []
        for row in rows:
            world.show(demo, states[row])
            live.append(recorded_observation(env, sensors)["object"])
    simulated = sensor_columns(np.array(live), sensors)
    for sensor, recorded in places.items():
        off = float(np.median(np.linalg.norm(recorded[rows] - simulated[sensor], axis=1)))
        if off > POSITION_M:
            raise MismatchError(
                f"{demo!r}: {sensor} in obs/object is {1000 * off:.1f} mm from where the states have it (at most "
                f"{1000 * POSITION_M:g} mm): the observations are another recording's or another scene's; extract them "
                "again from the states (`ocplanner convert`)"
            )

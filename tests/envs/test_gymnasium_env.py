import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from ocplanner.envs.gymnasium_env import GymnasiumEnv
from ocplanner.envs.tasks import tasks
from ocplanner.errors import UnknownNameError


def test_gymnasium_knows_the_tasks():
    assert {f"ocplanner/{name}-v0" for name in tasks()} <= set(gymnasium.registry)


@pytest.mark.parametrize("task", tasks())
def test_the_checker_has_no_complaint(task):
    env = gymnasium.make(f"ocplanner/{task}-v0", robot="UR5e", render_mode="rgb_array")
    check_env(env.unwrapped)  # warnings are errors in this test suite
    env.close()


def test_an_episode_ends_at_its_horizon_and_at_success():
    env = gymnasium.make("ocplanner/Square-v0", horizon=3, observe="masked", image_size=24)
    observation, info = env.reset(seed=4)
    assert not info["success"]
    assert observation["agentview_image"].shape == (24, 24, 3)
    ends = [env.step(np.zeros(7, np.float32))[2:4] for _ in range(3)]
    assert ends == [(False, False), (False, False), (False, True)]
    again, _ = env.reset(seed=4)
    for key, value in observation.items():
        np.testing.assert_array_equal(again[key], value)
    inner = env.unwrapped.env
    inner.place_object(type(inner.object_pose())(np.array([0.23, 0.10, 0.83]), np.eye(3)))
    _, reward, terminated, truncated, info = env.step(np.zeros(7, np.float32))
    assert (reward, terminated, truncated, info["success"]) == (1.0, True, False, True)
    assert env.render() is None
    env.close()


def test_an_unknown_render_mode_is_told():
    with pytest.raises(UnknownNameError, match="rgb_array"):
        GymnasiumEnv("Lift", render_mode="ansi")

import numpy as np
import pytest

from ocplanner.envs import make_env


@pytest.mark.parametrize("patches", [None, ()])
def test_sawyers_base_holds_its_first_joint_only_unpatched(shared_env, patches):
    env = shared_env("Square", "Sawyer") if patches is None else make_env("Square", "Sawyer", patches=patches)
    env.reset(0)
    pair = {env.model.geom("robot0_base_col").id, env.model.geom("robot0_link0_collision").id}
    touching = any(set(contact) == pair for contact in env.data.contact.geom[: env.data.ncon].tolist())
    assert touching == (patches == ())
    assert env.patches == (("sawyer-base-contact",) if patches is None else ())
    if patches == ():
        env.close()


def test_other_arms_have_no_patch(shared_env):
    env = shared_env("Square", "Panda")
    assert env.patches == ()
    assert np.all(env.model.nexclude == 0)


def test_each_of_two_sawyers_is_mended():
    with make_env("Transport", "Sawyer", cameras=()) as env:
        assert env.model.nexclude == 2

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocplanner.control.noisy_mask import KINDS, NoisyMask
from ocplanner.envs import make_env
from ocplanner.errors import InvalidValueError, MismatchError


def disc(radius=10):
    y, x = np.mgrid[:40, :40]
    return (y - 20) ** 2 + (x - 20) ** 2 < radius**2


@given(st.integers(1, 3), st.integers(0, 10**6))
def test_the_error_has_the_size_asked_for(pixels, seed):
    error, mask = NoisyMask(pixels, seed), disc()
    wrong = error.distort(mask)
    assert not np.array_equal(wrong, mask)
    if error.kind == "dilate":
        assert np.all(wrong[mask])
        assert wrong.sum(axis=0).max() == mask.sum(axis=0).max() + 2 * pixels
    elif error.kind == "erode":
        assert np.all(mask[wrong])
        assert wrong.sum(axis=0).max() == mask.sum(axis=0).max() - 2 * pixels
    else:
        assert wrong.sum() == mask.sum()
        assert np.hypot(*error.shift) == pytest.approx(pixels, abs=0.75)


def test_every_kind_occurs_and_the_seed_decides():
    assert {NoisyMask(2, seed).kind for seed in range(30)} == set(KINDS)
    assert NoisyMask(2, 5).shift == NoisyMask(2, 5).shift


def test_where_the_mask_is_too_small_the_robot_shows():
    with make_env("Square", "Sawyer", observe="masked", visual="fast") as env:
        env.reset(500)
        right = env.observe()["agentview"]
        assert np.array_equal(NoisyMask(0, 1).observe(env)["agentview"], right)
        eroded = next(error for seed in range(99) if (error := NoisyMask(3, seed)).kind == "erode")
        wrong = eroded.observe(env)["agentview"]
        full = env.render("agentview", 84, 84, "full")
        rim = env.robot_mask("agentview", 84, 84) & ~eroded.distort(env.robot_mask("agentview", 84, 84))
        assert rim.any()
        assert np.array_equal(wrong[rim], full[rim])


def test_only_masks_can_be_wrong():
    with pytest.raises(InvalidValueError):
        NoisyMask(-1, 0)
    with make_env("Square", "Panda", observe="full") as env, pytest.raises(MismatchError, match="masked"):
        NoisyMask(1, 0).observe(env)

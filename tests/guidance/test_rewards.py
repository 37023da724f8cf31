from dataclasses import dataclass
from typing import get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ocplanner.errors import InvalidValueError, ShapeError
from ocplanner.guidance import rewards
from ocplanner.guidance.rewards import Form, FurtherTerm, RewardConfig, plan_reward

STEPS = 12


def poses(seed: int, steps: int = STEPS) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    rotations = Rotation.from_rotvec(rng.normal(size=(steps, 3))).as_matrix() if steps else np.empty((0, 3, 3))
    return rng.uniform(-1, 1, (steps, 3)), rotations


def restated(planned, achieved, grasping, config, terminal):
    """The definition, transition by transition, in NumPy."""
    dp = np.sum((planned[0] - achieved[0]) ** 2, axis=1) * grasping
    dr = np.zeros(len(dp))
    if planned[1] is not None:
        dr = np.sum((planned[1][:, :, :2] - achieved[1][:, :, :2]) ** 2, axis=(1, 2)) * grasping
    error = config.a * dp + config.b * dr
    phi = np.concatenate([[0.0], -error])
    if terminal:
        phi[-1] = 0.0
    reward = {
        "penalty": -error,
        "literal": error,
        "exp": np.exp(-error / config.scale) * grasping,
        "potential": config.gamma * phi[1:] - phi[:-1],
    }[config.form]
    return dp, dr, reward


@pytest.mark.parametrize("form", get_args(Form))
@pytest.mark.parametrize("with_rotation", [True, False])
@given(
    seed=st.integers(0, 2**31),
    grasping=st.lists(st.booleans(), max_size=STEPS),
    weights=st.tuples(st.floats(0, 10), st.floats(0, 10)),
    terminal=st.booleans(),
)
def test_agrees_with_the_definition(form, with_rotation, seed, grasping, weights, terminal):
    planned, achieved = poses(seed, len(grasping)), poses(seed + 1, len(grasping))
    if not with_rotation:
        planned = (planned[0], None)
    held = np.array(grasping, dtype=bool)
    config = RewardConfig(*weights, form=form, gamma=0.9, scale=3.0)
    found = plan_reward(planned, achieved, held, config, terminal=terminal)
    position, rotation, reward = restated(planned, achieved, held, config, terminal)
    np.testing.assert_allclose(found.position, position, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found.reward, reward, rtol=1e-12, atol=1e-12)
    if with_rotation:
        np.testing.assert_allclose(found.rotation, rotation, rtol=0, atol=1e-12)
    else:
        assert found.rotation is None


def test_two_centimetres_and_a_fifth_of_a_radian():
    turned = Rotation.from_euler("z", 0.2).as_matrix()[None]
    planned = (np.zeros((1, 3)), np.eye(3)[None])
    achieved = (np.array([[0.0, 0.02, 0.0]]), turned)
    found = plan_reward(planned, achieved, np.array([True]))
    assert found.position == pytest.approx([4e-4])
    assert found.rotation == pytest.approx([4 * (1 - np.cos(0.2))])
    assert found.reward == pytest.approx([-0.003 * (4e-4 + 4 * (1 - np.cos(0.2)))])
    at_scale = plan_reward(planned, achieved, np.array([True]), RewardConfig(form="exp"))
    assert at_scale.reward == pytest.approx([np.exp(-1)], rel=0.05)


def test_the_first_step_of_a_batch_of_plans_may_be_strided():
    plans = np.zeros((4, 5, 3)), np.tile(np.eye(3), (4, 5, 1, 1))
    planned = (plans[0][:, 0], plans[1][:, 0])
    reward = plan_reward(planned, (np.ones((4, 3)), np.tile(np.eye(3), (4, 1, 1))), np.ones(4, bool)).reward
    assert reward == pytest.approx(np.full(4, -0.009))


def test_bad_input_is_named():
    planned, achieved, grasping = poses(0), poses(1), np.ones(STEPS, bool)
    for name, arguments in {
        "planned": lambda bad: (bad, achieved),
        "achieved": lambda bad: (planned, bad),
    }.items():
        position, rotation = poses(2)
        broken = position.copy()
        broken[3, 1] = np.nan
        for held in (grasping, ~grasping):
            with pytest.raises(InvalidValueError, match=f"{name} position.*NaN"):
                plan_reward(*arguments((broken, rotation)), held)
        with pytest.raises(InvalidValueError, match=f"{name} rotation: found .*, expected a rotation matrix"):
            plan_reward(*arguments((position, 2 * rotation)), grasping)
        for bad, message in [
            ((position.astype(np.float32), rotation), "float32"),
            ((position[:, :2], rotation), r"\(T, 3\)"),
            ((position[None], rotation), r"expected shape \(T, 3\)"),
            ((position[:5], rotation), r"position: shape is \[5\], expected \(12, 3\)"),
            ((position, rotation[:5]), r"rotation: shape is \[5\], expected \(12, 3, 3\)"),
            ((position, rotation.reshape(STEPS, 9)), r"\(T, 3, 3\)"),
        ]:
            with pytest.raises(ShapeError, match=message) as info:
                plan_reward(*arguments(bad), grasping)
            assert name in str(info.value)
    with pytest.raises(ShapeError, match="achieved rotation"):
        plan_reward(planned, (achieved[0], None), grasping)
    with pytest.raises(ShapeError, match=r"grasping.*bool.*float64"):
        plan_reward(planned, achieved, np.ones(STEPS))  # type: ignore[arg-type]
    with pytest.raises(ShapeError, match="grasping"):
        plan_reward(planned, achieved, [True] * STEPS)  # type: ignore[arg-type]
    with pytest.raises(InvalidValueError, match="too large"):
        plan_reward((np.full((1, 3), 1e300), None), (np.zeros((1, 3)), None), np.array([True]))


@dataclass(frozen=True)
class WithHeight(RewardConfig):
    height: float = 2.0


def test_a_further_term_is_a_function_and_a_weight(monkeypatch):
    def below(planned, achieved):
        return np.maximum(planned[0][:, 2] - achieved[0][:, 2], 0.0)

    monkeypatch.setitem(rewards.FURTHER_TERMS, "height", FurtherTerm("height", below))
    planned, achieved, held = poses(0), poses(1), np.arange(STEPS) % 3 > 0
    config = WithHeight(a=0.5, b=0.25)
    found = plan_reward(planned, achieved, held, config)
    error = np.where(held, below(planned, achieved), 0.0)
    assert error.any()
    np.testing.assert_array_equal(found.terms["ocp_reward_height"], error)
    np.testing.assert_allclose(found.reward, -(0.5 * found.position + 0.25 * found.rotation + 2.0 * error), rtol=1e-12)
    assert list(found.terms) == ["ocp_reward_position", "ocp_reward_rotation", "ocp_reward_height"]
    assert found.last.terms["ocp_reward_height"] == error[-1:]
    with pytest.raises(InvalidValueError, match="weight of the reward term height is -1"):
        WithHeight(height=-1.0)


def test_without_further_terms_only_the_papers_two_are_named():
    assert list(plan_reward(poses(0), poses(1), np.ones(STEPS, bool)).terms) == [
        "ocp_reward_position",
        "ocp_reward_rotation",
    ]

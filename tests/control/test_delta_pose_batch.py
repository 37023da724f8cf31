import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ocplanner import _core
from ocplanner.errors import InvalidValueError, ShapeError

ENVIRONMENTS, HORIZON = 4, 6


def many_poses(seed: int, *leading: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    count = int(np.prod(leading))
    rotations = Rotation.from_rotvec(rng.normal(size=(count, 3))).as_matrix().reshape(*leading, 3, 3)
    return 0.05 * rng.standard_normal((*leading, 3)), rotations


@pytest.mark.parametrize("follow", ["open-loop", "time", "gated"])
@pytest.mark.parametrize("with_rotation", [True, False])
def test_a_batch_is_its_environments(follow, with_rotation):
    options = {"follow": follow, "gate_position": 0.08, "gate_rotation": 2.0}
    batch = _core.DeltaPoseBatch(ENVIRONMENTS, **options)
    alone = [_core.DeltaPoseController(**options) for _ in range(ENVIRONMENTS)]
    chosen = None
    for seed in (0, 10):
        positions, rotations = many_poses(seed, ENVIRONMENTS, HORIZON)
        here = many_poses(seed + 1, ENVIRONMENTS)
        batch.set_plans(positions, rotations if with_rotation else None, here, chosen)
        for i, controller in enumerate(alone):
            if chosen is None or chosen[i]:
                controller.set_plan(positions[i], rotations[i] if with_rotation else None, (here[0][i], here[1][i]))
        for step in range(2, 5):
            now = many_poses(seed + step, ENVIRONMENTS)
            position, rotation = batch.targets(now)
            for i, controller in enumerate(alone):
                expected = controller.target((now[0][i], now[1][i]))
                np.testing.assert_array_equal(position[i], expected[0])
                np.testing.assert_array_equal(rotation[i], expected[1])
            assert batch.index.tolist() == [controller.index for controller in alone]
            assert batch.at_end.tolist() == [controller.at_end for controller in alone]
        chosen = np.array([True, False, False, True])


def test_bad_input():
    here = many_poses(0, ENVIRONMENTS)
    plans = np.zeros((ENVIRONMENTS, HORIZON, 3))
    batch = _core.DeltaPoseBatch(ENVIRONMENTS)
    with pytest.raises(InvalidValueError, match="environment 0 without a plan"):
        batch.targets(here)
    with pytest.raises(InvalidValueError, match="plan"):
        batch.set_plans(np.full_like(plans, np.nan), None, here)
    for bad in [plans[0], plans[:3], plans[:, :0], plans[..., :2], plans.astype(np.float32)]:
        with pytest.raises(ShapeError, match="plan"):
            batch.set_plans(bad, None, here)
    with pytest.raises(ShapeError, match="plan"):
        batch.set_plans(plans, np.tile(np.eye(3), (ENVIRONMENTS, 1, 1, 1)), here)
    with pytest.raises(ShapeError, match="object"):
        batch.set_plans(plans, None, (here[0][:2], here[1][:2]))
    with pytest.raises(ShapeError, match="chosen"):
        batch.set_plans(plans, None, here, np.ones(3, bool))
    with pytest.raises(ShapeError, match="chosen"):
        batch.set_plans(plans, None, here, np.ones(ENVIRONMENTS))  # type: ignore[arg-type]
    for count in (-1, 1 << 40, 1 << 70):
        with pytest.raises(InvalidValueError, match=r"environments|not a count"):
            _core.DeltaPoseBatch(count)
    with pytest.raises(InvalidValueError, match="follow"):
        _core.DeltaPoseBatch(2, "blind")
    batch.set_plans(plans, None, here)
    with pytest.raises(InvalidValueError, match="object"):
        batch.targets((here[0], 2 * here[1]))

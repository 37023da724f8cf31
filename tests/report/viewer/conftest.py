import numpy as np
import pytest
import trimesh

from ocplanner.report.viewer import Playback


@pytest.fixture
def playback() -> Playback:
    """Forty steps of a box that rises, planned from the second half on."""
    steps = 40
    rising = np.column_stack([np.zeros(steps), np.zeros(steps), np.linspace(0.9, 1.1, steps)])
    return Playback(
        title="Square on Sawyer, gated, seed 10000",
        outcome="success",
        meshes={"box": trimesh.creation.box((0.1, 0.1, 0.1))},
        positions={"box": rising},
        quats_wxyz={"box": np.tile([1.0, 0, 0, 0], (steps, 1))},
        achieved=rising,
        planned=[None] * 20 + [rising[step : step + 5] for step in range(20, 40)],
        phases=["grasp"] * 20 + ["transit"] * 20,
    )

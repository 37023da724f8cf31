"""A labelled copy of the synthetic recordings, whose images are noise and whose planner has random weights."""

from pathlib import Path

import pytest

from ocplanner.planner.planner import Planner
from random_planner import write_random_planner


@pytest.fixture(scope="session")
def noise_planner(tmp_path_factory: pytest.TempPathFactory) -> Planner:
    """Plans 6 poses from images as they are."""
    path: Path = tmp_path_factory.mktemp("noise") / "planner.safetensors"
    write_random_planner(path, observe="full", visual=None, mask_rgb=None)
    return Planner.load(path)

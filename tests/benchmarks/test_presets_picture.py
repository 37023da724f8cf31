"""The picture of the visual presets shows what its header says."""

import sys
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).parent))

from presets_picture import COLUMNS, page, pictures

from ocplanner.envs.visuals import MASK_RGB


def test_a_row_holds_every_camera_in_both_presets_and_the_observations() -> None:
    drawn = dict(zip(COLUMNS, pictures("Panda", 48)))
    assert {camera for camera, *_ in drawn} == {"agentview", "robot0_eye_in_hand"}
    for camera in ("agentview", "robot0_eye_in_hand"):
        stock, fast = (drawn[camera, visual, "full"].astype(float) for visual in ("stock", "fast"))
        assert 0 < np.abs(stock - fast).mean() < 8
    masked = (drawn["agentview", "fast", "masked"] == MASK_RGB).all(-1)
    assert masked.any()
    changed = (drawn["agentview", "fast", "masked"] != drawn["agentview", "fast", "no-robot"]).any(-1)
    np.testing.assert_array_equal(changed, masked)


def test_pictures_stand_under_their_headers() -> None:
    colours = [np.full((20, 20, 3), (200, column, 0), np.uint8) for column in range(len(COLUMNS))]
    image = np.asarray(page({"Panda": colours, "Sawyer": colours}, 20))
    rows, columns = np.nonzero((image == (200, 1, 0)).all(-1))
    assert len(rows) == 2 * 20 * 20
    assert columns.max() - columns.min() == 19

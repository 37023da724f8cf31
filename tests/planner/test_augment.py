import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from ocplanner.planner.augment import augmented, dilated, ellipses, misplaced, observed, paint, silhouettes, to_input
from ocplanner.planner.config import AugmentationConfig
from ocplanner.planner.frames import CameraFrames

RGB = (255, 0, 255)
ROWS = np.arange(16)


@pytest.fixture(scope="module")
def camera() -> CameraFrames:
    rng = np.random.default_rng(0)
    empty = rng.integers(0, 120, size=(16, 84, 84, 3), dtype=np.uint8)
    mask = np.zeros((16, 84, 84), bool)
    mask[:, 20:60, 30:40] = True
    other = np.zeros((16, 2, 84, 84), bool)
    other[:, 0, 25:65, 50:55] = True
    other[8:, 1, 5:20, 5:70] = True
    return CameraFrames(scene=empty, mask=mask, silhouettes=other)


def only(**values) -> AugmentationConfig:
    quiet = dict.fromkeys(
        ("crop_shift", "brightness", "contrast", "channel_gain", "swap", "union", "stray", "blob", "mask_error"), 0
    )
    return AugmentationConfig(**{**quiet, **values})


def test_without_changes_the_batch_is_the_observation(camera, no_augmentation):
    batch = augmented(camera, ROWS, 76, RGB, no_augmentation, np.random.default_rng(0))
    torch.testing.assert_close(batch, to_input(observed(camera, ROWS, RGB), 76), rtol=0, atol=1e-6)


def test_batches_are_channels_last_float32_in_range(camera):
    batch = augmented(camera, ROWS, 76, RGB, AugmentationConfig(), np.random.default_rng(0))
    assert batch.shape == (16, 3, 76, 76)
    assert batch.dtype == torch.float32
    assert batch.is_contiguous(memory_format=torch.channels_last)
    assert 0 <= float(batch.min()) <= float(batch.max()) <= 1


def test_equal_generators_give_equal_batches(camera):
    a, b, c = (augmented(camera, ROWS, 76, RGB, AugmentationConfig(), np.random.default_rng(s)) for s in (1, 1, 2))
    assert torch.equal(a, b)
    assert not torch.equal(a, c)


def test_the_mask_keeps_its_exact_colour_whatever_the_jitter(camera):
    batch = augmented(camera, ROWS, 76, RGB, only(brightness=0.3, contrast=0.3), np.random.default_rng(0))
    painted = (batch == torch.tensor([1.0, 0.0, 1.0])[None, :, None, None]).all(dim=1).numpy()
    assert np.array_equal(painted, camera.mask[:, 4:80, 4:80])


def test_swapping_takes_the_other_arm_where_it_reaches(camera):
    painted, rim = silhouettes(camera.mask, camera.silhouettes, ROWS, only(swap=1.0), np.random.default_rng(0))
    assert not rim.any()
    for i in range(16):
        choices = [camera.silhouettes[i, k] if camera.silhouettes[i, k].any() else camera.mask[i] for k in (0, 1)]
        assert any(np.array_equal(painted[i], choice) for choice in choices)
    assert not np.array_equal(painted, camera.mask)


def test_union_contains_the_source_robot(camera):
    painted, _ = silhouettes(camera.mask, camera.silhouettes, ROWS, only(union=1.0), np.random.default_rng(0))
    assert not (camera.mask & ~painted).any()
    assert painted.sum() > camera.mask.sum()


@pytest.mark.parametrize("change", ["stray", "blob"])
def test_strays_and_blobs_only_add(camera, change):
    painted, rim = silhouettes(camera.mask, camera.silhouettes, ROWS, only(**{change: 1.0}), np.random.default_rng(0))
    assert not (camera.mask & ~painted).any()
    assert painted.sum() > camera.mask.sum()
    assert not rim.any()


def test_a_mask_error_leaves_a_rim_of_robot_colours(camera):
    rng = np.random.default_rng(0)
    painted, rim = silhouettes(camera.mask, camera.silhouettes, ROWS, only(mask_error=3), rng)
    assert rim.any()
    assert np.array_equal(painted | rim, camera.mask | painted)
    batch = augmented(camera, ROWS, 76, RGB, only(mask_error=3), np.random.default_rng(0)).permute(0, 2, 3, 1).numpy()
    scene = to_input(camera.scene, 76).permute(0, 2, 3, 1).numpy()
    inside = rim[:, 4:80, 4:80]
    assert (np.abs(batch - scene).max(axis=-1)[inside] > 1e-3).mean() > 0.9


@given(error=st.integers(0, 3), seed=st.integers(0, 50))
def test_misplaced_masks_stay_within_the_error(error, seed):
    mask = np.zeros((6, 40, 40), bool)
    mask[:, 12:28, 10:30] = True
    result = misplaced(mask, error, np.random.default_rng(seed))
    outer, inner = mask, ~mask
    for _ in range(error):
        outer, inner = dilated(outer), dilated(inner)
    assert not (result & ~outer).any()
    assert not (~result & ~inner).any()


def test_dilation_is_the_eight_neighbourhood():
    mask = np.zeros((1, 7, 7), bool)
    mask[0, 3, 3] = True
    assert np.array_equal(np.argwhere(dilated(mask)[0]).min(axis=0), [2, 2])
    assert dilated(mask).sum() == 9
    corner = np.zeros((1, 4, 4), bool)
    corner[0, 0, 3] = True
    assert dilated(corner).sum() == 4


def test_ellipses_are_blobs():
    shapes = ellipses(200, 84, 84, np.random.default_rng(0))
    assert shapes.shape == (200, 84, 84)
    assert 0 < np.median(shapes.sum(axis=(1, 2))) < 84 * 84 / 8


def test_paint_copies():
    image = np.zeros((1, 2, 2, 3), np.uint8)
    painted = paint(image, np.array([[[True, False], [False, False]]]), (1, 2, 3))
    assert painted[0, 0, 0].tolist() == [1, 2, 3]
    assert not image.any()


def test_plain_images_need_no_mask(no_augmentation):
    image = np.random.default_rng(0).integers(0, 255, size=(4, 84, 84, 3), dtype=np.uint8)
    batch = augmented(CameraFrames(image), np.arange(4), 76, None, no_augmentation, np.random.default_rng(0))
    torch.testing.assert_close(batch, to_input(image, 76), rtol=0, atol=1e-6)

"""From frames to network inputs: a centre crop or, in training, random crops, colours and silhouettes.

All functions work on whole batches and draw from the generator that they are given, so that a step's images depend on
nothing else.
"""

import numpy as np
import torch
from torch import Tensor

from ocplanner.planner.config import AugmentationConfig
from ocplanner.planner.frames import CameraFrames


def to_input(images: np.ndarray, crop: int) -> Tensor:
    """Centre crop of (B, h, w, 3) uint8 as (B, 3, crop, crop) float32 in [0, 1], channels last in memory."""
    top, left = (images.shape[1] - crop) // 2, (images.shape[2] - crop) // 2
    cropped = np.ascontiguousarray(images[:, top : top + crop, left : left + crop])
    return torch.from_numpy(cropped).permute(0, 3, 1, 2).float().div_(255.0)


def observed(camera: CameraFrames, rows: np.ndarray, mask_rgb: tuple[int, int, int] | None) -> np.ndarray:
    """What the planner sees of the source robot: (B, h, w, 3) uint8."""
    if camera.mask is None or mask_rgb is None:
        return camera.scene[rows]
    return paint(camera.scene[rows], camera.mask[rows], mask_rgb)


def paint(images: np.ndarray, mask: np.ndarray, rgb: tuple[int, int, int]) -> np.ndarray:
    """A copy of (B, h, w, 3) images with one colour painted over the masked pixels."""
    return np.where(mask[..., None], np.asarray(rgb, np.uint8), images)


def augmented(
    camera: CameraFrames,
    rows: np.ndarray,
    crop: int,
    mask_rgb: tuple[int, int, int] | None,
    config: AugmentationConfig,
    rng: np.random.Generator,
) -> Tensor:
    """A training batch of one camera: (B, 3, crop, crop) float32 in [0, 1], channels last in memory."""
    height, width = camera.scene.shape[1:3]
    shift = rng.integers(-config.crop_shift, config.crop_shift + 1, size=(len(rows), 2))
    corners = shift + np.array([(height - crop) // 2, (width - crop) // 2])
    colours = _jitter(crop_at(camera.scene[rows], corners, crop), config, rng)
    if camera.mask is not None and mask_rgb is not None:
        painted, rim = silhouettes(camera.mask, camera.silhouettes, rows, config, rng)
        rim = crop_at(rim, corners, crop)
        colours[rim] = _robot_colours(rim, rng)
        colours[crop_at(painted, corners, crop)] = np.asarray(mask_rgb, np.float32) / 255.0
    return torch.from_numpy(colours).permute(0, 3, 1, 2)


def silhouettes(
    masks: np.ndarray,
    others: np.ndarray | None,
    rows: np.ndarray,
    config: AugmentationConfig,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray]:
    """Masks of imagined arms and their errors: two (B, h, w) bool arrays.

    The first array is painted over. The second is the rim of the imagined arm that an imperfect mask leaves uncovered,
    where the arm's own colours show.

    Args:
        masks: (N, h, w) bool, the source robot's pixels in all frames.
        others: (N, K, h, w) bool, other arms' pixels in all frames, all False where out of reach; or None.
        rows: (B,) row numbers of the batch's frames.
        config: probabilities of each change.
        rng: random number generator.
    """
    arm = masks[rows]
    count = len(rows)
    if others is not None:
        other = others[rows, rng.integers(others.shape[1], size=count)]
        reached = other.any(axis=(1, 2))
        choice = rng.random(count)
        swapped = reached & (choice < config.swap)
        arm[swapped] = other[swapped]
        united = reached & (choice >= config.swap) & (choice < config.swap + config.union)
        arm[united] |= other[united]
    stray = rng.random(count) < config.stray
    if stray.any():
        arm[stray] |= _strays(masks, others, int(stray.sum()), rng)
    blob = rng.random(count) < config.blob
    if blob.any():
        arm[blob] |= ellipses(int(blob.sum()), arm.shape[1], arm.shape[2], rng)
    painted = misplaced(arm, config.mask_error, rng)
    return painted, arm & ~painted


def misplaced(mask: np.ndarray, error: int, rng: np.random.Generator) -> np.ndarray:
    """Masks (B, h, w): a third each unchanged, grown or shrunk, and shifted, by up to ``error`` pixels."""
    if error == 0:
        return mask
    count = len(mask)
    fault = rng.integers(3, size=count)
    growth = np.where(fault == 1, rng.integers(-error, error + 1, size=count), 0)
    result = mask.copy()
    for step in range(1, error + 1):
        grow, shrink = growth >= step, growth <= -step
        result[grow] = dilated(result[grow])
        result[shrink] = ~dilated(~result[shrink])
    moved = np.flatnonzero(fault == 2)
    offsets = rng.integers(-error, error + 1, size=(len(moved), 2))
    padded = np.pad(result[moved], ((0, 0), (error, error), (error, error)), mode="edge")
    result[moved] = _windows(padded, offsets + error, mask.shape[1], mask.shape[2])
    return result


def dilated(mask: np.ndarray) -> np.ndarray:
    """(B, h, w) bool masks grown by one pixel to all eight neighbours."""
    rows = mask.copy()
    rows[:, 1:] |= mask[:, :-1]
    rows[:, :-1] |= mask[:, 1:]
    result = rows.copy()
    result[:, :, 1:] |= rows[:, :, :-1]
    result[:, :, :-1] |= rows[:, :, 1:]
    return result


def ellipses(count: int, height: int, width: int, rng: np.random.Generator) -> np.ndarray:
    """(count, h, w) bool masks of one tilted ellipse each, with half-axes of 3 to 14 pixels."""
    centre = rng.uniform(0, 1, size=(count, 2, 1, 1)) * np.array([height, width])[:, None, None]
    axes = rng.uniform(3, 14, size=(count, 2, 1, 1))
    angle = rng.uniform(0, np.pi, size=(count, 1, 1))
    y, x = np.mgrid[:height, :width].astype(np.float32)
    dy, dx = y - centre[:, 0], x - centre[:, 1]
    along, across = dx * np.cos(angle) + dy * np.sin(angle), dy * np.cos(angle) - dx * np.sin(angle)
    return (along / axes[:, 0]) ** 2 + (across / axes[:, 1]) ** 2 <= 1


def crop_at(images: np.ndarray, corners: np.ndarray, crop: int) -> np.ndarray:
    """Square windows of (B, h, w, ...) arrays at (B, 2) top-left corners: (B, crop, crop, ...)."""
    return _windows(images, corners, crop, crop)


def _windows(images: np.ndarray, corners: np.ndarray, height: int, width: int) -> np.ndarray:
    result = np.empty((len(images), height, width, *images.shape[3:]), images.dtype)
    for target, image, (top, left) in zip(result, images, corners):
        target[...] = image[top : top + height, left : left + width]
    return result


def _strays(masks: np.ndarray, others: np.ndarray | None, count: int, rng: np.random.Generator) -> np.ndarray:
    rows = rng.integers(len(masks), size=count)
    shape = masks[rows]
    if others is not None:
        other = others[rows, rng.integers(others.shape[1], size=count)]
        use = other.any(axis=(1, 2)) & (rng.random(count) < 0.5)
        shape[use] = other[use]
    mirrored = rng.random(count) < 0.5
    shape[mirrored] = shape[mirrored, :, ::-1]
    height, width = shape.shape[1:]
    reach = min(height, width) // 4
    padded = np.pad(shape, ((0, 0), (reach, reach), (reach, reach)))
    return _windows(padded, rng.integers(0, 2 * reach + 1, size=(count, 2)), height, width)


def _jitter(images: np.ndarray, config: AugmentationConfig, rng: np.random.Generator) -> np.ndarray:
    count = len(images)
    brightness = rng.uniform(-config.brightness, config.brightness, size=(count, 1, 1, 1))
    contrast = 1 + rng.uniform(-config.contrast, config.contrast, size=(count, 1, 1, 1))
    gain = 1 + rng.uniform(-config.channel_gain, config.channel_gain, size=(count, 1, 1, 3))
    scale = (contrast * gain / 255.0).astype(np.float32)
    offset = ((brightness + 0.5 * (1 - contrast)) * gain).astype(np.float32)
    result = images.astype(np.float32)
    result *= scale
    result += offset
    return np.clip(result, 0.0, 1.0, out=result)


def _robot_colours(rim: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Colours of the true pixels of (B, h, w): one light, dark or reddish grey an image, shaded from pixel to pixel."""
    count = len(rim)
    base = rng.uniform(0, 1, size=(count, 1)) + rng.normal(0, 0.05, size=(count, 3))
    base[:, 0] += np.where(rng.random(count) < 0.3, rng.uniform(0, 0.5, size=count), 0.0)
    owner = np.nonzero(rim)[0]
    shade = rng.normal(0, 0.08, size=(len(owner), 1))
    return np.clip(base[owner] + shade, 0, 1).astype(np.float32)

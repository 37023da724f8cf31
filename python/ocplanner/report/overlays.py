"""Plans drawn over camera images: Figures 5, 6 and 8 of the paper.

Pixels are (x, y), counted from the upper left corner of the image.
"""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ocplanner.drawing.style import ACHIEVED, PLANNED, new_figure, styled
from ocplanner.errors import ShapeError

_OUTLINE = "#10151c"
_ROOM, _SMALLEST_SHARE = 1.8, 0.3
"""A window is this many times as wide as the trajectories' extent, but at least this share of the image."""


def plan_grid(
    images: Sequence[np.ndarray],
    planned: Sequence[np.ndarray],
    true: Sequence[np.ndarray],
    *,
    titles: Sequence[str] | None = None,
    columns: int = 4,
    title: str = "",
) -> Figure:
    """Figures 5 and 6: planned trajectories as red dots, true ones in cyan, over images of the planned moments.

    All images are cut to windows of one size around the trajectories, so that short plans are as visible as long ones.
    Plans of few steps get larger dots.

    Args:
        images: each (h, w, 3) uint8, upright.
        planned: for each image, (H, 2) pixels of the planned object positions.
        true: for each image, (H, 2) pixels of the positions in the demonstration.
        titles: one short line above each image.
        columns: images in a row.
        title: title of the whole grid.

    Raises:
        ShapeError: the lists differ in length, are empty, or an element has another shape.
    """
    if not len(images) or not len(images) == len(planned) == len(true) == len(titles or images):
        raise ShapeError("plan_grid: images, planned, true and titles must have one equal length of at least 1")
    columns = min(columns, len(images))
    rows = -(-len(images) // columns)
    with styled():
        height, width = np.shape(images[0])[:2]
        figure = new_figure(
            7.4, (7.4 / columns * height / width + (0.1 if titles else 0)) * rows + (0.5 if title else 0.3)
        )
        grid = np.atleast_1d(figure.subplots(rows, columns, squeeze=False)).ravel()
        for axes in grid[len(images) :]:
            axes.set_axis_off()
        paths = [(_pixels(true[i], "true"), _pixels(planned[i], "planned")) for i in range(len(images))]
        share = max(_share(np.concatenate(pair), width, height) for pair in paths)
        for i, (axes, image) in enumerate(zip(grid, images)):
            show_image(axes, image)
            _look_at(axes, np.concatenate(paths[i]), share, width, height)
            dot = max(1.9, 9 / np.sqrt(max(1, len(paths[i][1]))))
            _path(axes, paths[i][0], ACHIEVED, "true", "o-", 1.6, 0.85 * dot)
            _path(axes, paths[i][1], PLANNED, "planned", "o", 0, dot)
            if titles:
                axes.set_title(titles[i], fontsize=7.5, fontweight="normal", pad=3)
        handles, labels = grid[0].get_legend_handles_labels()
        figure.legend(handles[::-1], labels[::-1], loc="outside lower center", ncols=2, markerscale=2.5)
        if title:
            figure.suptitle(title, x=0.01, ha="left", fontsize=9.5, fontweight="bold")
    return figure


def film_strip(
    frames: Sequence[np.ndarray],
    *,
    count: int = 8,
    columns: int | None = None,
    titles: Sequence[str] | None = None,
    title: str = "",
) -> Figure:
    """Figure 8: ``count`` frames of a run, evenly spaced from the first to the last.

    Args:
        frames: (T, h, w, 3) uint8, upright.
        count: number of frames to show; all if there are fewer.
        columns: frames in a row; by default all frames.
        titles: one short line for each of ``frames`` (not only those shown).
        title: title of the strip.

    Raises:
        ShapeError: no frames, or titles of another length.
    """
    if not len(frames) or (titles is not None and len(titles) != len(frames)):
        raise ShapeError("film_strip: need at least one frame, and one title a frame if any")
    chosen = evenly_spaced(len(frames), count)
    columns = min(columns or len(chosen), len(chosen))
    rows = -(-len(chosen) // columns)
    height, width = np.shape(frames[0])[:2]
    with styled():
        label = 0.2 if titles else 0.04
        figure = new_figure(9.6, (9.6 / columns * height / width + label) * rows + (0.3 if title else 0.05))
        grid = np.atleast_1d(figure.subplots(rows, columns, squeeze=False)).ravel()
        for axes in grid:
            axes.set_axis_off()
        for axes, index in zip(grid, chosen):
            show_image(axes, frames[index])
            if titles:
                axes.set_title(titles[index], fontsize=7.5, fontweight="normal", pad=3)
        if title:
            figure.suptitle(title, x=0.01, ha="left", fontsize=9.5, fontweight="bold")
    return figure


def evenly_spaced(length: int, count: int) -> np.ndarray:
    """At most ``count`` indices from 0 to ``length - 1``, both included."""
    return np.unique(np.linspace(0, length - 1, min(count, length)).round().astype(int))


def show_image(axes: Axes, image: np.ndarray) -> None:
    """Fill ``axes`` with an image (h, w, 3) uint8, in its own pixel coordinates and without a frame.

    Raises:
        ShapeError: the array is no such image.
    """
    image = np.asarray(image)
    if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8:
        raise ShapeError(f"image: expected (h, w, 3) uint8, found {image.shape} {image.dtype}")
    height, width = image.shape[:2]
    axes.imshow(image, extent=(0, width, height, 0), interpolation="lanczos" if width < 200 else "antialiased")
    axes.set(xlim=(0, width), ylim=(height, 0))
    axes.set_axis_off()


def _pixels(path: np.ndarray, label: str) -> np.ndarray:
    pixels = np.asarray(path, dtype=np.float64)
    if pixels.ndim != 2 or pixels.shape[1] != 2:
        raise ShapeError(f"{label}: expected (H, 2) pixels, found {pixels.shape}")
    return pixels


def _share(pixels: np.ndarray, width: int, height: int) -> float:
    """The share of an image's sides, at most 1, that a window around these pixels (n, 2) needs."""
    seen = pixels[np.isfinite(pixels).all(axis=1)]
    extent = np.ptp(seen, axis=0) / (width, height) if len(seen) else np.zeros(2)
    return float(np.clip(_ROOM * extent.max(), _SMALLEST_SHARE, 1.0))


def _look_at(axes: Axes, pixels: np.ndarray, share: float, width: int, height: int) -> None:
    """Cut the view to ``share`` of the image's sides, centred on the pixels (n, 2) as far as the image allows."""
    seen = pixels[np.isfinite(pixels).all(axis=1)]
    full = np.array([width, height], dtype=np.float64)
    centre = (seen.min(axis=0) + seen.max(axis=0)) / 2 if len(seen) else full / 2
    left, top = np.clip(centre - share * full / 2, 0, full - share * full)
    axes.set(xlim=(left, left + share * width), ylim=(top + share * height, top))


def _path(axes: Axes, pixels: np.ndarray, color: str, label: str, marks: str, line: float, size: float) -> None:
    edge = {"markeredgecolor": _OUTLINE, "markeredgewidth": 0.25}
    axes.plot(pixels[:, 0], pixels[:, 1], marks, color=color, markersize=size, linewidth=line, label=label, **edge)

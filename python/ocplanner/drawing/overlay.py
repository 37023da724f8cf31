"""Draw paths and a caption bar into a frame of a video, with Pillow.

Pixels are (x, y), counted from the upper left corner of the image.
"""

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import matplotlib as mpl
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from ocplanner.drawing.style import ACHIEVED, GOOD, PLANNED
from ocplanner.errors import ShapeError

_SMOOTHING = 3
_BAR = (16, 21, 28)
_TEXT = (230, 237, 243)
_DIM = (152, 164, 179)


@dataclass(frozen=True)
class Caption:
    """The bar under a frame.

    Attributes:
        title: on the left, bold.
        note: beside the title, dim.
        text: on the right.
        verdict: at the right end, bold.
        color: of the verdict, such as :data:`ocplanner.drawing.style.GOOD`.
    """

    title: str
    note: str = ""
    text: str = ""
    verdict: str = ""
    color: str = GOOD


def draw_paths(image: np.ndarray, planned: np.ndarray | None, achieved: np.ndarray | None) -> np.ndarray:
    """A copy of ``image`` with the planned path as red dots and the achieved one as a cyan line that ends in a ring.

    Args:
        image: (h, w, 3) uint8.
        planned: (H, 2) pixels, or None.
        achieved: (T, 2) pixels up to now, or None. Points that are not finite are left out of both.

    Raises:
        ShapeError: an array has another shape.
    """
    height, width = _checked(image).shape[:2]
    layer = Image.new("RGBA", (width * _SMOOTHING, height * _SMOOTHING))
    draw = ImageDraw.Draw(layer)
    unit = max(width, height) / 320 * _SMOOTHING
    trail = _points(achieved, "achieved")
    if len(trail) > 1:
        draw.line([tuple(point) for point in trail], fill=(*_BAR, 150), width=round(3.6 * unit), joint="curve")
        draw.line([tuple(point) for point in trail], fill=ACHIEVED, width=round(2.0 * unit), joint="curve")
    dots = _points(planned, "planned")
    size = unit * min(1.6, max(1.0, (20 / max(1, len(dots))) ** 0.5))  # a plan of few steps would be a speck
    for point in dots:
        _dot(draw, point, 3.0 * size, _BAR)
    for point in dots:
        _dot(draw, point, 2.3 * size, PLANNED)
    if len(trail):
        _ring(draw, trail[-1], 5.0 * unit, round(2.0 * unit))
    layer = layer.resize((width, height), Image.Resampling.BOX)
    return np.asarray(Image.alpha_composite(Image.fromarray(image).convert("RGBA"), layer).convert("RGB"))


def draw_caption(image: np.ndarray, caption: Caption) -> np.ndarray:
    """``image`` (h, w, 3) uint8 with the caption's bar below it."""
    width = _checked(image).shape[1]
    size = max(10, round(width / 27))
    bar = Image.new("RGB", (width, caption_height(width)), _BAR)
    draw = ImageDraw.Draw(bar)
    margin, middle = round(size * 0.7), bar.height // 2
    draw.text((margin, middle), caption.title, font=_font(size, bold=True), fill=_TEXT, anchor="lm")
    used = margin + draw.textlength(caption.title, font=_font(size, bold=True))
    draw.text((used + size * 0.6, middle), caption.note, font=_font(size), fill=_DIM, anchor="lm")
    right = width - margin
    if caption.verdict:
        draw.text((right, middle), caption.verdict, font=_font(size, bold=True), fill=caption.color, anchor="rm")
        right -= round(draw.textlength(caption.verdict, font=_font(size, bold=True)) + size * 0.6)
    draw.text((right, middle), caption.text, font=_font(size), fill=_TEXT, anchor="rm")
    return np.concatenate([image, np.asarray(bar)])


def caption_height(width: int) -> int:
    """Height in pixels of the bar under a frame of ``width``; even, as H.264 with 4:2:0 colour needs."""
    return 2 * round(max(10, round(width / 27)) * 0.95)


def enlarge(image: np.ndarray, shortest: int) -> tuple[np.ndarray, float]:
    """``image`` scaled up to at least ``shortest`` pixels on its shorter side, with even sides; and the factor."""
    height, width = _checked(image).shape[:2]
    factor = max(1.0, shortest / min(height, width))
    size = 2 * round(width * factor / 2), 2 * round(height * factor / 2)
    if size == (width, height):
        return image, 1.0
    return np.asarray(Image.fromarray(image).resize(size, Image.Resampling.BICUBIC)), factor


def _checked(image: np.ndarray) -> np.ndarray:
    if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8:
        raise ShapeError(f"image: expected (h, w, 3) uint8, found {image.shape} {image.dtype}")
    return image


def _points(pixels: np.ndarray | None, name: str) -> np.ndarray:
    if pixels is None:
        return np.zeros((0, 2))
    pixels = np.asarray(pixels, dtype=np.float64)
    if pixels.ndim != 2 or pixels.shape[1] != 2:
        raise ShapeError(f"{name}: expected (n, 2) pixels, found {pixels.shape}")
    return pixels[np.isfinite(pixels).all(axis=1)] * _SMOOTHING


def _dot(draw: ImageDraw.ImageDraw, center: np.ndarray, radius: float, color: str | tuple[int, int, int]) -> None:
    draw.ellipse((*(center - radius), *(center + radius)), fill=color)


def _ring(draw: ImageDraw.ImageDraw, center: np.ndarray, radius: float, width: int) -> None:
    draw.ellipse((*(center - radius), *(center + radius)), outline=ACHIEVED, width=width)


@cache
def _font(size: int, *, bold: bool = False) -> ImageFont.FreeTypeFont:
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(str(Path(mpl.get_data_path()) / "fonts" / "ttf" / name), size)

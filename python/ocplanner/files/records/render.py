"""How ``ocplanner render`` drew the images of a data set: the attribute ``ocplanner_render`` of its ``data``."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from ocplanner.settings import build, to_dict

RENDER_ATTRIBUTE = "ocplanner_render"


@dataclass(frozen=True)
class RenderRecord:
    """The settings that images were drawn with, and what they were drawn by. A file may leave out any of them.

    Attributes:
        observe: what the images show of the robot.
        cameras: that were drawn.
        size: width and height, pixels; None if the file does not say.
        visual: the visual preset; None if the file does not say.
        silhouettes: other arms whose masks were added, in their order along the array's second axis.
        silhouette_stride: every how many frames they were drawn.
        frames: whether all frames were drawn, or only those in which an object is manipulated; the others are black.
        mask_rgb: the colour of the robot's pixels, 0 to 255; None if the file does not say.
        versions: installed packages at rendering.
    """

    observe: Literal["full", "masked", "no-robot"] = "full"
    cameras: tuple[str, ...] = ()
    size: int | None = None
    visual: str | None = None
    silhouettes: tuple[str, ...] = ()
    silhouette_stride: int = 1
    frames: Literal["all", "manipulation"] = "all"
    mask_rgb: tuple[int, int, int] | None = None
    versions: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def from_json(cls, text: str) -> "RenderRecord":
        """Read the attribute.

        Raises:
            ValueError: it is no JSON, or a value in it is not what it should be; the message names it.
        """
        return build(cls, json.loads(text), ignore_unknown=True)

    def to_json(self) -> str:
        """Write the attribute."""
        return json.dumps(to_dict(self), sort_keys=True)

"""What a picture shows of the robot, and how much of the scene is drawn. Loads no simulator.

The preset ``stock`` is robosuite's own picture. ``fast`` leaves out what an 84x84 picture hardly shows (shadows,
reflections, multisampling, end-effector markers, most of the triangles) and is several times cheaper in software
rendering. A planner must see the preset that it was trained on, so rendered data sets and planner files record it.
"""

from dataclasses import dataclass
from typing import Literal, get_args

from ocplanner.errors import UnknownNameError

Observe = Literal["full", "masked", "no-robot"]
"""``full``: everything. ``masked``: the robot in one colour wherever it is seen. ``no-robot``: the robot left out."""

OBSERVE_MODES: tuple[str, ...] = get_args(Observe)

Visual = Literal["fast", "stock"]
"""Names of the visual presets."""

MASK_MATERIAL = "ocplanner_robot_mask"
MASK_RGB = (255, 0, 255)
"""Colour of masked pixels. Each channel is 0 or 255, so that light added to the emissive surface cannot change it."""


@dataclass(frozen=True)
class VisualPreset:
    """How much is drawn.

    Attributes:
        name: by which it is chosen.
        simplify: replace visual meshes by ones of few triangles.
        shadows: draw shadows.
        reflections: draw mirror images in reflective surfaces.
        multisamples: samples a pixel; 0 switches antialiasing off.
        markers: draw MuJoCo's sites, as robosuite does.
    """

    name: Visual
    simplify: bool
    shadows: bool
    reflections: bool
    multisamples: int
    markers: bool

    @property
    def local(self) -> bool:
        """Whether each pixel depends only on the surface it shows, so that a flat robot leaves all others unchanged."""
        return not (self.shadows or self.reflections or self.multisamples)


PRESETS: dict[str, VisualPreset] = {
    preset.name: preset
    for preset in (
        VisualPreset("fast", simplify=True, shadows=False, reflections=False, multisamples=0, markers=False),
        VisualPreset("stock", simplify=False, shadows=True, reflections=True, multisamples=4, markers=True),
    )
}


def visual_preset(name: str) -> VisualPreset:
    """The preset called ``name``.

    Raises:
        UnknownNameError: there is none.
    """
    if name not in PRESETS:
        raise UnknownNameError("visual preset", name, PRESETS)
    return PRESETS[name]

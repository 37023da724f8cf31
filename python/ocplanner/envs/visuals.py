"""Visual presets: what a picture may cost.

``stock`` is robosuite's own picture. ``fast`` leaves out what an 84x84 picture hardly shows (shadows, reflections,
multisampling, end-effector markers, most of the triangles) and is several times cheaper in software rendering.
A planner must see the preset that it was trained on, so the preset is recorded wherever pictures or weights are.
"""

import xml.etree.ElementTree as ET
from dataclasses import dataclass

from ocplanner.envs.meshes import simplify_visual_meshes
from ocplanner.errors import UnknownNameError

MASK_MATERIAL = "ocplanner_robot_mask"
MASK_RGB = (255, 0, 255)
"""Colour of masked pixels. Each channel is 0 or 255: light added to an emissive surface then cannot change it."""


@dataclass(frozen=True)
class VisualPreset:
    """How much is drawn.

    Attributes:
        name: ``"fast"`` or ``"stock"``.
        simplify: replace visual meshes by ones of few triangles.
        shadows: draw shadows.
        reflections: draw mirror images in reflective surfaces.
        multisamples: samples a pixel; 0 switches antialiasing off.
        markers: draw MuJoCo's sites, as robosuite does.
    """

    name: str
    simplify: bool
    shadows: bool
    reflections: bool
    multisamples: int
    markers: bool

    @property
    def local(self) -> bool:
        """Whether a pixel depends on the surface it shows alone, so that a flat robot leaves all others unchanged."""
        return not (self.shadows or self.reflections or self.multisamples)


PRESETS = {
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


def prepare_visuals(root: ET.Element, preset: VisualPreset) -> None:
    """Add the flat material of the robot mask to a model's XML and simplify its meshes; physics is untouched."""
    asset = root.find("asset")
    if asset is None:
        asset = ET.SubElement(root, "asset")
    rgba = " ".join(str(channel / 255) for channel in MASK_RGB)
    ET.SubElement(
        asset,
        "material",
        name=MASK_MATERIAL,
        rgba=f"{rgba} 1",
        emission="1",
        specular="0",
        shininess="0",
        reflectance="0",
    )
    if preset.simplify:
        simplify_visual_meshes(root)

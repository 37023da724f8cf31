"""Named corrections of robosuite's models, applied to the model's XML before it is compiled."""

import re
import xml.etree.ElementTree as ET
from collections.abc import Callable

from ocplanner.errors import UnknownNameError


def _sawyer_base_contact(root: ET.Element) -> None:
    """Exclude the contact of Sawyer's base sphere with its first link, which brakes joint 1 with up to 17 Nm.

    A contact exclusion names bodies, not geoms; these two bodies have no other colliding geoms.
    """
    bodies = {geom.get("name", ""): body.get("name", "") for body in root.iter("body") for geom in body.findall("geom")}
    contact = root.find("contact")
    if contact is None:
        contact = ET.SubElement(root, "contact")
    bases = [name for name in bodies if re.fullmatch(r"robot\d+_base_col", name)]
    for base in bases:
        robot = base.removesuffix("base_col")
        ET.SubElement(
            contact,
            "exclude",
            name=f"{robot}sawyer-base-contact",
            body1=bodies[base],
            body2=bodies[f"{robot}link0_collision"],
        )


PATCHES: dict[str, Callable[[ET.Element], None]] = {"sawyer-base-contact": _sawyer_base_contact}


def check_patches(names: tuple[str, ...]) -> None:
    """Check the names of patches.

    Raises:
        UnknownNameError: no patch has one of these names.
    """
    for name in names:
        if name not in PATCHES:
            raise UnknownNameError("patch", name, PATCHES)


def apply_patches(root: ET.Element, names: tuple[str, ...]) -> None:
    """Change the model's XML tree in place."""
    for name in names:
        PATCHES[name](root)

"""Building a robosuite environment: its model patched, its visuals prepared, and nothing drawn by robosuite."""

import xml.etree.ElementTree as ET
from typing import Any

from ocplanner.envs.meshes import simplify_visual_meshes
from ocplanner.envs.patches import apply_patches
from ocplanner.envs.robots import RobotSpec
from ocplanner.envs.simulator import robosuite
from ocplanner.envs.tasks import Task
from ocplanner.envs.visuals import MASK_MATERIAL, MASK_RGB, VisualPreset

REGISTERED_ENVS = robosuite.environments.base.REGISTERED_ENVS
_ENDLESS = 2**31


def build_robosuite_env(
    task: Task, robot: RobotSpec, preset: VisualPreset, patches: tuple[str, ...], seed: int, control_freq: float
) -> Any:
    """A robosuite environment that never ends an episode itself and resets without rebuilding its model."""

    def edit(xml: str) -> str:
        root = ET.fromstring(xml)  # noqa: S314 - robosuite made it
        apply_patches(root, patches)
        _prepare_visuals(root, preset)
        return ET.tostring(root, encoding="unicode")

    environment = _with_model_edit(REGISTERED_ENVS[task.env_name], edit)
    return environment(
        robots=[robot.name] * task.arms,
        has_renderer=False,
        has_offscreen_renderer=False,
        use_camera_obs=False,
        use_object_obs=True,
        control_freq=control_freq,
        ignore_done=True,
        horizon=_ENDLESS,
        hard_reset=False,
        seed=seed,
    )


def _prepare_visuals(root: ET.Element, preset: VisualPreset) -> None:
    """Add the flat material of the robot's mask to a model's XML and simplify its visual meshes, not its physics."""
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


def _with_model_edit(base: Any, edit: Any) -> Any:
    """The environment class with an XML processor that already runs when the model is first compiled.

    ``set_xml_processor`` is too late: the constructor has compiled the model by then, and a rebuild would invalidate
    the references that it took.
    """

    def initialize(self: Any, xml_string: str | None = None) -> None:
        if edit not in self._xml_processors:
            self.set_xml_processor(edit)
        base._initialize_sim(self, xml_string)

    edited = type(base)(f"Edited{base.__name__}", (base,), {"_initialize_sim": initialize})
    REGISTERED_ENVS.pop(edited.__name__)  # robosuite's metaclass registers every class
    return edited

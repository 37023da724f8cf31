"""The MuJoCo model that a recording was made with, compared with the simulated one and taken over where it may differ.

robosuite draws new sizes of some objects (the cube of Lift) for each recording and stores the model beside the states.
"""

import re
import xml.etree.ElementTree as ET
from typing import Any, NamedTuple

import numpy as np

from ocplanner.envs.environment import ManipulationEnv
from ocplanner.envs.simulator import mujoco
from ocplanner.errors import DatasetError, MismatchError

_PREFIX = re.compile(r"^(robot|gripper)\d+_(right_|left_)?")
_SAME_M = 1e-3
_SPHERE, _CAPSULE, _CYLINDER, _BOX = "sphere", "capsule", "cylinder", "box"
_EXTENTS = {_SPHERE: 1, _CAPSULE: 2, _CYLINDER: 2, _BOX: 3}
"""How many numbers say the size of a geom that is no mesh."""


class _Geom(NamedTuple):
    kind: str
    size: tuple[float, ...]
    mesh: tuple[float, ...] | None


class RecordedModel:
    """What a recording's ``model_file`` says about the scene.

    Args:
        xml: the text of ``model_file``. Nothing that it refers to is read.

    Raises:
        DatasetError: it is not the XML of a MuJoCo model.
    """

    def __init__(self, xml: str) -> None:
        if "<!" in xml.replace("<!--", ""):
            raise DatasetError("model_file declares a document type, which no MuJoCo model needs; record it again")
        try:
            root = ET.fromstring(xml.lstrip("\ufeff \t\r\n"))  # noqa: S314 - without a document type it has no entities
        except ET.ParseError as error:
            raise DatasetError(f"model_file is not XML ({error}); record it again") from error
        world = root.find("worldbody")
        if root.tag != "mujoco":
            raise DatasetError(f"model_file is a {root.tag}, not a MuJoCo model; record it again")
        if world is None:
            world = ET.Element("worldbody")
        self._scales = {mesh.get("name", ""): _numbers(mesh.get("scale", "1 1 1"), 3) for mesh in root.iter("mesh")}
        self._bodies = {body.get("name", ""): body for body in world.iter("body")}
        self._fixed = [body for body in world.findall("body") if not _joints(body)]

    def joints(self, prefix: str) -> frozenset[str]:
        """Names of the joints of all arms (``robot``) or grippers (``gripper``), without robosuite's prefixes."""
        found = (joint for body in self._bodies.values() for joint in _joints(body))
        return frozenset(_PREFIX.sub("", name) for name in found if re.match(rf"{prefix}\d+_", name))

    def geoms(self, joint: str) -> dict[str, _Geom]:
        """The geoms of the object with this free joint, by name; empty if there is none."""
        body = next((body for body in self._bodies.values() if joint in _joints(body)), None)
        found = {}
        for geom in () if body is None else body.iter("geom"):
            kind, mesh = geom.get("type", _SPHERE), geom.get("mesh")
            scale = self._scales.get(mesh, (1.0, 1.0, 1.0)) if mesh else None
            extents = _EXTENTS.get(kind, 0)
            size = () if mesh or not geom.get("size") else _numbers(geom.get("size", ""), extents)[:extents]
            if any(extent <= 0 for extent in size):
                raise DatasetError(f"model_file gives a geom the size {geom.get('size')!r}; record it again")
            found[geom.get("name", "")] = _Geom("mesh" if mesh else kind, size, scale)
        return found

    def places(self) -> dict[str, np.ndarray]:
        """(3,) positions of the bodies that stand still in the world, metres, by name."""
        return {body.get("name", ""): np.array(_numbers(body.get("pos", "0 0 0"), 3)[:3]) for body in self._fixed}


class RecordedModels:
    """Takes over the models of recordings into one environment, one after the other.

    Args:
        env: the environment.
    """

    def __init__(self, env: ManipulationEnv) -> None:
        self._env = env
        self._own = RecordedModel(env.robosuite_env.model.get_xml())
        self._sizes, self._bounds = env.model.geom_size.copy(), env.model.geom_rbound.copy()

    def take_over(self, xml: str | None, *, other_arm: bool = False) -> None:
        """Give the task's objects the recorded sizes, or their own if no model was recorded.

        Args:
            xml: the recorded ``model_file``; text that is no XML (robosuite 1.0 stored a file's name) says nothing.
            other_arm: whether the environment has another arm than the recording, so that arms are not compared.

        Raises:
            DatasetError: the XML is damaged.
            MismatchError: arm, gripper or scene are other ones than those simulated.
        """
        model = self._env.model
        model.geom_size[:], model.geom_rbound[:] = self._sizes, self._bounds
        if xml is None or not xml.lstrip("\ufeff \t\r\n").startswith("<"):
            return
        recorded = RecordedModel(xml)
        if not other_arm:
            self._check_parts(recorded)
            self._check_places(recorded)
        for spec in self._env.task.objects:
            own = self._own.geoms(spec.joint)
            for name, geom in recorded.geoms(spec.joint).items():
                if name not in own:
                    continue
                if geom[0] != own[name][0] or geom[2] != own[name][2]:
                    raise MismatchError(
                        f"model_file gives {spec.name} a {_shape(geom)}, the simulated one has a {_shape(own[name])} "
                        f"(geom {name}); record the task with the installed robosuite's object"
                    )
                if geom.size:
                    self._resize(name, geom)

    def _check_parts(self, recorded: RecordedModel) -> None:
        robot = self._env.robot.name
        for prefix, what in (("robot", "arm"), ("gripper", "gripper")):
            theirs, ours = recorded.joints(prefix), self._own.joints(prefix)
            if theirs and theirs != ours:
                raise MismatchError(
                    f"model_file has the {what} joints {', '.join(sorted(theirs))}, but {robot} is simulated with "
                    f"{', '.join(sorted(ours))}; "
                    + (
                        "correct `robots` in env_args"
                        if prefix == "robot"
                        else "each arm is drawn with its default gripper only: record with that one"
                    )
                )

    def _check_places(self, recorded: RecordedModel) -> None:
        own = self._own.places()
        for name, place in recorded.places().items():
            if name in own and not name.startswith("gripper"):
                off = float(np.linalg.norm(place - own[name]))
                if off > _SAME_M:
                    raise MismatchError(
                        f"model_file has {name} at {_point(place)}, the simulated scene at {_point(own[name])}, "
                        f"{100 * off:.1f} cm apart; record the task with the installed robosuite's scene"
                    )

    def _resize(self, name: str, geom: _Geom) -> None:
        model = self._env.model
        number = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, name)
        if number < 0:
            return
        size = model.geom_size[number].copy()
        size[: len(geom.size)] = geom.size
        if np.array_equal(size, model.geom_size[number]):
            return
        model.geom_size[number] = size
        model.geom_rbound[number] = _radius(geom.kind, size)


def _joints(body: ET.Element) -> list[str]:
    """Names of a body's own joints."""
    return [joint.get("name", "") for tag in ("joint", "freejoint") for joint in body.findall(tag)]


def _numbers(text: str, fewest: int) -> tuple[float, ...]:
    try:
        found = tuple(float(number) for number in text.split())
    except ValueError:
        found = ()
    if len(found) < fewest or not np.isfinite(found).all():
        raise DatasetError(f"model_file has {text!r} where {fewest} numbers belong; record it again")
    return found


def _radius(kind: str, size: np.ndarray) -> float:
    """Of the sphere around a geom, metres."""
    if kind == _BOX:
        return float(np.linalg.norm(size))
    if kind == _CYLINDER:
        return float(np.hypot(size[0], size[1]))
    return float(size[0] + size[1]) if kind == _CAPSULE else float(size.max())


def _shape(geom: Any) -> str:
    return f"mesh scaled by {geom.mesh}" if geom.mesh else geom.kind


def _point(place: np.ndarray) -> str:
    return "(" + ", ".join(f"{number:.3f}" for number in place) + ")"

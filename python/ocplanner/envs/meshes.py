"""Simplified copies of visual meshes, cached on disk under a hash of their source."""

import hashlib
import importlib.metadata
import os
import tempfile
import xml.etree.ElementTree as ET
from pathlib import Path

import fast_simplification
import numpy as np
import trimesh

from ocplanner.envs.simulator import mujoco

_MIN_TRIANGLES = 300
_MAX_TRIANGLES = 4000
_KEPT_FRACTION = 0.1
_AGGRESSION = 3  # the library's default of 7 destroys rails and fingers
_SUFFIX = "_simplified"
_VERSION = b"ocplanner mesh 2"


def cache_folder() -> Path:
    """The cache of simplified meshes: ``$XDG_CACHE_HOME/ocplanner`` or ``~/.cache/ocplanner``."""
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "ocplanner"


def simplify_visual_meshes(root: ET.Element) -> None:
    """Replace the meshes of visual geoms by simplified copies.

    A geom keeps its mesh if it collides, if an image is mapped onto it, or if the mesh is small.
    """
    asset = root.find("asset")
    if asset is None:
        return
    meshes = {mesh.get("name", ""): mesh for mesh in asset.findall("mesh")}
    wrapped = _image_mapped_materials(asset)
    for geom in root.iter("geom"):
        mesh = meshes.get(geom.get("mesh", ""))
        if mesh is None or geom.get("material") in wrapped:
            continue
        if geom.get("contype", "1") == "0" and geom.get("conaffinity", "1") == "0":
            geom.set("mesh", _simplified_asset(asset, meshes, mesh))


def _simplified_asset(asset: ET.Element, meshes: dict[str, ET.Element], mesh: ET.Element) -> str:
    """Name of the simplified copy of a mesh asset, which is added if needed; its own name if it stays as it is."""
    name, path = mesh.get("name", ""), Path(mesh.get("file", ""))
    twin = f"{name}{_SUFFIX}"
    if twin not in meshes:
        if name.endswith(_SUFFIX) or path.suffix.lower() not in {".obj", ".stl"} or not path.is_file():
            return name
        copy = simplified(path)
        if copy == path:
            return name
        meshes[twin] = ET.SubElement(asset, "mesh", {**mesh.attrib, "name": twin, "file": str(copy)})
    return twin


def simplified(path: Path) -> Path:
    """The simplified copy of a mesh file, made on first use; the file itself if it stays as it is."""
    version = importlib.metadata.version("fast-simplification").encode()
    key = hashlib.sha256(b"\0".join((_VERSION, version, path.read_bytes()))).hexdigest()[:32]
    cached = cache_folder() / "meshes" / f"{key}.stl"
    if cached.exists():
        return cached if cached.stat().st_size else path
    content = _simplify(path)
    try:
        cached.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=cached.parent, suffix=".tmp", delete=False) as file:
            file.write(content)
        Path(file.name).replace(cached)
    except OSError:
        return path  # no room for a cache: the image is slower to draw, not wrong
    return cached if content else path


def _simplify(path: Path) -> bytes:
    """A binary STL; empty if the mesh is small already or simplification fails."""
    mesh = trimesh.load_mesh(path, process=False)
    if not isinstance(mesh, trimesh.Trimesh) or len(mesh.faces) <= _MIN_TRIANGLES:
        return b""
    # Seams of texture coordinates and normals split vertices; simplification would tear the surface along them.
    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    target = int(np.clip(_KEPT_FRACTION * len(mesh.faces), _MIN_TRIANGLES, _MAX_TRIANGLES))
    points, faces = fast_simplification.simplify(
        np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int32), target_count=target, agg=_AGGRESSION
    )[:2]
    result = trimesh.Trimesh(points, faces, process=False)
    shrunk = np.abs(result.bounds - mesh.bounds).max() if len(faces) else np.inf
    if shrunk > 0.05 * mesh.scale or not _compiles(result):
        return b""
    content = result.export(file_type="stl")
    return content if isinstance(content, bytes) else b""


def _compiles(mesh: trimesh.Trimesh) -> bool:
    """Whether MuJoCo accepts the mesh; it rejects meshes of almost no volume."""
    spec = mujoco.MjSpec()
    spec.add_mesh(name="mesh", uservert=mesh.vertices.flatten().tolist(), userface=mesh.faces.flatten().tolist())
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="mesh")
    try:
        spec.compile()
    except ValueError:
        return False
    return True


def _image_mapped_materials(asset: ET.Element) -> set[str | None]:
    flat = {texture.get("name") for texture in asset.findall("texture") if texture.get("type", "cube") == "2d"}
    return {material.get("name") for material in asset.findall("material") if material.get("texture") in flat}

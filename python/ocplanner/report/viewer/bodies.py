"""The bodies of a MuJoCo model as coloured meshes."""

from typing import Any

import numpy as np
import trimesh
from trimesh.visual import ColorVisuals

from ocplanner.envs.simulator import mujoco

_VISUAL_GROUP = 1  # robosuite's; group 0 holds the collision geoms
_WORLD = 0  # floor and walls would hide the scene


def body_meshes(model: Any) -> dict[str, trimesh.Trimesh]:
    """Body name -> visible mesh in the body's frame, metres; without the world's floor and walls.

    Args:
        model: the compiled ``mujoco.MjModel`` of a robosuite environment.
    """
    parts: dict[str, list[trimesh.Trimesh]] = {}
    for geom in range(model.ngeom):
        body = int(model.geom_bodyid[geom])
        colour = _colour(model, geom)
        if model.geom_group[geom] != _VISUAL_GROUP or body == _WORLD or colour[3] == 0:
            continue
        mesh = _mesh(model, geom)
        if mesh is not None:
            mesh.apply_transform(_transform(model.geom_pos[geom], model.geom_quat[geom]))
            mesh.visual = ColorVisuals(mesh, face_colors=np.tile(colour, (len(mesh.faces), 1)))
            parts.setdefault(model.body(body).name, []).append(mesh)
    return {name: _joined(meshes) for name, meshes in parts.items()}


def _joined(meshes: list[trimesh.Trimesh]) -> trimesh.Trimesh:
    joined = trimesh.util.concatenate(meshes)
    if not isinstance(joined, trimesh.Trimesh):  # meshes always make a mesh
        raise TypeError(type(joined))
    return joined


def _mesh(model: Any, geom: int) -> trimesh.Trimesh | None:
    """The shape of a geom in its own frame; None for shapes without an extent."""
    kinds, size = mujoco.mjtGeom, model.geom_size[geom]
    kind = int(model.geom_type[geom])
    if kind == kinds.mjGEOM_MESH:
        mesh = int(model.geom_dataid[geom])
        vertices, faces = model.mesh_vertadr[mesh], model.mesh_faceadr[mesh]
        return trimesh.Trimesh(
            model.mesh_vert[vertices : vertices + model.mesh_vertnum[mesh]],
            model.mesh_face[faces : faces + model.mesh_facenum[mesh]],
            process=False,
        )
    if kind == kinds.mjGEOM_BOX:
        return trimesh.creation.box(2 * size)
    if kind == kinds.mjGEOM_SPHERE:
        return trimesh.creation.icosphere(2, float(size[0]))
    if kind == kinds.mjGEOM_CYLINDER:
        return trimesh.creation.cylinder(float(size[0]), 2 * float(size[1]))
    if kind == kinds.mjGEOM_CAPSULE:
        return trimesh.creation.capsule(2 * float(size[1]), float(size[0]))
    if kind == kinds.mjGEOM_ELLIPSOID:
        mesh = trimesh.creation.icosphere(2, 1.0)
        mesh.apply_scale(size)
        return mesh
    return None


def _colour(model: Any, geom: int) -> np.ndarray:
    """(4,) uint8: a geom's own colour, or its material's, multiplied by the mean of its texture."""
    material = int(model.geom_matid[geom])
    rgba = np.array(model.geom_rgba[geom] if material < 0 else model.mat_rgba[material], dtype=np.float64)
    textures = [] if material < 0 else [int(one) for one in model.mat_texid[material] if one >= 0]
    if textures:
        rgba[:3] *= _mean_colour(model, textures[0])
    return (255 * np.clip(rgba, 0, 1)).round().astype(np.uint8)


def _mean_colour(model: Any, texture: int) -> np.ndarray:
    channels = int(model.tex_nchannel[texture])
    start = int(model.tex_adr[texture])
    pixels = int(model.tex_height[texture]) * int(model.tex_width[texture])
    texels = model.tex_data[start : start + pixels * channels].reshape(pixels, channels)
    return np.broadcast_to(texels.mean(axis=0)[:3] / 255, 3)


def _transform(position: np.ndarray, quat_wxyz: np.ndarray) -> np.ndarray:
    matrix, rotation = np.eye(4), np.empty(9)
    mujoco.mju_quat2Mat(rotation, np.asarray(quat_wxyz, dtype=np.float64))
    matrix[:3, :3], matrix[:3, 3] = rotation.reshape(3, 3), position
    return matrix

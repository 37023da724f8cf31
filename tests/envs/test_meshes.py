import numpy as np
import pytest

from ocplanner.envs import meshes
from ocplanner.envs.robots import ROBOTS
from ocplanner.envs.simulator import robosuite

PHYSICS = ("body_mass", "body_inertia", "body_ipos", "body_iquat", "geom_contype", "geom_conaffinity", "dof_damping")


@pytest.mark.parametrize("robot", sorted(ROBOTS))
def test_simplifying_leaves_physics_alone(shared_env, robot: str):
    env = shared_env("Square", robot)
    stock = robosuite.make(
        "NutAssemblySquare", robots=robot, has_renderer=False, has_offscreen_renderer=False, use_camera_obs=False
    )
    theirs = stock.sim.model._model
    for field in PHYSICS:
        np.testing.assert_array_equal(getattr(env.model, field), getattr(theirs, field), err_msg=field)
    colliding = np.flatnonzero((theirs.geom_contype | theirs.geom_conaffinity) != 0)
    for geom in colliding[theirs.geom_type[colliding] == 7]:
        ours, mesh = env.model.geom_dataid[geom], theirs.geom_dataid[geom]
        assert env.model.mesh_facenum[ours] == theirs.mesh_facenum[mesh]
    visual = (theirs.geom_group == 1) & (theirs.geom_type == 7)
    drawn = [model.mesh_facenum[model.geom_dataid[visual]].sum() for model in (env.model, theirs)]
    assert drawn[0] < (0.75 if robot == "XArm7" else 0.45) * drawn[1]  # XArm7's gripper collides with what is drawn
    stock.close()


def test_simplified_meshes_are_made_once(tmp_path, monkeypatch):
    trimesh = pytest.importorskip("trimesh")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    sphere = trimesh.creation.icosphere(subdivisions=5)
    path = tmp_path / "sphere.stl"
    sphere.export(path)
    copy = meshes.simplified(path)
    assert copy.is_relative_to(tmp_path / "cache")
    reduced = trimesh.load_mesh(copy)
    assert 200 < len(reduced.faces) < 0.2 * len(sphere.faces)
    np.testing.assert_allclose(reduced.bounds, sphere.bounds, atol=0.05)
    monkeypatch.setattr(meshes, "_simplify", lambda _: pytest.fail("made again"))
    assert meshes.simplified(path) == copy


def test_small_meshes_and_unwritable_caches_are_no_trouble(tmp_path, monkeypatch):
    trimesh = pytest.importorskip("trimesh")
    path = tmp_path / "box.stl"
    trimesh.creation.box().export(path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    assert meshes.simplified(path) == path
    assert meshes.simplified(path) == path
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert meshes.simplified(path) == path

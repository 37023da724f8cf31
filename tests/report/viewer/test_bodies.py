import numpy as np

from ocplanner.envs import make_env
from ocplanner.envs.simulator import mujoco
from ocplanner.report.viewer.bodies import body_meshes

SHAPES = """
<mujoco><worldbody><geom type="plane" size="1 1 1" group="1"/><body name="one" pos="0 0 1">
  <geom type="box" size=".1 .2 .3" pos="1 0 0" quat="0.7071068 0 0 0.7071068" rgba="1 0 0 1" group="1"/>
  <geom type="sphere" size=".1" rgba="0 1 0 1" group="1"/>
  <geom type="capsule" size=".1 .2" group="0"/>
</body><body name="two">
  <geom type="capsule" size=".1 .2" group="1"/><geom type="cylinder" size=".3 .05" group="1"/>
  <geom type="ellipsoid" size=".1 .2 .5" group="1"/><geom type="sphere" size="9" rgba="0 0 0 0" group="1"/>
</body></worldbody></mujoco>
"""


def test_each_shape_has_its_extent_its_place_and_its_colour():
    meshes = body_meshes(mujoco.MjModel.from_xml_string(SHAPES))
    assert set(meshes) == {"one", "two"}  # the world is left out
    low, high = meshes["one"].bounds
    np.testing.assert_allclose(high, [1.2, 0.1, 0.3], atol=1e-6)  # turned by a quarter
    np.testing.assert_allclose(low, [-0.1, -0.1, -0.3], atol=1e-2)
    assert {tuple(colour) for colour in meshes["one"].visual.face_colors} == {(255, 0, 0, 255), (0, 255, 0, 255)}
    np.testing.assert_allclose(meshes["two"].bounds[1], [0.3, 0.3, 0.5], atol=1e-2)  # what cannot be seen is left out


def test_a_robot_and_the_objects_are_there():
    with make_env("Square", "Panda", cameras=()) as env:
        meshes = body_meshes(env.model)
    assert {"SquareNut_main", "peg1", "table", "robot0_link7"} <= set(meshes)
    nut = np.asarray(meshes["SquareNut_main"].visual.face_colors)
    assert (nut[:, 0] > nut[:, 2]).all()  # wood

import h5py
import numpy as np

from ocplanner.collection.collect import collect
from ocplanner.collection.frame_renderer import FrameRenderer
from ocplanner.collection.settings import CollectSettings, RenderSettings
from ocplanner.demos.dataset import Demonstrations


def test_real_recordings_show_the_nut_and_the_arms(square_ph):
    settings = RenderSettings(silhouettes=("IIWA",), silhouette_stride=20, frames="manipulation", size=48)
    renderer = FrameRenderer("Square", "Panda", settings)
    with Demonstrations(square_ph) as demos:
        demo = demos["demo_0"]
        arrays = renderer.render(demo)
        segment = demo.manipulation()
    renderer.close()
    kept = np.zeros(demo.length, bool)
    kept[segment.start : segment.stop] = True
    image, empty, mask = (arrays[f"obs/agentview_{key}"] for key in ("image", "empty", "mask"))
    np.testing.assert_array_equal(image.any((1, 2, 3)), kept)
    np.testing.assert_array_equal(image[kept], np.where(mask[..., None], [255, 0, 255], empty)[kept])
    assert 0.02 < mask[kept].mean() < 0.5
    drawn = arrays["obs/agentview_silhouettes"].any((1, 2, 3))
    np.testing.assert_array_equal(np.flatnonzero(drawn), np.arange(segment.start, segment.stop, 20))
    overlap = (arrays["obs/agentview_silhouettes"][drawn, 0] & mask[drawn]).sum((1, 2)) / mask[drawn].sum((1, 2))
    assert overlap.min() > 0.1  # the other arm's hand is where the recorded one is


def test_of_a_task_with_several_objects_the_frames_of_each_are_drawn(tmp_path):
    collect(path := tmp_path / "demonstrations.hdf5", CollectSettings("ToolHang", episodes=1, noise=0.0))
    renderer = FrameRenderer("ToolHang", "Panda", RenderSettings(observe="no-robot", frames="manipulation", size=16))
    with Demonstrations(path) as demos:
        demo = demos[0]
        drawn = renderer.render(demo)["obs/agentview_image"].any((1, 2, 3))
        kept = np.zeros(demo.length, bool)
        for name in ("frame", "tool"):
            segment = demo.manipulation(name)
            kept[segment.start : segment.stop] = True
    renderer.close()
    np.testing.assert_array_equal(drawn, kept)
    assert np.diff(np.flatnonzero(kept)).max() > 1  # the hand is on its way between the two


def test_the_order_of_the_demonstrations_does_not_matter(tiny_square):
    """Nothing is measured at first sight: a hand that first stands at the object once kept a wrong stroke."""
    settings = RenderSettings(silhouettes=("IIWA", "Jaco"), silhouette_stride=25, frames="manipulation", size=48)
    found = []
    with Demonstrations(tiny_square()) as demos:
        for names in (("demo_0", "demo_2"), ("demo_2", "demo_0")):
            renderer = FrameRenderer("Square", "Panda", settings)
            drawn = {name: renderer.render(demos[name]) for name in names}
            renderer.close()
            found.append(drawn["demo_0"])
    for path, array in found[0].items():
        np.testing.assert_array_equal(found[1][path], array)
    assert found[0]["obs/agentview_silhouettes"].any()


def test_objects_are_drawn_in_the_recorded_size(tmp_path):
    path = collect(tmp_path / "lift.hdf5", CollectSettings("Lift", episodes=1, noise=0.0)).path
    areas = []
    for half in (0.02, 0.04):
        geom = f'<geom name="cube_g0_vis" type="box" size="{half} {half} {half}"/>'
        model = f'<body name="cube_main"><joint name="cube_joint0" type="free"/>{geom}</body>'
        with h5py.File(path, "r+") as file:
            file["data/demo_0"].attrs["model_file"] = f"<mujoco><worldbody>{model}</worldbody></mujoco>"
        renderer = FrameRenderer("Lift", "Panda", RenderSettings(observe="no-robot", size=96, silhouettes=()))
        with Demonstrations(path) as demos:
            picture = renderer.render(demos[0])["obs/agentview_image"][0].astype(int)
        renderer.close()
        areas.append(int((picture[..., 0] > picture[..., 1] + 60).sum()))  # the cube is red
    assert 3 < areas[1] / areas[0] < 6


def test_states_alone_give_the_same_pictures(square_ph, tmp_path):
    path = tmp_path / "states.hdf5"
    with h5py.File(square_ph) as source, h5py.File(path, "w") as file:
        file.create_group("data").attrs["env_args"] = source["data"].attrs["env_args"]
        for key in ("states", "actions"):
            file[f"data/demo_0/{key}"] = source[f"data/demo_0/{key}"][:]
    settings = RenderSettings(silhouettes=("IIWA",), silhouette_stride=30, frames="manipulation", size=32)
    found = []
    for data in (square_ph, path):
        renderer = FrameRenderer("Square", "Panda", settings)
        with Demonstrations(data) as demos:
            found.append(renderer.render(demos["demo_0"]))
        renderer.close()
    assert found[0].keys() == found[1].keys()
    for key, array in found[0].items():
        assert array.any()
        np.testing.assert_array_equal(found[1][key], array)

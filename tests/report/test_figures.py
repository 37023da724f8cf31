from ocplanner.drawing.video import write_video
from ocplanner.report.figures import write_figures
from ocplanner.report.sources import find_sources


def test_every_chart_is_written(tmp_path, frames, write_run, write_result):
    write_run("h5")
    write_result()
    write_video(tmp_path / "sawyer_10000.mp4", frames)
    written = write_figures(find_sources([tmp_path]), tmp_path / "charts")
    charts = ("error_curves", "failure_matrix", "loss_curves", "success_rates")
    expected = {f"{name}.{kind}" for name in charts for kind in ("svg", "png")} | {"film_strip_sawyer_10000.png"}
    assert {path.name for path in written} == expected
    assert all(path.stat().st_size > 1000 for path in written)


def test_episodes_of_one_seed_on_two_arms_keep_a_strip_each(tmp_path, frames):
    for arm in ("sawyer", "ur5e"):
        write_video(tmp_path / arm / "episode_10000.mp4", frames if arm == "sawyer" else frames[::-1])
    one, other = write_figures(find_sources([tmp_path]), tmp_path / "charts")
    assert [one.name, other.name] == ["film_strip_sawyer_episode_10000.png", "film_strip_ur5e_episode_10000.png"]
    assert one.read_bytes() != other.read_bytes()


def test_several_robots_have_a_heat_map_and_several_pose_errors_a_plot(tmp_path, write_result):
    write_result("sawyer")
    write_result("ur5e", robot="UR5e")
    write_result("noisy", pose_error={"position_mm": 5.0, "rotation_deg": 0.0, "latency_steps": 0})
    written = {path.stem for path in write_figures(find_sources([tmp_path]), tmp_path / "charts")}
    assert written == {"success_rates", "failure_matrix", "heat_map", "pose_noise_0"}


def test_policies_have_charts_of_their_own(tmp_path, write_policy_run, write_evaluation):
    write_policy_run("run")
    write_evaluation("evaluation")
    written = write_figures(find_sources([tmp_path]), tmp_path / "charts")
    assert {path.stem for path in written} == {"policy_curves", "success_curves"}


def test_only_what_is_there_is_drawn(tmp_path, write_run):
    written = write_figures(find_sources([write_run("h5")]), tmp_path / "charts")
    assert {path.stem for path in written} == {"loss_curves", "error_curves"}

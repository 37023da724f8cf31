import pytest

from ocplanner.errors import ResultFileError
from ocplanner.report.noise_plot import noise_series, success_against_noise, write_noise_plot
from ocplanner.zero_shot.result import read_results


@pytest.fixture
def write_noisy(write_result):
    def write(millimetres, degrees, latency=0, **changes):
        error = {"position_mm": millimetres, "rotation_deg": degrees, "latency_steps": latency}
        name = "_".join(map(str, (millimetres, degrees, latency, *changes.values())))
        return write_result(name, pose_error=error, **changes)

    return write


def records(paths):
    return [record for path in paths for record in read_results(path)]


def test_one_line_a_rotation_noise_in_order_of_position_noise(write_noisy):
    paths = [write_noisy(mm, deg, successes=9 - mm) for deg in (2.0, 0.0) for mm in (5, 0, 2)]
    (series,) = noise_series(records(paths))
    figure = success_against_noise(series)
    lines = [container.lines[0] for container in figure.axes[0].containers]
    assert [line.get_label() for line in lines] == ["_nolegend_"] * 2
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [
        "rotation noise 0°, as read",
        "rotation noise 2°, as read",
    ]
    for line in lines:
        assert line.get_xdata() == pytest.approx([0, 2, 5], abs=0.1)
        assert list(line.get_ydata()) == sorted(line.get_ydata(), reverse=True)


def test_filtered_poses_stand_beside_those_as_read(write_noisy):
    paths = [write_noisy(0, 0), write_noisy(5, 0), write_noisy(5, 0, pose_filter=8), write_noisy(2, 0, pose_filter=8)]
    (series,) = noise_series(records(paths))
    legend = success_against_noise(series).legends[0].get_texts()
    assert [text.get_text() for text in legend] == ["rotation noise 0°, mean of 8 steps", "rotation noise 0°, as read"]
    assert "averaged over 8 steps" in next(record for record in series if record.settings.pose_filter == 8).setting


def test_other_robots_latencies_and_planners_stand_apart(write_noisy):
    paths = [write_noisy(0, 0), write_noisy(5, 0), write_noisy(5, 0, latency=2), write_noisy(5, 0, robot="UR5e")]
    (series,) = noise_series(records(paths))
    assert [record.settings.pose_noise[0] for record in series] == [0, 5]
    assert "pose noise 5 mm 0°" in series[1].setting
    assert noise_series(records(paths[2:])) == []


def test_files_become_a_picture_and_others_are_refused(tmp_path, write_noisy):
    paths = [write_noisy(0, 0), write_noisy(5, 0)]
    assert write_noise_plot(paths, tmp_path / "noise.png").read_bytes().startswith(b"\x89PNG")
    with pytest.raises(ResultFileError, match="0 transfers under several pose errors"):
        write_noise_plot(paths[:1], tmp_path / "other.png")

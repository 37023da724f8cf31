import base64
import json

import pytest

from ocplanner.drawing.video import read_video, write_video
from ocplanner.errors import ResultFileError
from ocplanner.report.media import embed_file, embed_video, match_episode
from ocplanner.zero_shot.result import read_results


def test_an_embedded_video_is_the_file_and_has_a_poster_and_a_strip(tmp_path, frames, write_result):
    records = read_results(write_result(successes=2, failures=("slip",)))
    path = write_video(tmp_path / "videos" / "sawyer_10002.mp4", frames)
    video = embed_video(path, records)
    head, _, data = video.uri.partition(",")
    assert head == "data:video/mp4;base64"
    assert base64.b64decode(data) == path.read_bytes()
    assert (video.width, video.height, len(video.strip)) == (96, 64, 8)
    assert video.poster.startswith("data:image/jpeg;base64,")
    assert video.record is records[0]
    assert video.episode.failure == "slip"
    (tmp_path / "again.mp4").write_bytes(base64.b64decode(data))
    assert (read_video(tmp_path / "again.mp4") == read_video(path)).all()


@pytest.mark.parametrize(
    ("video", "expected"),
    [
        ("a/one/episode_10001.mp4", "a"),
        ("a/videos/sawyer_10001.mp4", "a"),
        ("b/videos/10001.mp4", "b"),
        ("ur5e_10001.mp4", "b"),
        ("10001.mp4", None),
        ("a/sawyer_77.mp4", None),
        ("a/film.mp4", None),
    ],
)
def test_a_video_belongs_to_the_nearest_result_with_its_seed(tmp_path, write_result, video, expected):
    for folder in "ab":
        (tmp_path / folder).mkdir()
    records = [*read_results(write_result("a/one", robot="Sawyer")), *read_results(write_result("b/one", robot="UR5e"))]
    record, episode = match_episode(tmp_path / video, records)
    assert (record.path.parent.name if record else None) == expected
    assert (episode.seed if episode else None) == (10001 if expected else None)


def test_of_the_cells_of_a_matrix_robot_and_task_in_the_path_decide(tmp_path, write_result):
    cells = [
        json.loads(write_result("cell", task=task, robot=robot).read_text())
        for task in ("Lift", "Can")
        for robot in ("Sawyer", "UR5e")
    ]
    (tmp_path / "matrix.json").write_text(json.dumps({"command": "", "cells": cells}))
    record, _ = match_episode(
        tmp_path / "matrix" / "can_ur5e_gated" / "episode_10001.mp4", read_results(tmp_path / "matrix.json")
    )
    assert record is not None
    assert (record.task, record.robot) == ("Can", "UR5e")


@pytest.mark.parametrize("name", ["absent.png", "film.gif"])
def test_a_file_that_cannot_be_embedded_is_an_error(tmp_path, name):
    with pytest.raises(ResultFileError, match=name):
        embed_file(tmp_path / name)

from pathlib import Path

import pytest

from ocplanner.report.names import distinct_names


@pytest.mark.parametrize(
    ("paths", "expected"),
    [
        ([], []),
        (["a/one.mp4", "b/two.mp4"], ["one", "two"]),
        (["a/one.mp4", "b/one.mp4", "b/two.mp4"], ["a_one", "b_one", "two"]),
        (["a/videos/1.mp4", "b/videos/1.mp4", "b/2.mp4"], ["a_videos_1", "b_videos_1", "2"]),
    ],
)
def test_folders_stand_in_front_only_where_they_tell_files_apart(paths, expected):
    assert distinct_names([Path(path) for path in paths]) == expected


def test_given_names_are_told_apart_too():
    paths = [Path("a/run/planner.safetensors"), Path("b/run/planner.safetensors")]
    assert distinct_names(paths, ["run", "run"]) == ["a_run_run", "b_run_run"]

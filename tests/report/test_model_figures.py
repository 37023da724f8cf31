from pathlib import Path

import pytest

from ocplanner.errors import DatasetError, MismatchError
from ocplanner.report.model_figures import distinct_names, first_fitting


def refuse(*names):
    def check(demos):
        if demos in names:
            raise MismatchError(f"{demos} does not fit")

    return check


def test_the_first_that_fits_is_taken():
    assert first_fitting(["a", "b", "c"], refuse("a")) == "b"


def test_if_none_fits_every_reason_is_given():
    with pytest.raises(MismatchError, match="a does not fit; b does not fit"):
        first_fitting(["a", "b"], refuse("a", "b"))
    with pytest.raises(MismatchError, match="--data"):
        first_fitting([], refuse())


def test_damage_is_not_passed_over():
    def damaged(_):
        raise DatasetError("truncated")

    with pytest.raises(DatasetError, match="truncated"):
        first_fitting(["a", "b"], damaged)


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

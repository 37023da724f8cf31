import shutil

import pytest

from ocplanner.errors import ResultFileError
from ocplanner.report.sources import find_sources


def test_a_folder_is_searched_for_runs_results_videos_and_figures(tmp_path, write_run, write_result):
    for name in ("h5", "h20", "h100"):
        write_run(name)
    write_result()
    (tmp_path / "h5" / "figures").mkdir()
    for name in (
        "h5/figures/plans.png",
        "h5/stray.png",
        "h5/a.mp4",
        "h5/planner.safetensors",
        "h5/notes.json",
        ".hidden.mp4",
    ):
        (tmp_path / name).write_text("{}")
    (tmp_path / "h5" / "checkpoints").mkdir()
    shutil.copy(tmp_path / "transfer.json", tmp_path / "h5" / "checkpoints")
    sources = find_sources([tmp_path])
    assert [run.name for run in sources.runs] == ["h5", "h20", "h100"]
    assert [record.path.name for record in sources.records] == ["transfer.json"]
    assert [path.name for path in sources.videos] == ["a.mp4"]
    assert [path.name for path in sources.figures] == ["plans.png"]
    assert [path.name for path in sources.planners] == ["planner.safetensors"]


def test_what_is_named_twice_is_taken_once(tmp_path, write_result):
    path = write_result()
    assert len(find_sources([path, tmp_path, path]).records) == 1


def test_a_result_can_be_named_outright_and_must_then_be_one(tmp_path, write_result):
    assert find_sources([write_result()]).records[0].robot == "Sawyer"
    (tmp_path / "notes.json").write_text("{}")
    with pytest.raises(ResultFileError, match="lacks task"):
        find_sources([tmp_path / "notes.json"])


@pytest.mark.parametrize("name", ["absent", "data.hdf5"])
def test_a_path_that_cannot_be_shown_is_an_error_that_names_it(tmp_path, name):
    (tmp_path / "data.hdf5").write_bytes(b"")
    with pytest.raises(ResultFileError, match=name):
        find_sources([tmp_path / name])


def test_an_empty_folder_is_an_error(tmp_path):
    with pytest.raises(ResultFileError, match="nothing to report"):
        find_sources([tmp_path])

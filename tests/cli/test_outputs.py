"""No verb replaces what it reads, under whatever name, nor a file of another kind: one table of all that write."""

import hashlib
import os
import shutil
from pathlib import Path

import pytest

from ocplanner.cli import main
from random_planner import write_random_planner
from random_policy import random_training, write_random_policy
from transfer_results import transfer_result

VERBS = {
    "render": ("render data.hdf5 {out} --overwrite --limit 1", ["data.hdf5"]),
    "label": (
        "label data.hdf5 {out} --pictures pictures.hdf5 --planner p.safetensors --overwrite --limit 1",
        ["data.hdf5", "pictures.hdf5", "p.safetensors"],
    ),
    "transfer": ("transfer --planner p.safetensors --out {out} --episodes 1 --overwrite", ["p.safetensors"]),
    "matrix": (
        "matrix --planners p.safetensors --robots Panda --out {out} --episodes 1 --overwrite",
        ["p.safetensors"],
    ),
    "evaluate": (
        "evaluate --policy policy.safetensors --out {out} --episodes 1 --overwrite",
        ["policy.safetensors"],
    ),
    "report": ("report result.json --data data.hdf5 --out {out}", ["result.json", "data.hdf5"]),
}
"""Command and the files that it reads."""
WRITERS = {**VERBS, "collect": ("collect --out {out} --episodes 1 --overwrite", [])}
KINDS = {"render": "HDF5 data set", "label": "HDF5 data set", "collect": "HDF5 data set", "report": "HTML page"}
INPUTS = [(verb, read) for verb, (_, reads) in VERBS.items() for read in reads]


@pytest.fixture
def folder(tmp_path, tiny_square, monkeypatch) -> Path:
    """A folder with an input of each kind."""
    monkeypatch.chdir(tmp_path)
    for name in ("data.hdf5", "pictures.hdf5"):
        shutil.copy(tiny_square("1.4.1", images=True), name)
    write_random_planner(Path("p.safetensors"), observe="full")
    write_random_policy(Path("policy.safetensors"), Path("data.hdf5"), random_training(hint=None))
    transfer_result(3).save(Path("result.json"))
    return tmp_path


def _content(folder: Path) -> dict[str, str]:
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in folder.rglob("*")
        if path.is_file()
    }


@pytest.mark.parametrize("named", ["itself", "symbolic link", "hard link"])
@pytest.mark.parametrize(("verb", "read"), INPUTS)
def test_an_input_is_never_the_output(folder, capsys, verb, read, named):
    out = read
    if named != "itself":
        out = f"link{Path(read).suffix}"
        (os.link if named == "hard link" else os.symlink)(read, out)
    before = _content(folder)
    assert main(VERBS[verb][0].format(out=out).split()) == 2
    assert "is read to make the output and is never replaced" in capsys.readouterr().err
    assert _content(folder) == before


@pytest.mark.parametrize("verb", WRITERS)
def test_a_file_of_another_kind_is_not_replaced(folder, capsys, verb):
    kind = KINDS.get(verb, "JSON result")
    out = "notes.json" if kind == "JSON result" else "notes.txt"
    Path(out).write_text('{"algo_name": "bc"}')
    before = _content(folder)
    assert main(WRITERS[verb][0].format(out=out).split()) == 2
    assert f"{out} exists already and is no {kind}" in capsys.readouterr().err
    assert _content(folder) == before


@pytest.mark.parametrize("out", [".", "/", "", "..", "folder", "/dev/null"])
@pytest.mark.parametrize("verb", WRITERS)
def test_what_names_no_file_is_one_error(folder, capsys, verb, out):
    Path("folder").mkdir()
    before = _content(folder)
    words = [out if word == "{out}" else word for word in WRITERS[verb][0].split()]
    assert main(words) == 2
    error = capsys.readouterr().err.strip()
    assert "\n" not in error
    assert any(part in error for part in ("name a file", "and is no", "must end in .json"))
    assert _content(folder) == before
    assert not list(Path().rglob(".*lock"))


@pytest.mark.parametrize("verb", ["train-planner", "train-policy"])
@pytest.mark.parametrize(
    ("run", "message"),
    [
        (".", "the working directory is in it"),
        ("/", "the working directory is in it"),
        ("", "the working directory is in it"),
        ("..", "the working directory is in it"),
        ("sets", "holds sets/data.hdf5, which is read"),
        ("policies", "has no config.yaml, so its policy.safetensors may be something else's"),
        ("data.hdf5", "data.hdf5 is a file; name a folder"),
    ],
)
def test_run_folders_that_are_refused(folder, capsys, verb, run, message):
    for name, file in (("sets", "data.hdf5"), ("policies", "policy.safetensors")):
        Path(name).mkdir()
        os.link(file, Path(name) / file)
    before = _content(folder)
    assert main([verb, "--data", "sets/data.hdf5", "--run", run]) == 2
    error = capsys.readouterr().err.strip()
    assert message in error
    assert "\n" not in error
    assert _content(folder) == before


def test_charts_do_not_replace_a_picture_that_is_named(folder, capsys):
    assert main(["report", "result.json", "--charts", "figures"]) == 0
    before = _content(folder)
    assert main(["report", "result.json", "figures/success_rates.png", "--charts", "figures"]) == 2
    assert "figures/success_rates.png is read to make the output" in capsys.readouterr().err
    assert {**_content(folder), "figures/success_rates.svg": ""} == {**before, "figures/success_rates.svg": ""}
    assert main(["report", "result.json", "--charts", "figures"]) == 0  # its own charts are drawn anew


def test_a_demo_keeps_what_its_folder_holds(folder, capsys):
    before = _content(folder)
    assert main(["demo", "--data", "data.hdf5", "--out", "."]) == 2
    assert "is not empty and has no demo.json" in capsys.readouterr().err
    assert _content(folder) == before

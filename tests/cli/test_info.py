"""``ocplanner info`` on data sets, planner files and everything else."""

import json
import shutil

import numpy as np
import pytest
from safetensors.numpy import save_file

from ocplanner.cli import main
from ocplanner.cli.info import describe
from ocplanner.errors import DatasetError, ModelFileError


@pytest.fixture
def planner_file(tmp_path):
    config = {"task": "Square", "horizon": 20, "normaliser": {"mean": [0.1, 0.2, 0.9], "std": [0.1, 0.1, 0.05]}}
    metadata = {"ocplanner": json.dumps({"format": 1, "kind": "planner", "config": config})}
    save_file({"decoder.head.weight": np.zeros((9, 4), np.float32)}, tmp_path / "p.safetensors", metadata)
    return tmp_path / "p.safetensors"


@pytest.mark.parametrize(("version", "layout"), [("1.4.1", "absolute-first"), ("1.5.1", "relative-first")])
def test_data_set(tiny_square, capsys, version, layout):
    path = tiny_square(version, True)
    facts = describe(path)
    assert (facts["demonstrations"], facts["steps"], facts["object layout"]) == (4, 360, layout)
    assert facts["masks"] == {"train": 3, "valid": 1}
    assert (facts["cameras"], facts["robots"]) == (["agentview"], ["Panda"])
    assert main(["info", str(path)]) == 0
    shown = capsys.readouterr().out
    assert all(word in shown for word in ("Square", "Panda", layout, "agentview", "train 3"))


def test_json(tiny_square, capsys):
    assert main(["info", str(tiny_square()), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["steps each"] == {"min": 90, "mean": 90.0, "max": 90}


def test_planner(planner_file, capsys):
    facts = describe(planner_file)
    assert (facts["kind"], facts["parameters"], facts["horizon"]) == ("planner", 36, 20)
    assert main(["info", str(planner_file)]) == 0
    assert "0.1, 0.2, 0.9" in capsys.readouterr().out


def test_a_run_folder_stands_for_its_planner(tmp_path, planner_file, capsys):
    assert main(["info", str(tmp_path)]) == 2
    assert "holds no planner.safetensors nor policy.safetensors" in capsys.readouterr().err
    (tmp_path / "planner.safetensors").write_bytes(planner_file.read_bytes())
    assert describe(tmp_path)["horizon"] == 20


def test_long_entries_are_printed_whole_where_asked(tmp_path, capsys):
    config = {"training": {f"setting_{i}": [i] for i in range(40)}}
    metadata = {"ocplanner": json.dumps({"format": 1, "kind": "planner", "config": config})}
    save_file({"weight": np.zeros(1, np.float32)}, tmp_path / "p.safetensors", metadata)
    assert main(["info", str(tmp_path / "p.safetensors")]) == 0
    assert "(40 lines: --all)" in " ".join(capsys.readouterr().out.replace("│", "").split())
    assert main(["info", str(tmp_path / "p.safetensors"), "--all"]) == 0
    assert "setting_39: 39" in capsys.readouterr().out


def test_damaged_files(tmp_path, planner_file, tiny_square, capsys):
    whole = planner_file.read_bytes()
    for size in range(0, len(whole), 7):
        planner_file.write_bytes(whole[:size])
        with pytest.raises(ModelFileError, match=r"p\.safetensors"):
            describe(planner_file)
    save_file({"a": np.zeros(3, np.float32)}, tmp_path / "other.safetensors")
    with pytest.raises(ModelFileError, match=r"not one of ocplanner's"):
        describe(tmp_path / "other.safetensors")
    (tmp_path / "notes.txt").write_text("some notes")
    with pytest.raises(DatasetError, match=r"neither an HDF5 data set nor"):
        describe(tmp_path / "notes.txt")
    cut = tmp_path / "cut.hdf5"
    cut.write_bytes(shutil.copy(tiny_square(), tmp_path / "c").read_bytes()[:5000])
    assert main(["info", str(cut)]) == 2
    assert main(["info", str(tmp_path / "absent.hdf5")]) == 2
    errors = capsys.readouterr().err.splitlines()
    assert len(errors) == 2
    assert all(line.startswith("error: ") for line in errors)


def test_square_ph(square_ph):
    facts = describe(square_ph)
    assert (facts["demonstrations"], facts["steps"]) == (200, 30154)
    assert facts["steps each"] == {"min": 107, "mean": 150.8, "max": 236}
    assert facts["largest action"] == 1.0

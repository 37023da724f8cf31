"""``ocplanner matrix`` with planners of random weights."""

import json

import pytest

from ocplanner.cli import main
from random_planner import write_random_planner


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_random_planner(tmp_path / "p.safetensors")
    return tmp_path


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        ("--planners p.safetensors --robots Panda Nobody", "unknown robot 'Nobody'; known:"),
        ("", "name planner files with --planners"),
        ("--planners .  --planner-seed 3", "no planner (.safetensors) of training seed 3"),
    ],
)
def test_what_is_wrong_is_one_line(folder, capsys, flags, message):
    assert main(["matrix", *flags.split()]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


def test_a_matrix_leaves_its_file_its_cells_a_picture_and_a_page(folder, capsys):
    command = ["matrix", "--planners", ".", "--robots", "Panda", "Sawyer", "--episodes", "1"]
    command += ["--pose-noise", "40", "20", "--pose-latency", "2", "--out", "m.json"]
    assert main(command) == 0
    printed = capsys.readouterr().out
    assert "Square on Sawyer (gated, masked, pose noise 40 mm 20°, 2-step pose latency): 0/1" in printed
    cells = json.loads((folder / "m.json").read_text())["cells"]
    assert [cell["robot"] for cell in cells] == ["Panda", "Sawyer"]
    assert {"planner_sha256", "versions", "interval", "failures", "runs"} <= set(cells[0])
    name = "square_panda_gated_masked_noise40mm20deg_latency2_0.json"
    assert json.loads((folder / "m" / name).read_text()) == cells[0]
    assert (folder / "m.png").read_bytes().startswith(b"\x89PNG")
    assert main(["report", "m.json", "--out", "page.html"]) == 0
    page = (folder / "page.html").read_text()
    assert "Every task on every robot" in page
    assert "0/1" in page

import subprocess
from pathlib import Path

import pytest

SOURCES = Path(__file__).parents[2] / "python"


@pytest.fixture
def robot_computer(monkeypatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
    import robot_computer

    return robot_computer


def test_planning_and_control_need_neither_a_simulator_nor_torch(robot_computer, tmp_path):
    said = robot_computer.plan_and_act(tmp_path / "environment", SOURCES)
    assert said == "planned, and placed a cube\n"


def test_a_package_that_is_needed_and_missing_is_noticed(robot_computer, tmp_path, monkeypatch, capfd):
    monkeypatch.setattr(robot_computer, "PROGRAM", "import torch")
    with pytest.raises(subprocess.CalledProcessError):
        robot_computer.plan_and_act(tmp_path / "environment", SOURCES)
    assert "No module named 'torch'" in capfd.readouterr().err

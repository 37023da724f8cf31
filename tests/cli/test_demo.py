"""The whole job on a tiny budget with the real simulator: demonstrations, images, planner, another arm, report."""

import json
from pathlib import Path

import pytest

from ocplanner.cli import main


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("demo")
    flags = ["--out", str(out), "--demonstrations", "4", "--episodes", "1", "--stages", "4", "4", "2", "--workers", "1"]
    assert main(["demo", *flags]) == 0
    return out


def test_every_step_leaves_its_file(out: Path) -> None:
    for name in ("demonstrations.hdf5", "images.hdf5", "planner/planner.safetensors", "sawyer.json", "report.html"):
        assert (out / name).stat().st_size > 0
    assert not list(out.glob("**/*.parts"))


def test_the_result_says_how_it_was_made(out: Path) -> None:
    result = json.loads((out / "sawyer.json").read_text())
    assert (result["task"], result["robot"], result["observe"]) == ("Square", "Sawyer", "masked")
    assert result["settings"]["control"]["follow"] == "gated"
    assert result["patches"] == ["sawyer-base-contact"]
    assert [run["seed"] for run in result["runs"]] == [10000]
    low, high = result["interval"]
    assert 0 <= low <= result["successes"] / result["episodes"] <= high <= 1


def test_a_second_run_does_nothing_again(out: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = {path: path.stat().st_mtime_ns for path in out.glob("*.hdf5")}
    flags = ["--out", str(out), "--demonstrations", "4", "--episodes", "1", "--stages", "4", "4", "2", "--workers", "1"]
    assert main(["demo", *flags]) == 0
    assert {path: path.stat().st_mtime_ns for path in out.glob("*.hdf5")} == before
    assert "report.html" in capsys.readouterr().out


@pytest.mark.parametrize(
    "flags",
    [
        ("--seed", "1"),
        ("--demonstrations", "5"),
        ("--stages", "4", "4", "3"),
        ("--data", "demonstrations.hdf5"),
    ],
)
def test_files_of_other_flags_are_not_used_again(out: Path, capsys: pytest.CaptureFixture[str], flags) -> None:
    before = {path: path.stat().st_mtime_ns for path in out.rglob("*") if path.is_file()}
    values = [str(out / value) if flags[0] == "--data" else value for value in flags[1:]]
    given = {"--demonstrations": ("4",), "--stages": ("4", "4", "2"), flags[0]: values}
    words = [word for flag, values in given.items() for word in (flag, *values)]
    assert main(["demo", "--out", str(out), "--episodes", "1", *words]) == 2
    error = capsys.readouterr().err
    assert f"was made with {flags[0]} " in error
    assert "choose another --out" in error
    assert {path: path.stat().st_mtime_ns for path in out.rglob("*") if path.is_file()} == before


def test_a_data_set_that_is_not_there_claims_no_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["demo", "--out", str(tmp_path / "none"), "--data", str(tmp_path / "absent.hdf5")]) == 2
    assert "absent.hdf5" in capsys.readouterr().err
    assert not (tmp_path / "none").exists()


def test_a_folder_of_unknown_origin_is_not_used(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "demonstrations.hdf5").touch()
    assert main(["demo", "--out", str(tmp_path)]) == 2
    assert "has no demo.json" in capsys.readouterr().err


def test_an_unknown_robot_is_named_before_anything_is_done(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["demo", "--robot", "R2D2", "--out", str(tmp_path / "none")]) == 2
    assert "unknown robot 'R2D2'; known: " in capsys.readouterr().err
    assert not (tmp_path / "none").exists()

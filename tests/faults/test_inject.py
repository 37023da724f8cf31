"""The injector on one cheap verb: all is well with ours, and what is not well is counted."""

import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

HERE = Path(__file__).parent
# A writer that writes in place: what it has begun stands under the final name.
CARELESS = """
import contextlib, sys, time
from pathlib import Path
sys.path.insert(0, {here!r})
import inject
from ocplanner.training import run_folder
from ocplanner.policies import policy

@contextlib.contextmanager
def in_place(path):
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(b"begun")
    time.sleep(0.05)
    yield path

run_folder.atomic_write = policy.atomic_write = in_place
sys.exit(inject.main(sys.argv[1:]))
"""


@pytest.fixture
def material(tmp_path: Path, tiny_square: Callable[..., Path]) -> Path:
    """A folder with a data set, so that none need be collected."""
    folder = tmp_path / "material"
    folder.mkdir()
    shutil.copy(tiny_square(), folder / "collected.hdf5")
    return folder


def run(script: list[str], material: Path, *faults: str, tries: int) -> tuple[int, list[dict]]:
    output = material.with_name("faults.json")
    options = ["--verbs", "train-policy", "--faults", *faults, "--tries", str(tries), "--output", str(output)]
    command = [sys.executable, *script, *options, "--material", str(material)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert output.exists(), done.stderr
    return done.returncode, json.loads(output.read_text())["rows"]


def test_nothing_is_lost(material: Path) -> None:
    code, rows = run([str(HERE / "inject.py")], material, "kill-writing", "truncated", tries=3)
    assert [(row["tries"], row["lost"], row["unclear"]) for row in rows] == [(3, 0, 0)] * 2, rows
    assert rows[1]["compared"] == "bytes"
    assert code == 0


def test_a_careless_writer_is_found_out(material: Path) -> None:
    code, rows = run(["-c", CARELESS.format(here=str(HERE))], material, "kill-writing", tries=4)
    assert rows[0]["lost"] + rows[0]["unclear"] > 0
    assert code == 1

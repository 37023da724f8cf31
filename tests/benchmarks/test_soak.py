"""A tiny soak: everything is counted, and nothing stays behind."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parent))

import soak

SCRIPT = Path(__file__).parent / "soak.py"


def test_nothing_stays_behind(tmp_path: Path) -> None:
    output = tmp_path / "soak.json"
    options = ["--episodes", "8", "--steps", "2", "--remake", "2", "--output", str(output)]
    done = subprocess.run([sys.executable, SCRIPT, *options], check=True, capture_output=True, text=True)
    assert "8 of 8 episodes" in done.stdout
    found = json.loads(output.read_text())
    assert found["left_over"] == {"files": 0, "threads": 0, "children": 0}
    assert found["main"]["episodes"] == 8
    assert found["main"]["children"][1] <= 3
    assert sum(worker["episodes"] for worker in found["workers"]) == 8
    for worker in found["workers"]:
        assert worker["contexts"] == [1, 1]
        assert worker["environments"] == [1, 1]
        assert worker["children"] == [0, 0]
        assert worker["files"][0] == worker["files"][1]
    assert len(found["samples"]["main"]["kib"]) == 8
    assert " ".join(options[:6]) in found["command"]


@pytest.mark.parametrize("kib_each", [0, 7])
def test_the_slope_is_growth_after_the_start(kib_each: int) -> None:
    samples = [{"pid": 1, "episodes": n, "kib": 10**6 + kib_each * n + 10**5 * (n < 20)} for n in range(100)]
    assert soak.summary(samples, 10)["slope"] == pytest.approx(100 * kib_each, abs=0.1)
    assert soak.summary(samples, 10)["kib"] == [10**6 + 20 * kib_each, 10**6 + 99 * kib_each]
    assert soak.summary(samples, 30)["kib"] == [10**6 + 30 * kib_each, 10**6 + 99 * kib_each]

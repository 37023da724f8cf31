import json
import sys
import time
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parent))

import bench_policies


def test_both_sides_train_and_are_written(tiny_square, tmp_path, monkeypatch):
    out = tmp_path / "bench.json"
    flags = ["--data", str(tiny_square()), "--turns", "1", "--steps", "1", "--output", str(out)]
    monkeypatch.setattr(sys, "argv", ["bench_policies.py", *flags])
    monkeypatch.setattr(bench_policies, "_CASES", {"bc state batch 100": "bc"})
    bench_policies.main()
    written = json.loads(out.read_text())
    (row,) = written["rows"]
    assert row["ours"] > 0
    assert row["robomimic"] > 0
    assert {"torch", "numpy"} <= set(written["versions"])


def test_medians_and_ratios():
    def side(whole: float, fetching: float):
        def step() -> float:
            time.sleep(whole)
            return fetching

        return step

    taken = bench_policies.measure({"ours": side(0.002, 0.001), "robomimic": side(0.006, 0.002)}, turns=3, steps=2)
    assert [len(values) for values in taken["ours"]] == [3, 3]
    row = bench_policies.row("case", taken)
    assert row["ratio"] == pytest.approx(np.median(taken["robomimic"][0] / taken["ours"][0]), abs=0.01)
    assert 2 < row["ratio"] < 3.5
    assert row["without data"]["ratio"] > row["ratio"]

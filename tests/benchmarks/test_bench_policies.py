import json
import sys
from pathlib import Path

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


def test_medians_and_ratios(monkeypatch):
    now = [0.0]

    def side(whole: float, fetching: float):
        def step() -> float:
            now[0] += whole
            return fetching

        return step

    monkeypatch.setattr(bench_policies.time, "perf_counter", lambda: now[0])
    taken = bench_policies.measure({"ours": side(0.002, 0.001), "robomimic": side(0.006, 0.002)}, turns=3, steps=2)
    assert [len(values) for values in taken["ours"]] == [3, 3]
    row = bench_policies.row("case", taken)
    assert (row["ours"], row["robomimic"], row["ratio"]) == (2.0, 6.0, 3.0)
    assert row["without data"] == {"ours": 1.0, "robomimic": 4.0, "ratio": 4.0}

import json
import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parent))

import bench_policies
from turns import Turn


def test_both_sides_train_and_are_written(tiny_square, tmp_path, monkeypatch):
    out = tmp_path / "bench.json"
    flags = ["--data", str(tiny_square()), "--turns", "1", "--steps", "1", "--output", str(out)]
    monkeypatch.setattr(sys, "argv", ["bench_policies.py", *flags])
    monkeypatch.setattr(bench_policies, "_CASES", {"bc": ("bc", "bfloat16")})
    bench_policies.main()
    written = json.loads(out.read_text())
    (row,) = written["rows"]
    assert row["ours"] > 0
    assert row["peers"]["robomimic"] > 0
    assert {"torch", "numpy"} <= set(written["versions"])


def test_medians_and_ratios():
    def played(*steps: tuple[float, float]) -> list[Turn]:
        return [Turn(whole, whole, fetching) for whole, fetching in steps]

    mine = played((0.001, 0.0), (0.003, 0.002), (0.002, 0.001), (0.002, 0.001))
    theirs = played(*[(0.006, 0.002)] * 4)
    taken = {"ours": bench_policies.seconds(mine, 2), "robomimic": bench_policies.seconds(theirs, 2)}
    assert [len(values) for values in taken["ours"]] == [2, 2]
    row = bench_policies.row("case", taken)
    assert (row["ours"], row["peers"], row["ratio"]) == (2.0, {"robomimic": 6.0}, {"robomimic": 3.0})
    assert row["without data"] == {"ours": 1.0, "peers": {"robomimic": 4.0}, "ratio": {"robomimic": 4.0}}

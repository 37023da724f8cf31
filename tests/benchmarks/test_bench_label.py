import json
import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parent))

import bench_label

from random_planner import write_random_planner


def test_both_sides_label_alike_and_are_written(tiny_square, tmp_path, monkeypatch):
    source, planner, out = tiny_square("1.4.1", images=True), tmp_path / "planner.safetensors", tmp_path / "bench.json"
    write_random_planner(planner, observe="full", visual=None, mask_rgb=None)
    flags = ["--data", source, "--pictures", source, "--planner", planner, "--demos", "2", "--seconds", "0"]
    flags += ["--times", "3", "--output", out]
    monkeypatch.setattr(sys, "argv", ["bench_label.py", *map(str, flags)])
    bench_label.main()
    written = json.loads(out.read_text())
    assert [row["case"] for row in written["rows"]] == ["whole job, planner", "whole job, resnet18"]
    for row in written["rows"]:
        assert row["largest difference of rewards"] < 1e-6
        assert row["ours"] > 0
        assert set(row["peers"]) == set(row["ratio"]) == {"torch", "torch as trained"}
    few, file, many = (row["demonstrations"] for row in written["memory"])
    assert few < file == many / 3

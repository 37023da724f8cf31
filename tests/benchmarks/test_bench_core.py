"""The benchmark itself: it compares before it times, and keeps the rows that it does not measure."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parent))

import cases
import peers
import rows
from cases import CASES, DisagreementError, Measured, PlanCase
from planner_weights import PlannerWeights
from timing import Timing, interleaved

from ocplanner import Planner
from random_planner import random_images, write_random_planner

SCRIPT = Path(__file__).parent / "bench_core.py"
OTHERS = [peer for peer in peers.PEERS if peer != "torch eager"]
ENCODERS = {
    "resnet18": {"type": "resnet18", "pool": "spatial_softmax", "keypoints": 7, "feature": 9, "temperature": 0.7},
    "small, flat": {"type": "small", "channels": [5, 6], "pool": "flatten", "feature": 9, "feature_relu": True},
}


def measured(ours: float, **peers: float) -> Measured:
    return Measured({name: Timing(value, (value, value), 15) for name, value in {"ours": ours, **peers}.items()})


@pytest.mark.parametrize("encoder", ENCODERS)
@pytest.mark.parametrize("peer", peers.PEERS)
def test_peers_plan_what_the_engine_plans(tmp_path: Path, encoder: str, peer: str) -> None:
    if peer == "torch.compile":
        pytest.skip("compiling takes minutes; the benchmark itself compares it")
    write_random_planner(tmp_path / "p.safetensors", encoder=ENCODERS[encoder], cameras=["a", "b"], crop=51)
    weights = PlannerWeights.load(tmp_path / "p.safetensors")
    images = random_images(weights.config, 3)
    try:
        made = peers.PEERS[peer](weights, 3, 1)
    except peers.AbsentError as reason:
        pytest.skip(f"{peer} is installed by make bench only: {reason}")
    plan = Planner.load(tmp_path / "p.safetensors").plan(images)
    position, rotation = made.plan(images)
    np.testing.assert_allclose(position, plan.position, atol=1e-5)
    np.testing.assert_allclose(rotation, plan.rotation, atol=1e-4)


def test_a_peer_that_plans_otherwise_is_not_timed(monkeypatch: pytest.MonkeyPatch) -> None:
    class Wrong(peers.TorchEager):
        def plan(self, images: peers.Images) -> peers.Poses:
            position, rotation = super().plan(images)
            return position + 0.002, rotation

    monkeypatch.setattr(cases, "PEERS", {"torch eager": Wrong})
    with pytest.raises(DisagreementError, match=r"torch eager: position is up to 2\.0e-03 from ours"):
        PlanCase("cpu h20", 2, "f32", 1).measure(0.0, [])


@pytest.mark.parametrize("case", ["cpu h20 batch 1 f32 1 thread", "label cpu h20 150 frames", "delta-pose step"])
def test_a_row_is_written_beside_the_others(tmp_path: Path, case: str) -> None:
    output = tmp_path / "bench.json"
    output.write_text(json.dumps({"rows": [{"case": "earlier"}, {"case": case}]}))
    options = ["--cases", case, "--seconds", "0", "--skip", *OTHERS, "--output", str(output)]
    subprocess.run([sys.executable, SCRIPT, *options], check=True, capture_output=True)
    written = json.loads(output.read_text())
    assert [row["case"] for row in written["rows"]] == ["earlier", case]
    row = written["rows"][1]
    (peer,) = row["peers"]
    assert row["ratio"][peer] == pytest.approx(row["peers"][peer] / row["ours"], rel=0.02)
    assert row["absent"] == ({} if peer == "numpy" else dict.fromkeys(OTHERS, "skipped"))


def test_every_case_spells_out_what_it_measures() -> None:
    for name, case in CASES.items():
        if isinstance(case, PlanCase):
            threads = "1 thread" if case.threads == 1 else f"{case.threads} threads"
            assert name == f"{case.encoder} batch {case.batch} {case.storage} {threads}"


def test_ratios_above_one_mean_that_ours_is_faster() -> None:
    row = rows.row("case", "ms", measured(0.001, slower=0.0025, faster=0.0005))
    assert (row["ours"], row["peers"]) == (1.0, {"slower": 2.5, "faster": 0.5})
    assert row["ratio"] == {"slower": 2.5, "faster": 0.5}


def test_table_and_chart(tmp_path: Path) -> None:
    both = [rows.row("a", "ms", measured(1e-3, onnxruntime=2e-3)), rows.row("b", "us", measured(1e-6, numpy=5e-6))]
    table = rows.table(both).splitlines()
    assert table[0] == "| case | ocplanner | onnxruntime | numpy |"
    assert table[2:] == ["| a | 1.0 ms | 2.0 (2.0x) |  |", "| b | 1.0 us |  | 5.0 (5.0x) |"]
    rows.chart(both, tmp_path / "chart.png")
    assert (tmp_path / "chart.png").stat().st_size > 1000


def test_only_pages_with_markers_change(tmp_path: Path) -> None:
    page, other = tmp_path / "page.md", tmp_path / "other.md"
    page.write_text(f"before\n{rows.START}\nold\n{rows.END}\nafter\n")
    other.write_text("nothing here\n")
    for path in (page, other, tmp_path / "missing.md"):
        rows.insert(path, "new")
    assert page.read_text() == f"before\n{rows.START}\nnew\n{rows.END}\nafter\n"
    assert other.read_text() == "nothing here\n"
    assert not (tmp_path / "missing.md").exists()


def test_sides_take_turns_and_are_called_equally_often() -> None:
    calls: list[str] = []
    timings = interleaved({name: lambda name=name: calls.append(name) for name in "abc"}, 0.0, repeat=2)
    assert {name: calls.count(name) for name in "abc"} == dict.fromkeys("abc", 3 + 2 * timings["a"].rounds)
    turns = calls[9::2]
    rounds = [turns[start : start + 3] for start in range(0, len(turns), 3)]
    assert all(sorted(turn) == list("abc") for turn in rounds)
    assert len({tuple(turn) for turn in rounds}) > 1


def test_planners_that_the_peers_do_not_cover_are_refused(tmp_path: Path) -> None:
    write_random_planner(tmp_path / "p.safetensors", modes=2)
    with pytest.raises(ValueError, match="one mode"):
        PlannerWeights.load(tmp_path / "p.safetensors")

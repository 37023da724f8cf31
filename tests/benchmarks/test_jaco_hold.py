import json
import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parent))


import jaco_hold


def test_the_nut_is_carried(tmp_path, monkeypatch):
    out = tmp_path / "hold.json"
    flags = ["--tasks", "Square", "--squeeze", "36", "--turn", "0.18", "--episodes", "1", "--out", str(out)]
    monkeypatch.setattr(sys, "argv", ["jaco_hold.py", *flags])
    monkeypatch.setattr(jaco_hold, "STEPS", 12)
    jaco_hold.main()
    (row,) = json.loads(out.read_text())["rows"]
    assert (row["squeeze_steps"], row["turn_rad"], row["ends"]) == (36, 0.18, {"held": 1})

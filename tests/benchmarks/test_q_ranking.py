import json
import sys
from dataclasses import replace
from pathlib import Path

sys.path.append(str(Path(__file__).parent))

import pytest
import q_ranking

from ocplanner.policies.config import preset
from ocplanner.policies.train import train_policy


@pytest.mark.parametrize(
    ("areas", "first"),
    [((0.5, 0.95, 0.7, 0.9, 1.0), 40), ((0.9, 1.0, 1.0, 1.0, 1.0), 10), ((1.0, 1.0, 1.0, 1.0, 0.8), None)],
)
def test_ranked_from_where_it_stays(areas, first):
    assert q_ranking.ranked_from((10, 20, 30, 40, 50), areas) == first


def test_every_kept_policy_is_ranked(tiny_square, tmp_path, monkeypatch):
    training = replace(preset("cpu", "bcq"), steps=4, save_every=2, batch=8, validate_every=4)
    train_policy(training, tiny_square(), tmp_path / "run")
    out, drawn = tmp_path / "q.json", tmp_path / "q.png"
    flags = ["--successes", tiny_square(), "--failures", tiny_square(), "--out", out, "--figure", drawn]
    monkeypatch.setattr(sys, "argv", ["q_ranking.py", *map(str, (tmp_path / "run", *flags))])
    q_ranking.main()
    (run,) = json.loads(out.read_text())["runs"]
    assert run["steps"] == [2, 4]
    # The same episodes twice: nothing tells them apart.
    found = [one["square_1.4.1"]["whole episode"]["auc"] for one in run["rankings"]]
    assert found == [0.5, 0.5]
    assert run["ranked_from"] == {"square_1.4.1": {"whole episode": None, "last second": None}}
    assert drawn.stat().st_size > 0

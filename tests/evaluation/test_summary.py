"""The table of zero-shot results."""

import json

from ocplanner.evaluation.summary import transfer_table


def test_a_cell_holds_every_seed_and_their_mean(tmp_path) -> None:
    for seed, successes in ((1, 8), (0, 9)):
        result = {"follow": "gated", "observe": "masked", "robot": "Sawyer", "planner_seed": seed}
        text = json.dumps({**result, "successes": successes, "episodes": 10})
        (tmp_path / f"square_sawyer_gated_masked_{seed}.json").write_text(text)
    assert transfer_table(tmp_path).splitlines() == [
        "| follow | observe | Sawyer |",
        "| --- | --- | --- |",
        "| gated | masked | **85 %** (9/10, 8/10) |",
    ]

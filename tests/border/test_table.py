"""The committed table holds no traceback and no silent mistake, and what verbs say today is what it says."""

import json
import re
from typing import Any

import pytest
from inputs import INPUTS
from table import OUTPUT, VERBS

ROWS = {row["input"]: row["answers"] for row in json.loads(OUTPUT.read_text(encoding="utf-8"))["rows"]}
CHEAP = ("convert", "train-policy")
"""Verbs that need neither pictures nor a simulation."""
SAMPLE = {
    "plain": ("info", "convert", "render"),
    "stop-and-go": ("render",),
    "other-arm": ("render",),
    "flipped-gripper": ("label",),
    "raw-1-0": ("convert",),
    "nan-observation-skipped": ("label",),
    "unflagged-absolute": CHEAP,
    "absent-in-mask": CHEAP,
    "overlapping-masks": CHEAP,
    "no-states": CHEAP,
    "all-bad": CHEAP,
    "empty-group": CHEAP,
    "empty-group-skipped": CHEAP,
    "truncated": CHEAP,
    "locked": CHEAP,
    "lerobot-folder": ("convert", "render"),
}
LIFTED_CM = 4.0
"""The expert lifts the cube by more than this."""


def _found(name: str, verb: str) -> dict[str, Any]:
    return ROWS[name][verb]["found"]


def test_the_table_is_whole():
    assert set(ROWS) == set(INPUTS)
    assert all(set(answers) == set(VERBS) for answers in ROWS.values())


@pytest.mark.parametrize("name", INPUTS)
def test_every_answer_is_a_success_or_one_clear_error(name):
    for verb, cell in ROWS[name].items():
        answer = cell["answer"]
        assert "unexpected" not in answer, (verb, answer)
        assert "Traceback" not in answer, (verb, answer)
        assert re.match(r"ok\b|error: .{20}|no policy to evaluate$", answer), (verb, answer)
        if answer.startswith("error"):
            assert re.search(r"; |: | \| ", answer.removeprefix("error: ")), (verb, answer)


@pytest.mark.parametrize("name", SAMPLE)
def test_verbs_say_what_the_table_says(border, name):
    answers = border.row(INPUTS[name], SAMPLE[name])["answers"]
    assert answers == {verb: ROWS[name][verb] for verb in SAMPLE[name]}
